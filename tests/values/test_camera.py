"""The pinhole projection against OpenCV's and COLMAP's."""

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project, project_cam
from gmrdata.values.transforms import invert, rigid

INTRINSICS_PX = np.array([[612.5, 0.0, 301.25], [0.0, 598.0, 187.75], [0.0, 0.0, 1.0]])


@given(st.integers(0, 2**32 - 1))
def test_project_agrees_with_opencv(seed):
    rng = np.random.default_rng(seed)
    world_from_cam = rigid(Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 3, 3))
    points_cam_m = rng.uniform([-2, -2, 0.5], [2, 2, 9], (20, 3))
    points_world_m = points_cam_m @ world_from_cam[:3, :3].T + world_from_cam[:3, 3]
    cam_from_world = invert(world_from_cam)
    rotvec = Rotation.from_matrix(cam_from_world[:3, :3]).as_rotvec()
    expected_px, _ = cv2.projectPoints(
        points_world_m, rotvec, cam_from_world[:3, 3], INTRINSICS_PX, None
    )
    actual_px = project(world_from_cam, points_world_m, INTRINSICS_PX)
    np.testing.assert_allclose(actual_px, expected_px[:, 0], atol=1e-6)


def test_pixel_convention_is_colmaps():
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 500.0, 640, 360)
    calibration = camera.calibration_matrix()
    np.testing.assert_array_equal(calibration[:2, 2], [320.0, 180.0])  # no half pixel taken off
    own = intrinsics_from_fov(2 * np.rad2deg(np.arctan(320 / 500)), 640, 360)
    np.testing.assert_allclose(own, calibration, atol=1e-9)
    points_cam_m = np.array([[0.0, 0.0, 2.0], [0.4, -0.3, 1.5], [-1.0, 0.7, 4.0]])
    expected_px = np.array([camera.img_from_cam(p) for p in points_cam_m]).reshape(-1, 2)
    np.testing.assert_allclose(project_cam(points_cam_m, own), expected_px, atol=1e-9)


def test_points_behind_the_camera_are_nan():
    points_px = project_cam(np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0], [0, 0, 1]]), INTRINSICS_PX)
    assert np.isnan(points_px[:2]).all()
    np.testing.assert_allclose(points_px[2], INTRINSICS_PX[:2, 2])


@pytest.mark.parametrize("hfov_deg", [20.0, 60.0, 110.0])
def test_fov_spans_the_width(hfov_deg):
    intrinsics_px = intrinsics_from_fov(hfov_deg, 640, 360)
    half_rad = np.deg2rad(hfov_deg) / 2
    edges = np.array(
        [[-np.sin(half_rad), 0, np.cos(half_rad)], [np.sin(half_rad), 0, np.cos(half_rad)]]
    )
    np.testing.assert_allclose(
        project_cam(edges, intrinsics_px), [[0.0, 180.0], [640.0, 180.0]], atol=1e-9
    )


def test_centres_are_the_translations():
    world_from_cam = rigid(np.eye(3), np.arange(6.0).reshape(2, 3))
    camera = CameraPath(INTRINSICS_PX, 640, 360, world_from_cam, np.ones(2, dtype=bool))
    assert camera.n_frames == 2
    np.testing.assert_array_equal(camera.centres_world_m, [[0, 1, 2], [3, 4, 5]])
