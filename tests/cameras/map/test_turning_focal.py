"""The focal length that a pan chooses, on drawn points whose camera is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.map.focal import FreedFocal, turning_focal
from gmrdata.cameras.map.rotation_only import solve_rotation_only
from gmrdata.cameras.match.matches import Matches, PairMatches

INTRINSICS_PX = np.array([[600.0, 0, 270], [0, 620.0, 480], [0, 0, 1]])
SIZE_PX = (540, 960)
N_FRAMES = 8


def panned(turn_deg: float, noise_px: float, seed: int = 0, drift_m: float = 0.0) -> Matches:
    """Matches of a camera that turns by so much, and drifts in the hand."""
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(2000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    points_m = rays * rng.uniform(4, 15, (len(rays), 1))
    seen, points_px = [], []
    for share in np.linspace(-0.5, 0.5, N_FRAMES):
        world_from_cam = Rotation.from_euler("y", share * turn_deg, degrees=True).as_matrix()
        cam_m = (points_m - drift_m * rng.normal(size=3)) @ world_from_cam
        image_px = (cam_m / cam_m[:, 2:]) @ INTRINSICS_PX.T
        image_px = image_px[:, :2] + rng.normal(0, noise_px, (len(rays), 2))
        inside = (cam_m[:, 2] > 0.1) & (image_px > 0).all(axis=1) & (image_px < SIZE_PX).all(axis=1)
        seen.append(np.flatnonzero(inside))
        points_px.append(image_px[inside])
    pairs = []
    for first in range(N_FRAMES):
        for second in range(first + 1, min(N_FRAMES, first + 5)):
            _, a, b = np.intersect1d(seen[first], seen[second], return_indices=True)
            pairs.append(PairMatches(first, second, np.c_[a, b], "CALIBRATED"))
    return Matches(points_px, pairs)


def freed(matches: Matches, factor: float) -> FreedFocal | None:
    """What the matches ask for where the focal length is given wrong by a factor."""
    wrong_px = INTRINSICS_PX.copy()
    wrong_px[[0, 1], [0, 1]] *= factor
    turning = solve_rotation_only(matches, wrong_px, 2.0, np.random.default_rng(0))
    return turning_focal(turning, matches, wrong_px)


@pytest.mark.parametrize("factor", [1.3, 1.0, 1 / 1.3])
def test_exact_matches_give_the_exact_focal_length(factor: float) -> None:
    found = freed(panned(20.0, 0.0), factor)
    assert found is not None
    assert found.factor == pytest.approx(1 / factor, rel=1e-5)


@pytest.mark.parametrize("factor", [1.3, 1.0, 1 / 1.3])
@pytest.mark.parametrize("turn_deg", [8.0, 40.0])
def test_noise_and_a_drift_in_the_hand_stay_within_the_standard_error(
    turn_deg: float, factor: float
) -> None:
    for seed in range(3):
        found = freed(panned(turn_deg, 0.4, seed, drift_m=0.01), factor)
        assert found is not None and found.sigma is not None
        assert found.sigma < 0.06
        assert abs(found.factor - 1 / factor) < 2 * found.sigma


def test_a_camera_that_does_not_turn_says_nothing() -> None:
    assert freed(panned(0.0, 0.4), 1.0) is None
    assert freed(panned(0.0, 0.0), 1.0) is None


def test_wrong_matches_are_outvoted() -> None:
    matches = panned(30.0, 0.4)
    rng = np.random.default_rng(1)
    for points_px in matches.keypoints_px:
        wrong = rng.random(len(points_px)) < 0.1
        points_px[wrong] += rng.normal(0, 40, (int(wrong.sum()), 2))
    found = freed(matches, 1.3)
    assert found is not None and found.sigma is not None
    assert abs(found.factor - 1 / 1.3) < 2 * found.sigma


@pytest.mark.parametrize("seed", range(3))
def test_a_turn_of_half_a_degree_says_next_to_nothing(seed: int) -> None:
    """A phone held still before people, by 0.3 degrees either way, was said to have half its focal
    length, to 3 %."""
    found = freed(panned(0.6, 0.1, seed, drift_m=0.005), 1.0)
    assert found is not None and found.sigma > 0.3
