"""The translation of one frame from 2D joints: exact, noisy, with outliers, and not at all."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.paper.placement import PlacementConfig, closed_form, place
from gmrdata.read.openpose import PAIRS
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import intrinsics_from_fov, project_cam

INTRINSICS_PX = intrinsics_from_fov(60.0, 640, 480)
CONFIG = PlacementConfig()


def seen(
    body: BodyModel, seed: int, noise_px: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints from the pelvis [m], their points with confidences, and where the pelvis is [m]."""
    rng = np.random.default_rng(seed)
    joints_m = body.rest_joints_m(rng.normal(0, 1, body.n_shape))
    joints_m = (joints_m - joints_m[0]) @ Rotation.random(
        random_state=rng.integers(9999)
    ).as_matrix()
    pelvis_m = rng.uniform([-1.0, -0.7, 2.5], [1.0, 0.7, 8.0])
    points = np.zeros((24, 3))
    joints = list(PAIRS.values())
    points[joints, :2] = project_cam(joints_m[joints] + pelvis_m, INTRINSICS_PX)
    points[joints, :2] += rng.normal(0, noise_px, (len(joints), 2))
    points[joints, 2] = rng.uniform(0.4, 1.0, len(joints))
    return joints_m, points, pelvis_m


@given(st.integers(0, 10**6))
def test_exact_points_give_the_exact_place(small_body: BodyModel, seed: int) -> None:
    joints_m, points, pelvis_m = seen(small_body, seed)
    found_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    np.testing.assert_allclose(found_m, pelvis_m, atol=1e-6)


@given(st.integers(0, 10**6))
def test_the_closed_form_is_exact_for_exact_points(small_body: BodyModel, seed: int) -> None:
    joints_m, points, pelvis_m = seen(small_body, seed)
    joints = list(PAIRS.values())
    found_m = closed_form(joints_m[joints], points[joints, :2], points[joints, 2], INTRINSICS_PX)
    np.testing.assert_allclose(found_m, pelvis_m, atol=1e-6)


def by_differences(
    joints_m: np.ndarray, points: np.ndarray, start_m: np.ndarray, robust_px: float
) -> np.ndarray:
    """What scipy finds without the Jacobian, started from the true place."""
    joints = list(PAIRS.values())

    def residuals(place_m: np.ndarray) -> np.ndarray:
        image_px = project_cam(joints_m[joints] + place_m, INTRINSICS_PX)
        return (np.sqrt(points[joints, 2:]) * (image_px - points[joints, :2])).ravel()

    found = least_squares(
        residuals, start_m, loss="huber", f_scale=robust_px, ftol=1e-12, xtol=1e-12, gtol=1e-12
    )
    return np.asarray(found.x)


@pytest.mark.parametrize("seed", range(5))
def test_noisy_points_give_the_least_reprojection_error(small_body: BodyModel, seed: int) -> None:
    joints_m, points, pelvis_m = seen(small_body, seed, noise_px=2.0)
    found_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    expected_m = by_differences(joints_m, points, pelvis_m, CONFIG.robust_px)
    np.testing.assert_allclose(found_m, expected_m, atol=1e-4)
    assert found_m is not None and np.linalg.norm(found_m - pelvis_m) < 0.4


def test_where_it_starts_does_not_matter(small_body: BodyModel) -> None:
    joints_m, points, _ = seen(small_body, 3, noise_px=2.0)
    alone_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    for previous_m in ([0.0, 0.0, 3.0], [2.0, 0.0, 20.0], [0.0, 0.0, -50.0]):
        found_m = place(joints_m, points, INTRINSICS_PX, CONFIG, np.array(previous_m))
        np.testing.assert_allclose(found_m, alone_m, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_one_wild_joint_moves_it_less_than_without_huber(small_body: BodyModel, seed: int) -> None:
    """Though the closed form starts far off, it ends where a start from the true place does."""
    joints_m, points, pelvis_m = seen(small_body, seed)
    points[PAIRS[4], :2] += [300.0, -200.0]
    robust_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    expected_m = by_differences(joints_m, points, pelvis_m, CONFIG.robust_px)
    np.testing.assert_allclose(robust_m, expected_m, atol=1e-4)
    plain_m = place(joints_m, points, INTRINSICS_PX, PlacementConfig(robust_px=1e6))
    assert robust_m is not None and plain_m is not None
    errors_m = [np.linalg.norm(found_m - pelvis_m) for found_m in (robust_m, plain_m)]
    assert errors_m[0] < 0.25 * errors_m[1]


def test_too_few_joints_tell_nothing(small_body: BodyModel) -> None:
    joints_m, points, _ = seen(small_body, 2)
    points[list(PAIRS.values())[5:], 2] = 0.29
    assert place(joints_m, points, INTRINSICS_PX, CONFIG) is None
    at_hand = PlacementConfig(min_joints=5)
    assert place(joints_m, points, INTRINSICS_PX, at_hand) is not None


def test_nobody_is_placed_behind_the_camera(small_body: BodyModel) -> None:
    """A person turned inside out, at the place behind the camera, has the same image."""
    joints_m, points, pelvis_m = seen(small_body, 4)
    joints = list(PAIRS.values())
    behind_m = closed_form(-joints_m[joints], points[joints, :2], points[joints, 2], INTRINSICS_PX)
    np.testing.assert_allclose(behind_m, -pelvis_m, atol=1e-6)
    assert place(-joints_m, points, INTRINSICS_PX, CONFIG) is None
    found_m = place(-joints_m, points, INTRINSICS_PX, CONFIG, pelvis_m)
    assert found_m is not None and (found_m - joints_m)[joints, 2].min() > 0


def test_parallel_rays_have_no_closed_form() -> None:
    points_px = np.tile([320.0, 240.0], (6, 1))
    joints_m = np.random.default_rng(0).normal(0, 0.3, (6, 3))
    assert closed_form(joints_m, points_px, np.ones(6), INTRINSICS_PX) is None
