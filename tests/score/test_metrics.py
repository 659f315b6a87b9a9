"""Metrics in the world and in the camera's frame, worked out by hand."""

from typing import Any

import numpy as np
import pytest
from evo.core.geometry import umeyama_alignment
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.score import metrics
from gmrdata.score.metrics import (
    foot_sliding_mm,
    jitter_10m_per_s3,
    root_errors_percent,
    root_orientation_errors_deg,
    root_velocity_errors_mm_per_frame,
    segment_errors_mm,
    segments_of,
)
from gmrdata.values.motion import deltas
from gmrdata.values.motion_metrics import translation_errors_mm
from gmrdata.values.transforms import fit_similarities, fit_similarity

BODY_M = np.array([[0.0, 0.0, 0.9], [0.1, 0.0, 0.5], [-0.1, 0.1, 0.0], [0.0, 0.2, 1.6]])
seeds = st.integers(0, 2**31 - 1)


def walk_m(n_frames: int, step_m: float = 1.0) -> np.ndarray:
    """A straight walk along x: root places (n, 3)."""
    return np.arange(n_frames)[:, None] * np.array([step_m, 0.0, 0.0])


def bodies_m(n_frames: int) -> np.ndarray:
    """The same pose at each place of a walk, (n, 4, 3)."""
    return BODY_M + walk_m(n_frames, 0.03)[:, None]


def aligned_mm(predicted_m: np.ndarray, true_m: np.ndarray, **changes: Any) -> np.ndarray:
    options: dict[str, Any] = {"first_frames": 2, "scale": True}
    (errors_mm,) = segment_errors_mm(predicted_m, true_m, [(0, len(true_m))], **(options | changes))
    return errors_mm


@pytest.mark.parametrize(
    ("remainder", "n_frames", "expected"),
    [
        ("own_segment", 250, [(0, 100), (100, 200), (200, 250)]),
        ("own_segment", 200, [(0, 100), (100, 200)]),
        ("own_segment", 201, [(0, 100), (100, 200), (200, 201)]),
        ("own_segment", 40, [(0, 40)]),
        ("joined_but_last_frame", 250, [(0, 100), (100, 249)]),
        ("joined_but_last_frame", 201, [(0, 100), (100, 200)]),
        ("joined_but_last_frame", 200, [(0, 100)]),
        ("joined_but_last_frame", 199, [(0, 198)]),
        ("joined_but_last_frame", 101, [(0, 100)]),
        ("joined_but_last_frame", 100, []),
        ("joined", 250, [(0, 100), (100, 250)]),
        ("joined", 300, [(0, 100), (100, 300)]),
        ("joined", 101, [(0, 101)]),
        ("joined", 100, []),
        ("joined", 0, []),
    ],
)
def test_segments(remainder, n_frames, expected):
    """As the loops of the released code cut them."""
    assert segments_of(n_frames, 100, remainder) == expected


def test_another_world_and_scale_is_no_error_of_mpjpe():
    true_m = bodies_m(6)
    turn = Rotation.from_euler("xyz", [10, 20, 130], degrees=True).as_matrix()
    moved_m = 1.01 * true_m @ turn.T + [3.0, -2.0, 1.0]
    for first_frames in (2, None):
        np.testing.assert_allclose(
            aligned_mm(moved_m, true_m, first_frames=first_frames), 0, atol=1e-9
        )
    # With the scale fixed, what is 1 % too large shows.
    assert aligned_mm(moved_m, true_m, scale=False).max() > 1


def test_w_mpjpe_shows_drift_after_the_first_two_frames():
    """Frame 2 is off by (30, 40, 0) mm, frame 3 by twice that."""
    true_m = bodies_m(4)
    predicted_m = true_m.copy()
    predicted_m[2] += [0.03, 0.04, 0.0]
    predicted_m[3] += [0.06, 0.08, 0.0]
    np.testing.assert_allclose(aligned_mm(predicted_m, true_m), [0, 0, 50, 100], atol=1e-9)
    # One joint of four is 20 mm off: the mean is 5 mm.
    predicted_m = true_m.copy()
    predicted_m[3, 1, 2] += 0.02
    np.testing.assert_allclose(aligned_mm(predicted_m, true_m), [0, 0, 0, 5], atol=1e-9)
    # Aligned as a whole, the error is spread.
    whole_mm = aligned_mm(predicted_m, true_m, first_frames=None)
    assert (whole_mm > 0).all() and whole_mm.mean() < 5


