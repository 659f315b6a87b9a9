"""Errors in the camera's frame, by hand-computed figures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.score import metrics
from gmrdata.values.transforms import fit_similarities, fit_similarity

RNG = np.random.default_rng(3)
POINTS_M = RNG.normal(0, 0.4, (6, 24, 3))


def test_points_are_measured_from_the_hips() -> None:
    moved = POINTS_M + RNG.normal(0, 1, (6, 1, 3))
    moved[:, 5] += [0.0, 0.24, 0.0]
    from_hips = [one - metrics.hips_m(one, (1, 2)) for one in (moved, POINTS_M)]
    np.testing.assert_allclose(metrics.point_errors_mm(*from_hips), 240 / 24)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_many_similarities_are_those_of_one_set_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a_m, b_m = rng.normal(0, 1, (2, 5, 7, 3))
    found = fit_similarities(a_m, b_m)
    for row in range(5):
        one = fit_similarity(a_m[row], b_m[row], scale=True)
        np.testing.assert_allclose(found.scales[row], one.scale, rtol=1e-9)
        np.testing.assert_allclose(found.rotmats[row], one.rotmat, atol=1e-9)
        np.testing.assert_allclose(found.apply(b_m)[row], one.apply(b_m[row]), atol=1e-9)


def test_a_similarity_of_each_frame_has_no_aligned_error() -> None:
    rotmats = Rotation.random(6, random_state=1).as_matrix()
    moved = (1.3 * POINTS_M) @ np.swapaxes(rotmats, 1, 2) + RNG.normal(0, 1, (6, 1, 3))
    best = fit_similarities(POINTS_M, moved)
    np.testing.assert_allclose(metrics.aligned_errors_mm(moved, POINTS_M, best), 0, atol=1e-9)
    np.testing.assert_allclose(best.scales, 1 / 1.3)


def test_angles_are_means_over_joints() -> None:
    """One of four joints is turned by 60 degrees."""
    true = Rotation.random(8, random_state=2).as_matrix().reshape(2, 4, 3, 3)
    turned = true.copy()
    turned[:, 1] = Rotation.from_euler("y", 60, degrees=True).as_matrix() @ true[:, 1]
    np.testing.assert_allclose(metrics.joint_angle_errors_deg(turned, true), 15)


def test_accelerations_of_a_parabola_and_over_gaps() -> None:
    """x = t^2 of one of two joints: 2 m per frame^2, half of it in the mean."""
    places_m = np.zeros((10, 2, 3))
    places_m[:, 0, 0] = np.arange(10.0) ** 2
    still = np.zeros_like(places_m)
    np.testing.assert_allclose(metrics.accelerations(places_m, [(0, 10)]), [1.0] * 8)
    places_m[6:] += 50.0  # a jump between two runs
    runs = [(0, 6), (6, 10)]
    found = metrics.acceleration_errors(places_m, still, runs)
    np.testing.assert_allclose(found, [1.0] * 6)
    assert len(metrics.acceleration_errors(places_m, still, runs, trim=1)) == 2
    # The length over joints of the differences of lengths, not their mean.
    np.testing.assert_allclose(metrics.acceleration_length_errors(places_m, still, runs), [2.0] * 6)


@pytest.mark.parametrize(("scale", "expected"), [(True, 0.0), (False, 0.1)])
def test_a_camera_path_that_is_too_long(scale: bool, expected: float) -> None:
    """Places at -1, 0 and 1 m that are predicted 15 % too far apart: 0.15, 0 and 0.15 m."""
    true_m = np.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    found = metrics.path_error_m(1.15 * true_m + 3.0, true_m, scale=scale)
    assert found == pytest.approx(expected, abs=1e-12)
