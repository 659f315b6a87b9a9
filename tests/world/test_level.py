"""Levelling: z up, ground at zero."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.world.compose import ground_normal, level_from_world

UP = np.array([0.0, 0.0, 1.0])


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def leaning(degrees: float) -> np.ndarray:
    return np.asarray(Rotation.from_euler("x", degrees, degrees=True).apply(UP))


def test_without_feet_the_body_says_where_up_is() -> None:
    assert np.array_equal(ground_normal(np.zeros((0, 3)), UP), UP)


def test_feet_all_round_correct_a_leaning_body() -> None:
    rng = np.random.default_rng(0)
    feet_m = np.column_stack([rng.uniform(-2, 2, (60, 2)), rng.normal(0, 0.005, 60)])
    assert angle_deg(ground_normal(feet_m, leaning(6.0)), UP) < 0.3


def test_feet_along_a_line_correct_the_tilt_along_it_only() -> None:
    line_m = np.column_stack([np.zeros(30), np.linspace(0, 4, 30), np.zeros(30)])
    assert angle_deg(ground_normal(line_m, leaning(6.0)), UP) < 0.1
    across_m = line_m[:, [1, 0, 2]]
    assert angle_deg(ground_normal(across_m, leaning(6.0)), leaning(6.0)) < 0.1


def test_feet_on_stairs_are_not_taken_for_a_plane() -> None:
    rng = np.random.default_rng(0)
    jumps_m = np.column_stack([rng.uniform(-1, 1, (40, 2)), rng.choice([0.0, 0.5], 40)])
    assert np.array_equal(ground_normal(jumps_m, leaning(3.0)), leaning(3.0))


@given(st.integers(0, 10**6))
def test_any_world_becomes_level(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix()
    shift_m = rng.normal(0, 10, 3)
    turns = Rotation.from_rotvec(rng.uniform(0, 6, (20, 1)) * UP).as_matrix()
    upright = turns @ Rotation.from_euler("x", 90, degrees=True).as_matrix()
    pelvis_m = np.column_stack([rng.uniform(-2, 2, (20, 2)), np.full(20, 0.9)])
    feet_m = pelvis_m - [0, 0, 0.9]
    forward = np.array([0.6, -0.7, -0.2])
    level = level_from_world(
        world @ upright, pelvis_m @ world.T + shift_m, feet_m @ world.T + shift_m, world @ forward
    )
    pelvis_level_m = (pelvis_m @ world.T + shift_m) @ level[:3, :3].T + level[:3, 3]
    assert pelvis_level_m[0] == pytest.approx([0, 0, 0.9], abs=1e-9)
    assert pelvis_level_m[:, 2] == pytest.approx(0.9, abs=1e-9)
    seen = level[:3, :3] @ world @ forward
    assert seen[0] == pytest.approx(0, abs=1e-9) and seen[1] > 0
    assert np.linalg.det(level[:3, :3]) == pytest.approx(1.0)


def test_a_camera_that_looks_straight_down_is_no_problem() -> None:
    upright = Rotation.from_euler("x", 90, degrees=True).as_matrix()[None]
    level = level_from_world(upright, np.array([[0, 0, 1.0]]), np.zeros((0, 3)), -UP)
    assert np.allclose(level[:3, :3] @ level[:3, :3].T, np.eye(3), atol=1e-12)
