"""The solver for a camera that only turns, on exact and noisy made-up matches."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cameras.map import rotation_only
from gmrdata.cameras.map.rotation_only import solve_rotation_only, weigh, zooms
from gmrdata.cameras.match.keyframes import relative_rotation, unit_rays
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values.camera import intrinsics_from_fov
from tests.filming import turn_errors_deg

INTRINSICS_PX = intrinsics_from_fov(60.0, 640, 360)


def turning_matches(
    world_from_cam: np.ndarray,
    noise_px: float,
    wrong_share: float,
    rng: np.random.Generator,
    n_points: int = 800,
) -> Matches:
    """Matches of far points between frames 1, 2 and 4 apart, some of them wrong."""
    n = len(world_from_cam)
    centre = world_from_cam[n // 2] @ [0.0, 0.0, 1.0]
    points = centre + rng.normal(0, 0.35, (n_points, 3))
    keypoints, visible = [], []
    for rotation in world_from_cam:
        seen = points @ rotation
        image = (seen / seen[:, 2:]) @ INTRINSICS_PX.T
        inside = (seen[:, 2] > 0.1) & (np.abs(image[:, :2] - [320, 180]) < [320, 180]).all(axis=1)
        visible.append(inside)
        keypoints.append(image[:, :2] + rng.normal(0, noise_px, (len(points), 2)))
    pairs = []
    for step in (1, 2, 4):
        for first in range(n - step):
            common = np.flatnonzero(visible[first] & visible[first + step])
            second = common.copy()
            wrong = rng.random(len(common)) < wrong_share
            second[wrong] = rng.permutation(second[wrong])
            features = np.stack([common, second], axis=1)
            pairs.append(PairMatches(first, first + step, features, "PANORAMIC"))
    return Matches(keypoints, sorted(pairs, key=lambda pair: (pair.first, pair.second)))


def panning_rotations(n: int) -> np.ndarray:
    turns = np.stack([0.1 * np.sin(np.arange(n)), np.linspace(-0.5, 0.5, n), 0.02 * np.ones(n)], 1)
    return Rotation.from_rotvec(turns).as_matrix()


@given(st.integers(0, 10**6))
@settings(max_examples=25)
def test_a_pair_of_views_gives_back_its_exact_rotation(seed):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
    rays = unit_rays(rng.uniform([0, 0], [640, 360], (60, 2)), INTRINSICS_PX)
    turned = rays @ rotation.T
    wrong = rng.choice(60, 20, replace=False)
    turned[wrong] = unit_rays(rng.uniform([0, 0], [640, 360], (20, 2)), INTRINSICS_PX)
    found, agree = relative_rotation(rays, turned, 1e-4, rng)
    assert np.abs(found - rotation).max() < 1e-9
    assert agree.sum() >= 40 and np.linalg.det(found) == pytest.approx(1.0)


def test_exact_matches_give_exact_rotations():
    true = panning_rotations(9)
    matches = turning_matches(true, 0.0, 0.0, np.random.default_rng(0))
    solution = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    assert solution.has_camera.all()
    assert turn_errors_deg(solution.world_from_cam_rotmats, true).max() < 5e-7
    assert solution.residuals_px.max() < 1e-6


def test_a_few_matches_at_once_give_the_same(monkeypatch):
    matches = turning_matches(panning_rotations(9), 0.5, 0.1, np.random.default_rng(0))
    whole = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    monkeypatch.setattr(rotation_only, "AT_ONCE", 300)
    few = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    np.testing.assert_array_equal(few.world_from_cam_rotmats, whole.world_from_cam_rotmats)
    np.testing.assert_array_equal(few.information.toarray(), whole.information.toarray())


def test_many_frames_of_a_camera_that_travels_are_given_up_early(monkeypatch):
    """Their turns never came to rest, and 31 steps took a tenth of the time of 10,000 frames."""
    monkeypatch.setattr(rotation_only, "MOST_MATCHES", 100)  # so that these are many
    steps, solve = [], rotation_only.cg

    def counted(*of, **how):
        steps.append(1)
        return solve(*of, **how)

    monkeypatch.setattr(rotation_only, "cg", counted)
    rng, true = np.random.default_rng(0), panning_rotations(9)
    turning = turning_matches(true, 0.5, 0.1, rng)
    travelling = replace(turning, keypoints_px=[px + rng.normal(0, 30, px.shape)
                                                for px in turning.keypoints_px])  # fmt: skip
    solve_rotation_only(travelling, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    assert len(steps) == rotation_only.FEW_ITERATIONS
    solution = solve_rotation_only(turning, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    assert len(steps) > 2 * rotation_only.FEW_ITERATIONS
    assert turn_errors_deg(solution.world_from_cam_rotmats, true).max() < 0.1


def test_a_long_video_is_solved_without_a_factor(monkeypatch):
    """7,600 keyframes, linked with those that look alike, took most of a minute a step."""
    true = np.concatenate([panning_rotations(9), panning_rotations(9)[::-1]] * 3)
    matches = turning_matches(true, 0.1, 0.1, np.random.default_rng(0))
    monkeypatch.setattr(rotation_only, "MOST_MATCHES", 100)  # so that these are many
    monkeypatch.setattr(rotation_only, "spsolve", None)
    solution = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    assert turn_errors_deg(solution.world_from_cam_rotmats, true).max() < 0.05


def test_noise_and_wrong_matches_are_averaged_out():
    true = panning_rotations(9)
    matches = turning_matches(true, 0.5, 0.2, np.random.default_rng(0))
    solution = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(1))
    assert turn_errors_deg(solution.world_from_cam_rotmats, true).max() < 0.03
    # 0.5 px in x and y of both images: a median of 0.5 * sqrt(2) * sqrt(2 ln 2) for right matches.
    right = solution.residuals_px[solution.residuals_px < 5]
    assert np.median(right) == pytest.approx(0.83, abs=0.1)
    assert (solution.pair_medians_px < 1.5).all()


def test_where_no_turn_fits_two_matches_it_explains_nothing():
    """A camera that goes far ahead between three frames of few matches ended in a traceback."""
    rng = np.random.default_rng(0)
    points, config = rng.uniform((-1.5, -1, 1), (1.5, 1, 3), (15, 3)), SfmConfig()
    steps = (points - [0, 0, 0.45 * i] for i in range(3))
    keypoints = [((seen / seen[:, 2:]) @ INTRINSICS_PX.T)[:, :2] for seen in steps]
    table = np.stack([np.arange(15)] * 2, axis=1)
    pairs = [PairMatches(*rows, table, "CALIBRATED") for rows in ((0, 1), (0, 2), (1, 2))]
    matches = Matches(keypoints, pairs, [15] * 3)
    solution = solve_rotation_only(matches, INTRINSICS_PX, 0.1, np.random.default_rng(0))
    assert weigh(solution, matches, config).verdict == "full"


def test_frames_without_matches_have_no_camera():
    true = panning_rotations(9)
    matches = turning_matches(true, 0.1, 0.0, np.random.default_rng(0))
    kept = [pair for pair in matches.pairs if 8 not in (pair.first, pair.second)]
    solution = solve_rotation_only(
        Matches(matches.keypoints_px, kept), INTRINSICS_PX, 2.0, np.random.default_rng(1)
    )
    assert solution.has_camera.tolist() == [True] * 8 + [False]
    assert turn_errors_deg(solution.world_from_cam_rotmats[:8], true[:8]).max() < 0.01


THREADS_SCRIPT = """
import hashlib, runpy, sys
import numpy as np
from gmrdata.cameras.map.rotation_only import solve_rotation_only, zooms
from gmrdata.cameras.match.keyframes import relative_rotation, unit_rays
here = runpy.run_path(sys.argv[1])
rotmats = here["panning_rotations"](60)
matches = here["turning_matches"](rotmats, 0.5, 0.1, np.random.default_rng(0), 100)
solution = solve_rotation_only(matches, here["INTRINSICS_PX"], 2.0, np.random.default_rng(1))
print(hashlib.sha256(solution.world_from_cam_rotmats.tobytes()).hexdigest())
"""


def test_the_number_of_blas_threads_does_not_change_a_bit():
    """A dense solver's sums depend on its threads; two workers on one machine must agree.

    They do for 180 unknowns, from few matches as from many.
    """
    digests = set()
    for threads in ("1", "2", "4"):
        answer = subprocess.run(
            [sys.executable, "-c", THREADS_SCRIPT, __file__],
            env={**os.environ, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads},
            capture_output=True,
            check=True,
        )
        digests.add(answer.stdout)
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "pan_deg", "zoom", "is_zoom"),
    [
        (0.0, 0.0, 0.0, 1.5, True),
        (0.0, 0.0, 25.0, 1.5, True),
        (0.0, 0.0, 25.0, 0.7, True),
        (2.0, 0.0, 0.0, 1.0, False),
        (2.0, 0.0, 25.0, 1.0, False),
        (0.0, 1.0, 0.0, 1.0, False),
        (0.0, 1.0, 25.0, 1.0, False),
        (0.3, 1.0, 0.0, 1.3, False),
    ],
)
def test_a_zoom_is_told_from_a_way_through_a_room(ahead_m, aside_m, pan_deg, zoom, is_zoom):
    rng = np.random.default_rng(0)
    points_m = rng.uniform([-5, -2, 4], [5, 2, 9], (800, 3))
    keypoints_px, inside = [], []
    for share in np.linspace(0, 1, 8):
        turn = Rotation.from_euler("y", share * pan_deg, degrees=True)
        seen = turn.apply(points_m - share * np.array([aside_m, 0, ahead_m]), inverse=True)
        rays = seen[:, :2] / seen[:, 2:] * (1 + share * (zoom - 1))
        image_px = np.c_[rays, np.ones(800)] @ INTRINSICS_PX[:2].T + rng.normal(0, 0.3, (800, 2))
        keypoints_px.append(image_px)
        inside.append((np.abs(image_px - [320, 180]) < [320, 180]).all(axis=1))
    pairs = [
        PairMatches(
            i, i + step, np.tile(np.flatnonzero(inside[i] & inside[i + step]), (2, 1)).T, ""
        )
        for step in (1, 2, 4)
        for i in range(8 - step)
    ]
    assert zooms(Matches(keypoints_px, pairs), INTRINSICS_PX, SfmConfig()) == is_zoom
