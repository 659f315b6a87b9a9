"""Errors of a person's pose as the camera sees it: joints, vertices and joint rotations over time.

Pure functions of arrays; of two, the prediction's comes first.  Places are from one point of each
body, the middle of its hips as a rule, so that where the body is does not count.
"""

from collections.abc import Sequence

import numpy as np

from gmrdata.score.world_metrics import Points, Rows, Samples, pooled
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import Similarities, fit_similarity

JointRotmats = Float[np.ndarray, "frames joints 3 3"]


def hips_m(joints_m: Points, hips: Sequence[int]) -> Float[np.ndarray, "frames 1 3"]:
    """Middle of the hip joints [m]."""
    return np.asarray(joints_m[:, list(hips)].mean(axis=1, keepdims=True))


def point_errors_mm(predicted_m: Points, true_m: Points) -> Samples:
    """Mean distance of the points of each frame [mm]: MPJPE of joints, PVE of vertices."""
    return np.asarray(1000 * np.linalg.norm(predicted_m - true_m, axis=-1).mean(-1))


def aligned_errors_mm(
    predicted_m: Points, true_m: Points, true_from_predicted: Similarities
) -> Samples:
    """The same after the best similarity of each frame's joints: PA-MPJPE and PA-PVE [mm]."""
    return point_errors_mm(true_from_predicted.apply(predicted_m), true_m)


def joint_angle_errors_deg(predicted_rotmats: JointRotmats, true_rotmats: JointRotmats) -> Samples:
    """MPJAE: mean angle between the joints' orientations in the camera of each frame [deg]."""
    residuals = predicted_rotmats @ np.swapaxes(true_rotmats, -1, -2)
    return np.asarray(np.rad2deg(angles_rad(residuals)).mean(-1))


def acceleration_errors(
    predicted_m: Points, true_m: Points, runs: Sequence[Rows], trim: int = 0
) -> Samples:
    """Mean length of the difference of the joints' accelerations per frame [m/frame^2].

    `trim` samples at both ends of a run are left out.
    """
    return _of_runs(predicted_m - true_m, runs, trim)


def accelerations(joints_m: Points, runs: Sequence[Rows]) -> Samples:
    """Mean length of the joints' own accelerations per frame [m/frame^2]."""
    return _of_runs(joints_m, runs, 0)


def acceleration_length_errors(
    predicted_m: Points, true_m: Points, runs: Sequence[Rows]
) -> Samples:
    """Length of the vector over joints of the differences of |acceleration| [m/frame^2]."""
    found = []
    for start, stop in runs:
        lengths = [
            np.linalg.norm(_second(one[start:stop]), axis=-1) for one in (predicted_m, true_m)
        ]
        found.append(np.linalg.norm(lengths[1] - lengths[0], axis=-1))
    return pooled(found)


def path_error_m(
    predicted_m: Float[np.ndarray, "frames 3"],
    true_m: Float[np.ndarray, "frames 3"],
    *,
    scale: bool,
) -> float:
    """ATE: mean distance of two camera paths after the best alignment of the whole [m]."""
    true_from_predicted = fit_similarity(true_m, predicted_m, scale=scale)
    return float(np.linalg.norm(true_from_predicted.apply(predicted_m) - true_m, axis=-1).mean())


def _of_runs(places_m: Points, runs: Sequence[Rows], trim: int) -> Samples:
    parts = [np.linalg.norm(_second(places_m[a:b]), axis=-1).mean(-1) for a, b in runs]
    return pooled([part[trim : len(part) - trim] for part in parts])


def _second(places_m: Points) -> np.ndarray:
    return np.diff(places_m, n=2, axis=0)
