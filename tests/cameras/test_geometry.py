"""When a model of a camera that hardly travels is set aside for a pure rotation."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.check import agreement
from gmrdata.cameras.check.agreement import without_each
from gmrdata.cameras.files import Agreement, Mapper
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map import mapping
from gmrdata.cameras.map.focal import FreedFocal
from gmrdata.cameras.map.mapping import travel_share
from gmrdata.cameras.map.rotation_only import RotationOnly
from gmrdata.cameras.map.solution import Solution
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import is_bent
from gmrdata.values import transforms
from tests.cameras.drawn_models import turning_by

CONFIG = SfmConfig()
WELL_MATCHED = CONFIG.second.well_matched
N = 12


def mapped(extent: float, focal: FreedFocal | None) -> Solution:
    """A camera that goes `extent` to the side, before a background 10 units away."""
    places = np.linspace(0, extent, N)[:, None] * [1.0, 0.0, 0.0]
    points = np.random.default_rng(0).normal([0.0, 0.0, 10.0], 0.2, (200, 3))
    return Solution(
        world_from_cam=transforms.rigid(np.tile(np.eye(3), (N, 1, 1)), places),
        geometry="full",
        points=points,
        track_lengths=np.full(200, 5),
        errors_px=np.full(1000, 0.3),
        inliers=np.full(N, 80),
        mapper="global",
        focal=focal,
    )


def turning(residual_px: float) -> RotationOnly:
    """Pure rotations with one residual everywhere."""
    return turning_by(np.tile(np.eye(3), (N, 1, 1)), np.full(100, residual_px), [(0, 1)])


def chained(folder: Path, reach: int) -> tuple[Frames, Matches]:
    """Frames, each of which matches the next ones."""
    frames = Frames([folder / f"{row}.jpg" for row in range(N)], None, np.eye(3), (10, 10))
    same = np.tile(np.arange(100)[:, None], 2)
    near = [(a, b) for a in range(N) for b in range(a + 1, min(a + 1 + reach, N))]
    pairs = [PairMatches(a, b, same, "CALIBRATED") for a, b in near]
    return frames, Matches([np.zeros((100, 2))] * N, pairs)


@pytest.mark.parametrize(
    ("focal", "bent"),
    [
        (FreedFocal(1.002, 0.003), False),
        (FreedFocal(0.984, 0.003), True),  # the hand-held pan of the twins
        (FreedFocal(0.85, 0.06), True),  # it can't tell
        (None, True),
    ],
)
def test_a_short_way_is_bent_if_its_focal_length_is_off_or_vague(focal, bent):
    assert is_bent(mapped(0.5, focal), turning(0.9), CONFIG) is bent


def test_a_short_way_is_bent_if_every_second_keyframe_goes_another():
    firm = mapped(0.5, FreedFocal(1.002, 0.003))
    # Shares of a tenth of the distance, here twice the path's extent.
    for share, bent in ((0.01, False), (0.02, True)):
        again = replace(firm, second_share=1.0, agreement=Agreement(6, 0.2, share))
        assert is_bent(again, turning(0.9), CONFIG) is bent
        # A second model of few of them says nothing.
        assert not is_bent(replace(again, second_share=0.5), turning(0.9), CONFIG)


@pytest.mark.parametrize(
    ("focal", "share", "bent"),
    [
        (FreedFocal(1.009, 0.021), 0.0025, False),
        (FreedFocal(1.03, 0.043), 0.0015, False),
        (FreedFocal(1.03, 0.043), 0.02, True),
        (FreedFocal(0.87, 0.0125), 0.001, True),  # a turn with a lens that is 15 % too long
    ],
)
def test_a_short_way_that_others_confirm_need_not_show_the_focal_length(focal, share, bent):
    """Of 20 frames of the dancer, 20 cm of way: called bent, they stood in their place."""
    found = replace(mapped(0.5, focal), second_share=1.0, agreement=Agreement(6, 0.1, share))
    assert is_bent(found, turning(1.38), CONFIG) is bent
    assert travel_share(found) == pytest.approx(0.05, rel=0.01)


def test_where_the_camera_hardly_travels_both_solutions_begin_again_until_they_agree(
    monkeypatch, tmp_path
):
    """One start in four of a twin of 6 cm ended in a path of another shape."""
    firm = mapped(0.5, FreedFocal(1.002, 0.003))
    right, wrong = firm.world_from_cam, firm.world_from_cam.copy()
    wrong[:, 1, 3] = 0.3 * np.sin(np.arange(N))
    poor = replace(firm, world_from_cam=wrong, errors_px=np.full(1000, 0.4))
    frames, matches = chained(tmp_path, 2)
    asked = list[int]()

    def answer(seconds: list[tuple[np.ndarray, float]], start: Solution, other: Solution) -> float:
        asked.clear()
        of_seed = iter(seconds)

        def again(*args: Any) -> tuple[np.ndarray, float]:
            asked.append(args[-1].seed)
            return next(of_seed)

        def otherwise(first: Solution, *args: Any) -> Solution:
            asked.append(args[-1].seed)
            return max(first, other, key=mapping._well_held)

        monkeypatch.setattr(agreement, "map_again", again)
        monkeypatch.setattr(agreement, "map_otherwise", otherwise)
        found = agreement.compare_again(start, frames, matches, tmp_path, CONFIG)
        assert found.agreement is not None
        return found.agreement.place_share

    assert answer([(right, 0.3)], firm, firm) < 1e-9
    assert asked == [1]
    assert answer([(right, 0.3), (right, 0.3)], poor, firm) < 1e-9
    assert asked == [1, 2, 3]
    assert answer([(wrong, 0.4), (right, 0.3)], firm, poor) < 1e-9
    # A second one that fits worse does not take the place of the first one.
    assert answer([(wrong, 0.3), (right, 0.4)], firm, poor) > 0.02


@pytest.mark.parametrize("half", ["another path", "hardly any cameras"])
def test_two_keyframes_in_three_are_asked_where_half_of_them_do_not_confirm_the_path(
    half, monkeypatch, tmp_path
):
    """A dancer behind filled boxes, every third frame, was right, and of half of them 8.7 % off."""
    first = mapped(3.0, FreedFocal(1.002, 0.003))
    right, wrong = first.world_from_cam, first.world_from_cam.copy()
    wrong[:, 1, 3] = 0.5 * np.sin(np.arange(N))
    few = right.copy()
    few[4:] = np.nan
    frames, matches = chained(tmp_path, 2)
    asked = list[int]()

    def answer(of_half: np.ndarray, of_more: np.ndarray) -> Solution:
        asked.clear()

        def again(_: Solution, rows: np.ndarray, *args: Any) -> tuple[np.ndarray, float]:
            asked.append(len(rows))
            found = np.full_like(right, np.nan)
            found[rows] = (of_half if len(asked) == 1 else of_more)[rows]
            return found, 0.3

        monkeypatch.setattr(agreement, "map_again", again)
        return agreement.compare_again(first, frames, matches, tmp_path, CONFIG)

    doubted = wrong if half == "another path" else few
    confirmed = answer(doubted, right)
    assert asked == [6, 8] and confirmed.second_share == 1.0
    assert confirmed.agreement is not None and confirmed.agreement.place_share < 1e-9
    # Where neither gives the path it stays doubted, and so it does where two in three are too few.
    refuted = answer(doubted, wrong)
    assert (
        refuted.agreement is not None and refuted.agreement.place_share > CONFIG.second.same_share
    )
    if half == "another path":
        left = answer(wrong, few)
        assert left.agreement is not None and left.agreement.place_share > CONFIG.second.same_share
    assert answer(right, wrong).agreement == answer(right, right).agreement and asked == [6]


def test_a_model_of_few_keyframes_does_not_say_that_the_camera_only_turns():
    """Most matches of a blurred walk fit a turn, and a model of 8 of 33 keyframes was vague."""
    vague = mapped(0.5, FreedFocal(1.3, 0.9))
    few = vague.world_from_cam.copy()
    few[N // 2 :] = np.nan
    assert is_bent(vague, turning(0.9), CONFIG)
    assert not is_bent(replace(vague, world_from_cam=few), turning(0.9), CONFIG)


@pytest.mark.parametrize(("extent", "mapper"), [(0.5, "small_parallax"), (1.5, "global")])
def test_a_model_that_hardly_travels_is_not_the_last(extent, mapper, monkeypatch, tmp_path):
    """The global mapper's was wrong at 0.38 px, and explained more matches than the right one."""
    found_by = {"global": (80, 0.38), "small_parallax": (76, 0.27)}

    def finish(models: list[Mapper], *_: object) -> Solution:
        inliers, error_px = found_by[models[0]]
        one = replace(mapped(extent, None), mapper=models[0], inliers=np.full(N, inliers))
        return replace(one, errors_px=np.full(1000, error_px))

    monkeypatch.setattr(
        mapping, "_run", lambda name, *_, **known: [name] if name in found_by else []
    )
    monkeypatch.setattr(mapping, "_finish", finish)
    frames, matches = chained(tmp_path, 1)
    chosen = mapping.map_frames(frames, matches, tmp_path, CONFIG)
    assert chosen is not None and chosen.mapper == mapper


