"""Keyframes that show only what others show leave the adjustment of a long video."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gmrdata.cameras.map.covered import alone, covered_rows, links_among, without_seen_again
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import MappingConfig

CONFIG = MappingConfig(cover_times=3, cover_share=0.8)


def looks(n: int, step: int, width: int = 100) -> dict[int, np.ndarray]:
    """What n keyframes see that go on by a step along a row of points."""
    return {row: np.arange(row * step, row * step + width) for row in range(n)}


def test_a_path_that_only_goes_on_keeps_its_keyframes():
    assert not covered_rows(looks(50, step=40), CONFIG)


def test_what_stays_of_a_slow_path_sees_each_point_several_times():
    seen = looks(64, step=5)
    covered = covered_rows(seen, CONFIG)
    stay = sorted(set(seen) - covered)
    assert stay == [0, 4, 8, 16, 24, 32, 40, 48, 56, 60, 62, 63] and len(covered) == 52
    counts = np.bincount(np.concatenate([seen[row] for row in stay]))[100:300]
    assert counts.min() == 2 and np.median(counts) == 3


@pytest.mark.parametrize("turn", [80, 95, 110, 130, 170])
def test_what_links_two_places_stays(turn):
    """A camera that dwells, turns by its field of view, and dwells: both ends see all of the turn,
    but not each other, so that without it nothing tells their sizes apart."""
    at = [*(55 * [0]), *np.linspace(0, turn, 7)[1:-1].astype(int), *(55 * [turn])]
    seen = {row: np.arange(place, place + 100) for row, place in enumerate(at)}
    covered = covered_rows(seen, MappingConfig())
    links = links_among(covered, seen)
    stay = sorted(set(seen) - covered | links)
    held = [[len(np.intersect1d(seen[a], seen[b])) >= 20 for a in stay] for b in stay]
    assert connected_components(np.array(held), directed=False)[0] == 1
    assert len(links) == {95: 1, 110: 1}.get(turn, 0)
    assert links_among(set(seen), seen) == set() == links_among(set(), {})


def test_who_matches_none_of_those_that_stay_leaves_too():
    pairs = [
        PairMatches(*rows, np.zeros((1, 2), np.int32), "") for rows in ((0, 2), (1, 3), (3, 9))
    ]
    matches = Matches([np.zeros((1, 2))] * 10, pairs)
    assert alone({0, 2, 3, 8, 9}, matches) == {8} and alone({0, 1}, matches) == {0, 1}


@pytest.mark.parametrize("times", [4, 8])
def test_a_place_seen_again_and_again_keeps_as_many_as_once(times):
    once = looks(32, step=10)
    there_and_back = [*once, *reversed(once)] * (times // 2)
    again = {row: once[place] for row, place in enumerate(there_and_back)}
    stay = len(again) - len(covered_rows(again, CONFIG))
    assert stay < 40


def matched(places: list[int], last: bool = False) -> Matches:
    """Matches of keyframes at places along a row of points: with those near in time, and further
    before with the three that see most of the same, the first or the `last` of these."""
    step = 10
    points = [set(range(place * step, place * step + 100)) for place in places]
    pairs = []
    for row, seen in enumerate(points):
        near = {row - 2**power for power in range(CONFIG.near_overlap)}
        far = range(max(0, row - max(2**power for power in range(CONFIG.near_overlap))))
        in_order = reversed(far) if last else far
        most = sorted(in_order, key=lambda other: -len(seen & points[other]))[:3]
        for other in sorted({*near, *most}):
            if other >= 0 and (common := sorted(seen & points[other])):
                at = [[p - places[of] * step for of in (other, row)] for p in common]
                pairs.append(PairMatches(other, row, np.array(at, np.int32), ""))
    return Matches([np.zeros((100, 2))] * len(places), pairs)


def test_a_long_video_that_comes_back_maps_what_it_saw_once():
    there_and_back = [*range(80), *reversed(range(80))]
    mapped = without_seen_again(matched(there_and_back * 3), CONFIG)
    # Of the way back what is too near in time is mapped again.
    assert mapped[:80].tolist() == list(range(80)) and len(mapped) < 130
    assert without_seen_again(matched(list(range(300))), CONFIG).tolist() == list(range(300))


@pytest.mark.parametrize("last", [False, True])
def test_each_time_round_matches_the_one_before_or_the_first(last):
    """Of a film of fifteen rounds 22 keyframes of each were mapped anew, and lost: what they match
    was placed itself."""
    laps = [*range(80), *reversed(range(80))] * 4
    matches = matched([*laps, *range(60), *range(60, 140)], last=last)
    mapped = without_seen_again(matches, CONFIG)
    assert len(set(mapped) & set(range(160, 640))) < 90
    assert set(range(len(laps) + 84, len(laps) + 140)) <= set(mapped)
    # Whatever is mapped hangs together.
    pairs = matches.some(mapped).pairs
    links = coo_array(
        (np.ones(len(pairs)), np.array([(pair.first, pair.second) for pair in pairs]).T),
        shape=(len(mapped), len(mapped)),
    )
    assert connected_components(links, directed=False)[0] == 1


def test_what_is_new_after_a_place_seen_again_is_mapped():
    mapped = without_seen_again(matched([*range(150), *range(100, 220)]), CONFIG)
    assert set(range(150)) <= set(mapped) and set(range(205, 270)) <= set(mapped)
    assert 30 < len(set(range(150, 205)) - set(mapped)) < 56


def test_few_keyframes_that_see_again_are_mapped():
    few = matched([*range(90), *range(60, 80), *range(90, 120)])
    assert len(without_seen_again(few, CONFIG)) == len(few.keypoints_px)
    again = matched([*range(45), *reversed(range(45))])
    assert len(without_seen_again(again, CONFIG)) == 90  # not a long video


def test_keyframes_that_see_nothing_are_not_covered():
    nothing = {row: np.zeros(0, np.int64) for row in range(5)}
    assert covered_rows(nothing, CONFIG) == set() and covered_rows({}, CONFIG) == set()