@settings(max_examples=25)
@given(seeds)
def test_alignment_is_evos(seed):
    rng = np.random.default_rng(seed)
    true_m, predicted_m = rng.normal(0, 1, (2, 5, 4, 3))
    for first_frames, scale in ((2, True), (None, True), (2, False)):
        n = first_frames or 5
        turn, offset_m, size = umeyama_alignment(
            predicted_m[:n].reshape(-1, 3).T, true_m[:n].reshape(-1, 3).T, with_scale=scale
        )
        moved_m = size * predicted_m @ turn.T + offset_m
        expected_mm = 1000 * np.linalg.norm(moved_m - true_m, axis=-1).mean(-1)
        found_mm = aligned_mm(predicted_m, true_m, first_frames=first_frames, scale=scale)
        np.testing.assert_allclose(found_mm, expected_mm, rtol=1e-9)


def test_rte_of_a_straight_walk_with_one_percent_of_scale_error():
    """4 m long; aligned at its middle, the ends are 20 mm off: 0.5 % of the length."""
    true_m = walk_m(5)
    found = root_errors_percent(1.01 * true_m + [7.0, 8.0, 9.0], true_m, [(0, 5)])
    np.testing.assert_allclose(found, [0.5, 0.25, 0, 0.25, 0.5], atol=1e-9)
    assert found.mean() == pytest.approx(0.3)


def test_rte_of_a_path_without_length_is_not_defined():
    """Nor is one of what rounding leaves of a place: an error of 2 m was 1e17 % of its length."""
    rounded_m = 3 + 1e-15 * walk_m(5)
    assert 0 < np.ptp(rounded_m) < 1e-14
    for true_m in (np.zeros((5, 3)), rounded_m):
        assert root_errors_percent(walk_m(5), true_m, [(0, 5)]).shape == (0,)


def test_a_jump_over_a_gap_is_no_part_of_the_path():
    true_m = walk_m(6)
    true_m[3:, 0] += 100.0
    found = root_errors_percent(true_m + np.array([0, 0, 1.0]), true_m, [(0, 3), (3, 6)])
    np.testing.assert_allclose(found, 0, atol=1e-9)
    off_m = true_m.copy()
    off_m[:, 1] += [0.04, -0.04, 0.0, 0.0, -0.04, 0.04]
    # Two steps on either side of the gap: a path of 4 m, so 40 mm are about 1 %.
    found = root_errors_percent(off_m, true_m, [(0, 3), (3, 6)])
    assert found.max() == pytest.approx(1.0, abs=0.01)


def test_roe_begins_at_zero_and_shows_what_comes_after():
    true = Rotation.from_euler("z", [[0], [10], [20]], degrees=True).as_matrix()
    predicted = Rotation.from_euler("z", [[50], [61], [67]], degrees=True).as_matrix()
    found = root_orientation_errors_deg(predicted, true)
    np.testing.assert_allclose(found, [0, 1, 3], atol=1e-6)


@settings(max_examples=25)
@given(seeds)
def test_erve_is_tme(seed):
    rng = np.random.default_rng(seed)
    rotmats = Rotation.random(8, random_state=seed).as_matrix().reshape(2, 4, 3, 3)
    places_m = rng.normal(0, 1, (2, 4, 3))
    found = root_velocity_errors_mm_per_frame(
        rotmats[0], places_m[0], rotmats[1], places_m[1], [(0, 4)]
    )
    (_, predicted_m), (_, true_m) = (deltas(rotmats[i], places_m[i]) for i in (0, 1))
    np.testing.assert_allclose(found, translation_errors_mm(predicted_m, true_m), rtol=1e-9)


