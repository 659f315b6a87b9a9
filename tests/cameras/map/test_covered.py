"""Keyframes that show only what others show leave the adjustment of a long video."""

import numpy as np
import pytest

from gmrdata.cameras.map.covered import alone, covered_rows
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


def test_keyframes_that_see_nothing_are_not_covered():
    nothing = {row: np.zeros(0, np.int64) for row in range(5)}
    assert covered_rows(nothing, CONFIG) == set() and covered_rows({}, CONFIG) == set()
