"""Pointing and following."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.film.camera_moves import look_at, smooth_path
from gmrdata.values.camera import intrinsics_from_fov, project
from gmrdata.values.errors import BadRecipe
from gmrdata.values.transforms import rigid


@given(st.integers(0, 2**32 - 1))
def test_the_target_is_in_the_middle_and_the_horizon_level(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres, targets = rng.normal(0, 3, (6, 3)), rng.normal(8, 2, (6, 3))
    rotmats = look_at(centres, targets)
    np.testing.assert_allclose(
        rotmats @ np.swapaxes(rotmats, -1, -2), np.tile(np.eye(3), (6, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotmats), 1.0, atol=1e-12)
    intrinsics_px = intrinsics_from_fov(60, 640, 360)
    world_from_cam = rigid(rotmats, centres)
    middle_px = project(world_from_cam, targets[:, None], intrinsics_px)[:, 0]
    np.testing.assert_allclose(middle_px, np.tile([320.0, 180.0], (6, 1)), atol=1e-6)
    assert np.all(np.abs(rotmats[:, 2, 0]) < 1e-12)  # the picture's x axis is horizontal
    assert np.all(rotmats[:, 2, 1] < 0)  # the picture's y axis points down


def test_what_is_higher_in_the_world_is_higher_in_the_picture() -> None:
    centre_m = np.array([0.0, -4, 1])
    world_from_cam = rigid(look_at(centre_m, np.array([0.0, 0, 1])), centre_m)
    points_m = np.array([[0.0, 0, 1.5], [0.5, 0, 1.0]])
    above_px, right_px = project(world_from_cam, points_m, intrinsics_from_fov(60, 640, 360))
    assert above_px[1] < 180 and right_px[0] > 320


@pytest.mark.parametrize("target", [(0, 0, 0), (0, 0, 5), (0, 0, 2)])
def test_straight_down_up_and_inside_are_refused(target: tuple[float, float, float]) -> None:
    with pytest.raises(BadRecipe, match="straight up or down"):
        look_at(np.array([0.0, 0, 2]), np.array(target, dtype=float))


def test_following_keeps_constant_speed_and_is_late_by_the_lag() -> None:
    fps_hz, lag_s = 30.0, 0.2
    line = np.arange(200)[:, None] / fps_hz * np.array([1.2, -0.4, 0.0])
    late = smooth_path(line, fps_hz, 0.3, lag_s)
    inside = slice(60, 140)  # away from the ends, where a Gaussian of constant speed is itself
    np.testing.assert_allclose(
        (line - late)[inside], np.tile([1.2 * lag_s, -0.4 * lag_s, 0], (80, 1)), atol=1e-4
    )


def test_following_takes_the_bobbing_out() -> None:
    time_s = np.arange(100) / 10
    bob = np.stack([0 * time_s, 0 * time_s, 0.9 + 0.03 * np.sin(2 * np.pi * 2 * time_s)], axis=-1)
    assert np.ptp(smooth_path(bob, 10.0, 0.35, 0.1)[10:-10, 2]) < 0.002