@pytest.mark.parametrize(
    ("extent", "there", "residual_px"),
    [
        (1.5, 1.0, 0.9),  # a long way
        (0.5, 1.0, 3.0),  # a pure rotation explains nothing
        (0.5, np.nan, 0.9),  # the mapper of a pan can leave a model without cameras
    ],
)
def test_a_model_that_is_not_bent(extent, there, residual_px):
    model = mapped(extent, None)
    model = replace(model, world_from_cam=there * model.world_from_cam)
    assert not is_bent(model, turning(residual_px), CONFIG)


def test_a_second_solution_leaves_out_only_keyframes_that_others_stand_in_for():
    # A dancer every 20th frame: over 40 frames some pairs hardly match, or not at all.
    features = {(k, k + 1): 100 for k in range(8)} | {(k, k + 2): 200 for k in (0, 1, 5, 6)}
    features |= {(2, 4): WELL_MATCHED - 1, (3, 5): WELL_MATCHED}
    pairs = [PairMatches(*at, np.zeros((n, 2), int), "CALIBRATED") for at, n in features.items()]
    apart = [PairMatches(k, k + 2, np.zeros((99, 2), int), "CALIBRATED") for k in range(7)]

    def left(each: int, n_frames: int, pairs: list[PairMatches]) -> list[int]:
        matches = Matches([np.zeros((0, 2))] * n_frames, pairs)
        return list(without_each(each, matches, WELL_MATCHED).tolist())

    assert left(2, 9, pairs) == [0, 2, 3, 5, 7]
    assert left(2, 9, apart) == [0, 2, 4, 6, 8]
    assert left(2, 8, apart) == [0, 2, 4, 6]
    assert left(3, 9, apart) == [0, 1, 3, 4, 6, 7]
