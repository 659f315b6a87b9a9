"""Cameras between placed ones: where they are filled, where not, and how well."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import SfmCameras, load_cameras, load_quality, save_cameras
from gmrdata.cameras.frames import Timeline
from gmrdata.cameras.map import models
from gmrdata.cameras.map.solution import fill_short_gaps
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from tests.filming import solve_keyframes_once

NO_CUTS = np.zeros(0, dtype=np.int64)


def cubic_path(numbers: np.ndarray) -> np.ndarray:
    """Cameras that turn steadily about one axis, on a cubic."""
    rotmats = Rotation.from_rotvec(0.02 * numbers[:, None] * [0.6, 0.0, 0.8]).as_matrix()
    t = numbers / 10.0
    centres = np.stack([t**3 - t, 2.0 * t**2, 1.0 - t], axis=1)
    return transforms.rigid(rotmats, centres)


def lost(true: np.ndarray, rows: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The path without some rows, and which are left."""
    world_from_cam, has_camera = true.copy(), np.ones(len(true), dtype=bool)
    world_from_cam[rows], has_camera[rows] = np.nan, False
    return world_from_cam, has_camera


def test_a_cubic_path_is_met_and_what_was_filled_is_told() -> None:
    true = cubic_path(np.arange(20.0))
    world_from_cam, has_camera = lost(true, [5, 6, 7, 12])
    filled, interpolated = fill_short_gaps(world_from_cam, Timeline(np.arange(20), NO_CUTS), 3)
    assert np.flatnonzero(interpolated).tolist() == [5, 6, 7, 12]
    assert filled == pytest.approx(true, abs=1e-9)
    assert np.array_equal(filled[has_camera], world_from_cam[has_camera])


def test_long_gaps_ends_and_cuts_stay_open() -> None:
    true = cubic_path(np.arange(20.0))
    rows = [0, 1, 4, 8, 9, 10, 11, 15, 19]
    world_from_cam, _ = lost(true, rows)
    for after in (14, 15):
        timeline = Timeline(np.arange(20), np.array([after]))
        filled, interpolated = fill_short_gaps(world_from_cam, timeline, 3)
        assert np.flatnonzero(interpolated).tolist() == [4]
        assert np.isnan(filled[[0, 8, 15, 19]]).all()
    # A cut beside a gap isn't in it, but nothing beyond it counts.
    filled, interpolated = fill_short_gaps(
        world_from_cam, Timeline(np.arange(20), np.array([13, 16])), 3
    )
    assert np.flatnonzero(interpolated).tolist() == [4, 15]
    middle = (true[14, :3, 3] + true[16, :3, 3]) / 2
    assert filled[15, :3, 3] == pytest.approx(middle, abs=1e-12)
    nothing, none = fill_short_gaps(world_from_cam, Timeline(np.arange(20), NO_CUTS), 0)
    assert not none.any() and np.array_equal(nothing, world_from_cam, equal_nan=True)


def test_left_out_images_count_in_the_gap_and_in_time() -> None:
    numbers = np.array([0, 1, 2, 3, 6, 7, 8, 9, 10])
    true = cubic_path(numbers.astype(np.float64))
    world_from_cam, _ = lost(true, [4])
    timeline = Timeline(numbers, NO_CUTS)
    assert not fill_short_gaps(world_from_cam, timeline, 2)[1].any()
    filled, interpolated = fill_short_gaps(world_from_cam, timeline, 3)
    assert np.flatnonzero(interpolated).tolist() == [4]
    assert filled == pytest.approx(true, abs=1e-9)


@given(
    st.lists(st.booleans(), min_size=0, max_size=30),
    st.sets(st.integers(0, 29), max_size=4),
    st.integers(0, 6),
)
def test_any_gaps_are_filled_with_rigid_cameras(
    placed: list[bool], cuts: set[int], max_gap: int
) -> None:
    has_camera = np.array(placed, dtype=bool)
    world_from_cam, _ = lost(
        cubic_path(np.arange(float(len(placed)))), np.flatnonzero(~has_camera).tolist()
    )
    timeline = Timeline(np.arange(len(placed)), np.array(sorted(cuts), dtype=np.int64))
    filled, interpolated = fill_short_gaps(world_from_cam, timeline, max_gap)
    there = has_camera | interpolated
    assert not (has_camera & interpolated).any()
    assert np.isfinite(filled[there]).all() and np.isnan(filled[~there]).all()
    rotmats = filled[there, :3, :3]
    assert np.allclose(rotmats @ np.swapaxes(rotmats, 1, 2), np.eye(3), atol=1e-9)
    for row in np.flatnonzero(interpolated):
        before = np.flatnonzero(has_camera[:row])[-1]
        after = row + np.flatnonzero(has_camera[row:])[0]
        assert after - before - 1 <= max_gap and not cuts & set(range(before, after))


def test_frames_that_cannot_be_placed_are_interpolated_and_marked(
    film: Callable[[str, int], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    filmed = film("dolly", 24)
    config = SfmConfig(max_features=1200, keyframe_step=0.1, min_keyframes=3)
    # No frame between keyframes sees so many points.
    monkeypatch.setattr(models, "MIN_PNP_INLIERS", 10**6)
    solve_keyframes_once(monkeypatch)
    folders = [
        filmed.solved(
            tmp_path / str(gap),
            config.model_copy(update={"max_gap_frames": gap}),
        )
        for gap in (0, 12)
    ]
    (bare, filled), (before, after) = map(load_cameras, folders), map(load_quality, folders)
    keys = np.isin(np.arange(24), before.keyframes)
    assert 3 <= keys.sum() <= 14
    assert np.array_equal(bare.path.has_camera, keys) and not bare.interpolated.any()
    assert before.interpolated == ()
    assert filled.path.has_camera.all() and np.array_equal(filled.interpolated, ~keys)
    assert after.interpolated == tuple(np.flatnonzero(~keys))
    # The figures are about what was found.
    assert before.frames_with_camera == after.frames_with_camera == keys.sum()
    assert not np.array(after.inliers_per_frame)[~keys].any()
    assert filmed.centre_errors_m(filled.path.centres_world_m).max() < 0.015


def test_marks_are_kept(tmp_path: Path) -> None:
    marks = np.array([False, True, False])
    cameras = CameraPath(np.eye(3), 4, 3, np.tile(np.eye(4), (3, 1, 1)), np.ones(3, dtype=bool))
    save_cameras(tmp_path / "cameras.npz", SfmCameras(cameras, "full", np.arange(3), marks))
    assert load_cameras(tmp_path).interpolated.tolist() == marks.tolist()
