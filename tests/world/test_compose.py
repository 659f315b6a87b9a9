"""Eqs. 6-8 and the pelvis."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values import transforms
from gmrdata.values.motion import Motion
from gmrdata.world.compose import metric_cameras, motion_in_camera, motion_in_world

# About where SMPL's rest pelvis is: 0.22 m below the model's origin.
REST_PELVIS_M = np.array([-0.002, -0.223, 0.028])


def random_motion(rng: np.random.Generator, n: int) -> Motion:
    return Motion(
        local_rotmats=Rotation.random(23 * n, random_state=rng.integers(1 << 30))
        .as_matrix()
        .reshape(n, 23, 3, 3),
        root_rotmats=Rotation.random(n, random_state=rng.integers(1 << 30)).as_matrix(),
        pelvis_m=rng.normal(0, 3, (n, 3)),
        shape=rng.normal(0, 1, 10),
        fps_hz=10.0,
        body="small",
        gender="neutral",
        frame="world",
        source="random",
    )


def random_cameras(rng: np.random.Generator, n: int) -> np.ndarray:
    rotmats = Rotation.random(n, random_state=rng.integers(1 << 30)).as_matrix()
    return transforms.rigid(rotmats, rng.normal(0, 5, (n, 3)))


@given(st.integers(0, 10**6), st.integers(2, 8), st.floats(0.01, 100))
def test_into_the_camera_and_back_is_the_same_motion(seed: int, n: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    motion, cameras = random_motion(rng, n), random_cameras(rng, n)
    person = motion_in_camera(motion, cameras)
    assert person.frame == "camera"
    again = motion_in_world(person, metric_cameras(cameras, 1 / scale), scale)
    assert again.frame == "world"
    assert np.abs(again.root_rotmats - motion.root_rotmats).max() < 1e-12
    assert np.abs(again.pelvis_m - motion.pelvis_m).max() < 1e-9
    assert again.local_rotmats is motion.local_rotmats


@given(st.integers(0, 10**6))
def test_eqs_7_and_8_are_taken_literally(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cameras = random_cameras(rng, 4)
    person = replace(random_motion(rng, 4), frame="camera")
    world = motion_in_world(person, cameras, 2.5)
    for i in range(4):
        r_col, t_col = cameras[i, :3, :3], cameras[i, :3, 3]
        assert np.allclose(world.root_rotmats[i], r_col @ person.root_rotmats[i], atol=1e-12)
        assert np.allclose(world.pelvis_m[i], r_col @ person.pelvis_m[i] + 2.5 * t_col, atol=1e-12)


def test_smpl_trans_in_place_of_the_pelvis_costs_11_8_mm_per_frame() -> None:
    """A camera that tilts at 30 degrees/s films a still person, at 10 fps."""
    n, fps_hz = 20, 10.0
    angles_rad = np.deg2rad(30.0) * np.arange(n) / fps_hz
    tilt = Rotation.from_rotvec(angles_rad[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    cameras = transforms.rigid(tilt, np.zeros(3))
    rng = np.random.default_rng(0)
    still = replace(
        random_motion(rng, n),
        root_rotmats=np.tile(Rotation.from_euler("x", 90, degrees=True).as_matrix(), (n, 1, 1)),
        pelvis_m=np.tile([0.3, 4.0, 0.9], (n, 1)),
    )
    person = motion_in_camera(still, cameras)
    exact = motion_in_world(person, cameras)
    assert np.linalg.norm(np.diff(exact.pelvis_m, axis=0), axis=1).max() < 1e-12
    naive = motion_in_world(replace(person, pelvis_m=person.pelvis_m - REST_PELVIS_M), cameras)
    errors_mm = 1000 * np.linalg.norm(np.diff(naive.pelvis_m, axis=0), axis=1)
    assert errors_mm == pytest.approx(11.8, abs=0.1)


def test_the_frame_of_reference_is_checked() -> None:
    rng = np.random.default_rng(0)
    motion, cameras = random_motion(rng, 3), random_cameras(rng, 3)
    with pytest.raises(ValueError, match="in the world frame, expected the camera frame"):
        motion_in_world(motion, cameras)
    with pytest.raises(ValueError, match="in the camera frame, expected the world frame"):
        motion_in_camera(motion_in_camera(motion, cameras), cameras)
    with pytest.raises(ValueError, match="3 frames of motion, 2 cameras"):
        motion_in_camera(motion, cameras[:2])
