"""The pinhole projection against OpenCV's and COLMAP's, and the lens at any size, bent or not."""

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values.camera import (
    ASSUMED,
    CameraPath,
    Lens,
    Origin,
    bent,
    intrinsics_from_fov,
    project,
    project_cam,
    straightened,
)
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


BENT = Lens((600.0, 605.0), (322.0, 239.0), (640, 480), (-0.15, 0.02))
SEEN_PX = np.array([[10.0, 20.0], [630.0, 470.0], [322.0, 239.0]])


def test_a_lens_is_its_matrix():
    assert np.array_equal(BENT.matrix_px, [[600, 0, 322], [0, 605, 239], [0, 0, 1]])
    assert Lens.of_matrix(BENT.matrix_px, (640, 480), BENT.radial) == BENT
    for matrix in (np.eye(3) + np.eye(3, k=1), np.full((3, 3), np.nan), 2 * np.eye(3)):
        with pytest.raises(ValueError, match="no matrix"):
            Lens.of_matrix(matrix, (640, 480))


def test_a_lens_that_is_assumed_looks_through_the_middle():
    lens = Lens.centred(500.0, (640, 480), Origin("metadata", 0.05))
    assert (lens.focal_px, lens.centre_px, lens.is_pinhole) == ((500, 500), (320, 240), True)
    assert lens.centre_from == lens.radial_from == ASSUMED and lens.focal_from.sigma == 0.05


def test_pixels_scale_with_the_picture():
    half = BENT.at_size((320, 240))
    assert half == Lens((300, 302.5), (161, 119.5), (320, 240), BENT.radial)
    assert np.allclose(half.rays(SEEN_PX / 2), BENT.rays(SEEN_PX))
    assert half.corner_radius == BENT.corner_radius


def test_what_is_seen_goes_to_a_pinhole_and_back():
    straight_px = BENT.pinhole_px(SEEN_PX)
    assert np.allclose(BENT.seen_px(straight_px), SEEN_PX)
    assert straight_px[0, 0] < 0 and np.array_equal(straight_px[2], SEEN_PX[2])
    rays = np.c_[BENT.rays(SEEN_PX), np.ones(3)]
    terms = np.array([*BENT.radial, 0.0, 0.0])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), BENT.matrix_px, terms)
    assert np.allclose(expected[:, 0], SEEN_PX)
    pinhole = Lens.of_matrix(BENT.matrix_px, BENT.size_px)
    assert np.array_equal(pinhole.seen_px(SEEN_PX), SEEN_PX)
    assert np.array_equal(pinhole.pinhole_px(SEEN_PX), SEEN_PX)


@pytest.mark.parametrize("k1", [-0.4, -0.1, 0.0, 0.3])
@pytest.mark.parametrize("k2", [-0.1, 0.0, 0.06])
def test_a_lens_bends_as_opencv_says_and_back(k1, k2):
    r = np.linspace(0.0, 1.4, 80)
    r = r[np.cumprod(1 + 3 * k1 * r**2 + 5 * k2 * r**4 > 0.1).astype(bool)]  # up to the fold
    straight = np.stack([0.8 * r, -0.6 * r], axis=1)
    seen = bent(straight, k1, k2)
    points = np.c_[straight, np.ones(len(r))]
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.eye(3), np.array([k1, k2, 0.0, 0.0])
    )
    np.testing.assert_allclose(seen, expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(straightened(seen, k1, k2), straight, atol=1e-7)


@pytest.mark.parametrize(("k1", "k2"), [(-0.3, 0.0), (-0.2, 0.01), (0.3, -0.1), (0.0, -0.1)])
def test_what_a_folding_lens_cannot_show_is_put_on_its_edge(k1, k2):
    r = np.linspace(0.5, 3.0, 10_000)
    shown = r + k1 * r**3 + k2 * r**5
    straight = straightened(np.array([[1.01 * shown.max(), 0.0], [0.0, 50.0]]), k1, k2)
    assert np.linalg.norm(straight, axis=1) == pytest.approx(r[shown.argmax()], abs=1e-3)