def test_erve_of_a_walk_that_is_too_fast():
    """Steps of 31 in place of 30 mm, in a world that is turned by 90 degrees."""
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    turns, still = np.tile(turn, (4, 1, 1)), np.tile(np.eye(3), (4, 1, 1))
    found = root_velocity_errors_mm_per_frame(
        turns, walk_m(4, 0.031) @ turn.T, still, walk_m(4, 0.03), [(0, 4)]
    )
    np.testing.assert_allclose(found, 1.0, atol=1e-9)


@pytest.mark.parametrize("fps_hz", [10.0, 30.0])
def test_jitter_of_a_cubic_is_its_third_derivative(fps_hz):
    """x = 5 t^3 m has a jerk of 30 m/s^3, whatever the rate; one of two joints stands still."""
    times_s = np.arange(7) / fps_hz
    joints_m = np.zeros((7, 2, 3))
    joints_m[:, 0, 0] = 5 * times_s**3
    found = jitter_10m_per_s3(joints_m, fps_hz, [(0, 7)])
    assert found.shape == (4,)
    np.testing.assert_allclose(found, 30 / 2 / 10, rtol=1e-9)


def test_feet_slide_only_where_the_true_ones_stand():
    """The true foot stands, takes a step of 20 mm, stands; the predicted one slides 3 mm a frame.

    A true step of 9.9 mm still counts as standing, one of 10 mm does not.
    """
    true_x_m = np.array([0.0, 0.0, 0.02, 0.02, 0.0299, 0.0399 + 1e-9])
    feet_m = np.zeros((6, 1, 3))
    feet_m[:, 0, 0] = true_x_m
    predicted_m = np.zeros((6, 1, 3))
    predicted_m[:, 0, 1] = 0.003 * np.arange(6)
    found = foot_sliding_mm(predicted_m, feet_m, [(0, 6)], contact_m=0.01)
    np.testing.assert_allclose(found, [3, 3, 3], rtol=1e-9)
    found = foot_sliding_mm(predicted_m, feet_m, [(0, 6)], contact_m=0.03)
    np.testing.assert_allclose(found, [3] * 5, rtol=1e-9)


def test_nothing_is_differentiated_over_a_gap():
    """The second half is 100 m away and turned round, in truth and prediction alike."""
    rng = np.random.default_rng(0)
    joints_m = rng.normal(0, 1, (12, 3, 3))
    far_m = joints_m.copy()
    far_m[6:] += 100.0
    runs = [(0, 6), (6, 12)]
    np.testing.assert_allclose(
        jitter_10m_per_s3(far_m, 30.0, runs), jitter_10m_per_s3(joints_m, 30.0, runs), rtol=1e-7
    )
    assert len(jitter_10m_per_s3(far_m, 30.0, runs)) == 3 + 3
    feet_m = np.zeros((12, 2, 3))
    slid = foot_sliding_mm(far_m[:, :2], feet_m, runs, 0.01)
    assert len(slid) == 2 * (5 + 5) and slid.max() < 20_000
    rotmats = np.tile(np.eye(3), (12, 1, 1))
    found = root_velocity_errors_mm_per_frame(rotmats, far_m[:, 0], rotmats, joints_m[:, 0], runs)
    np.testing.assert_allclose(found, 0, atol=1e-8)
    assert len(found) == 5 + 5


@settings(max_examples=25)
@given(seeds)
def test_a_rigid_move_of_a_world_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    true_m, predicted_m = rng.normal(0, 1, (2, 9, 5, 3))
    rotmats = Rotation.random(18, random_state=seed).as_matrix().reshape(2, 9, 3, 3)
    turn = Rotation.random(random_state=seed + 1).as_matrix()
    offset_m = rng.normal(0, 10, 3)
    runs = [(0, 4), (4, 9)]

    def all_of(joints_m: np.ndarray, roots: np.ndarray) -> list[np.ndarray]:
        return [
            *segment_errors_mm(joints_m, true_m, runs, first_frames=2, scale=True),
            *segment_errors_mm(joints_m, true_m, runs, first_frames=None, scale=False),
            root_errors_percent(joints_m[:, 0], true_m[:, 0], runs),
            root_orientation_errors_deg(roots, rotmats[1]),
            root_velocity_errors_mm_per_frame(
                roots, joints_m[:, 0], rotmats[1], true_m[:, 0], runs
            ),
            jitter_10m_per_s3(joints_m, 30.0, runs),
            foot_sliding_mm(joints_m[:, :2], true_m[:, :2], runs, contact_m=2.0),
        ]

    moved = all_of(predicted_m @ turn.T + offset_m, turn @ rotmats[0])
    for before, after in zip(all_of(predicted_m, rotmats[0]), moved, strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6)


RNG = np.random.default_rng(3)
POINTS_M = RNG.normal(0, 0.4, (6, 24, 3))


def test_points_are_measured_from_the_hips():
    moved = POINTS_M + RNG.normal(0, 1, (6, 1, 3))
    moved[:, 5] += [0.0, 0.24, 0.0]
    from_hips = [one - metrics.hips_m(one, (1, 2)) for one in (moved, POINTS_M)]
    np.testing.assert_allclose(metrics.point_errors_mm(*from_hips), 240 / 24)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_many_similarities_are_those_of_one_set_each(seed):
    rng = np.random.default_rng(seed)
    a_m, b_m = rng.normal(0, 1, (2, 5, 7, 3))
    found = fit_similarities(a_m, b_m)
    for row in range(5):
        one = fit_similarity(a_m[row], b_m[row], scale=True)
        np.testing.assert_allclose(found.scales[row], one.scale, rtol=1e-9)
        np.testing.assert_allclose(found.rotmats[row], one.rotmat, atol=1e-9)
        np.testing.assert_allclose(found.apply(b_m)[row], one.apply(b_m[row]), atol=1e-9)


def test_a_similarity_of_each_frame_has_no_aligned_error():
    rotmats = Rotation.random(6, random_state=1).as_matrix()
    moved = (1.3 * POINTS_M) @ np.swapaxes(rotmats, 1, 2) + RNG.normal(0, 1, (6, 1, 3))
    best = fit_similarities(POINTS_M, moved)
    np.testing.assert_allclose(metrics.aligned_errors_mm(moved, POINTS_M, best), 0, atol=1e-9)
    np.testing.assert_allclose(best.scales, 1 / 1.3)


def test_angles_are_means_over_joints():
    """One of four joints is turned by 60 degrees."""
    true = Rotation.random(8, random_state=2).as_matrix().reshape(2, 4, 3, 3)
    turned = true.copy()
    turned[:, 1] = Rotation.from_euler("y", 60, degrees=True).as_matrix() @ true[:, 1]
    np.testing.assert_allclose(metrics.joint_angle_errors_deg(turned, true), 15)


def test_accelerations_of_a_parabola_and_over_gaps():
    """x = t^2 of one of two joints: 2 m per frame^2, half of it in the mean."""
    places_m = np.zeros((10, 2, 3))
    places_m[:, 0, 0] = np.arange(10.0) ** 2
    still = np.zeros_like(places_m)
    np.testing.assert_allclose(metrics.accelerations(places_m, [(0, 10)]), [1.0] * 8)
    places_m[6:] += 50.0  # a jump between two runs
    runs = [(0, 6), (6, 10)]
    found = metrics.accelerations(places_m, runs)
    np.testing.assert_allclose(found, [1.0] * 6)
    assert len(metrics.accelerations(places_m, runs, trim=1)) == 2
    # The length over joints of the differences of lengths, not their mean.
    np.testing.assert_allclose(metrics.acceleration_length_errors(places_m, still, runs), [2.0] * 6)


@pytest.mark.parametrize(("scale", "expected"), [(True, 0.0), (False, 0.1)])
def test_a_camera_path_that_is_too_long(scale, expected):
    """Places at -1, 0 and 1 m that are predicted 15 % too far apart: 0.15, 0 and 0.15 m."""
    true_m = np.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    found = metrics.path_error_m(1.15 * true_m + 3.0, true_m, scale=scale)
    assert found == pytest.approx(expected, abs=1e-12)
