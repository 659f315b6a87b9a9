"""Errors of a person's path and pose over time: in the world, and as the camera sees them.

Pure functions of arrays at one frame rate; of two, the prediction's comes first, in a world of its
own.  Frames of a clip that has gaps are given one after the other, and `runs` are their rows
(start, stop) between the gaps: nothing that is a difference between frames (path length, velocity,
acceleration, jitter, sliding) is taken from one run to the next.

Places in the camera's frame are from one point of each body, the middle of its hips as a rule, so
that where the body is does not count.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gmrdata.score import Remainder
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import Similarities, angles_rad, fit_similarity

STANDS_M = 1e-6  # a path that goes less far is of rounding alone
Rows = tuple[int, int]  # frames start, start + 1, ... stop - 1
Places = Float[np.ndarray, "frames 3"]
Rotmats = Float[np.ndarray, "frames 3 3"]
Points = Float[np.ndarray, "frames points 3"]
Samples = Float[np.ndarray, " samples"]
JointRotmats = Float[np.ndarray, "frames joints 3 3"]


def segments_of(n_frames: int, length: int, remainder: Remainder) -> list[Rows]:
    """Cut frames into segments of one length; `remainder` says what becomes of those left over.

    "own_segment": they are a shorter segment.  "joined_but_last_frame": they belong to the last
    full segment, but for the very last frame; nothing up to `length` frames has a segment, and
    where none are left over the last full segment is not scored.  "joined": they belong to the last
    full segment, and where none are left over the last two segments are one; nothing up to `length`
    frames has a segment.
    """
    starts = list(range(0, n_frames, length))
    if remainder == "own_segment":
        return [(start, min(start + length, n_frames)) for start in starts]
    if remainder == "joined":
        return list(pairwise([*starts[:-1], n_frames]))
    return [
        (start, n_frames - 1 if start + 2 * length > n_frames else start + length)
        for start in range(0, n_frames - length, length)
    ]


def segment_errors_mm(
    predicted_joints_m: Points,
    true_joints_m: Points,
    segments: Sequence[Rows],
    *,
    first_frames: int | None,
    scale: bool,
) -> list[Samples]:
    """Mean distance of joints per frame of each segment [mm], each aligned by itself.

    The alignment fits the joints of a segment's first frames (W-MPJPE), or of all where
    `first_frames` is None (WA-MPJPE), and with `scale` the scale too (which hides an error of it).
    """
    errors_mm = []
    for start, stop in segments:
        predicted_m, true_m = predicted_joints_m[start:stop], true_joints_m[start:stop]
        fitted_m = (one[:first_frames].reshape(-1, 3) for one in (true_m, predicted_m))
        true_from_predicted = fit_similarity(*fitted_m, scale=scale)
        offsets_m = true_from_predicted.apply(predicted_m) - true_m
        errors_mm.append(1000 * np.linalg.norm(offsets_m, axis=-1).mean(-1))
    return errors_mm


def root_errors_percent(
    predicted_root_m: Places, true_root_m: Places, runs: Sequence[Rows]
) -> Samples:
    """RTE: distance of the roots per frame, in percent of the true path's length.

    The whole predicted path is moved onto the true one by one best rigid transform; its scale is
    left as it is.  A jump over a gap is no part of the path's length.  There are no errors where
    the true root does not move, so that there is nothing to divide by.
    """
    length_m = sum(float(_steps_m(true_root_m[start:stop]).sum()) for start, stop in runs)
    if length_m < STANDS_M:
        return np.zeros(0)
    true_from_predicted = fit_similarity(true_root_m, predicted_root_m, scale=False)
    offsets_m = true_from_predicted.apply(predicted_root_m) - true_root_m
    errors: np.ndarray = 100 * np.linalg.norm(offsets_m, axis=-1) / length_m
    return errors


def root_orientation_errors_deg(predicted_rotmats: Rotmats, true_rotmats: Rotmats) -> Samples:
    """ROE: angle between root orientations (world_from_root), the first ones made equal."""
    true_from_predicted = true_rotmats[0] @ predicted_rotmats[0].T
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_predicted @ predicted_rotmats
    return np.rad2deg(angles_rad(residuals))


def root_velocity_errors_mm_per_frame(
    predicted_rotmats: Rotmats,
    predicted_root_m: Places,
    true_rotmats: Rotmats,
    true_root_m: Places,
    runs: Sequence[Rows],
) -> Samples:
    """ERVE: error of the root's step as the body sees it.

    ||R* R^T v - v*|| with v = T_{i+1} - T_i, which is the length of dT - dT*: the paper's TME, by
    another name and at another frame rate.
    """
    errors_mm = []
    for start, stop in runs:
        rows = slice(start, stop - 1)
        true_from_predicted = true_rotmats[rows] @ np.swapaxes(predicted_rotmats[rows], 1, 2)
        steps_m = np.diff(predicted_root_m[start:stop], axis=0)
        turned_m = (true_from_predicted @ steps_m[..., None])[..., 0]
        offsets_m = turned_m - np.diff(true_root_m[start:stop], axis=0)
        errors_mm.append(1000 * np.linalg.norm(offsets_m, axis=-1))
    return pooled(errors_mm)


def jitter_10m_per_s3(joints_m: Points, fps_hz: float, runs: Sequence[Rows]) -> Samples:
    """Jitter: mean length of the joints' jerk [10 m/s^3]; a run below four frames has none."""
    jerks = [np.diff(joints_m[start:stop], n=3, axis=0) * fps_hz**3 for start, stop in runs]
    return pooled([np.linalg.norm(jerk, axis=-1).mean(-1) / 10 for jerk in jerks])


def foot_sliding_mm(
    predicted_feet_m: Points, true_feet_m: Points, runs: Sequence[Rows], contact_m: float
) -> Samples:
    """How far predicted foot points move while the true ones move less than `contact_m` [mm]."""
    slid_mm = []
    for start, stop in runs:
        stands = _steps_m(true_feet_m[start:stop]) < contact_m
        slid_mm.append(1000 * _steps_m(predicted_feet_m[start:stop])[stands])
    return pooled(slid_mm)


def pooled(parts: Sequence[np.ndarray]) -> Samples:
    """All samples in one array, which is empty where there are none."""
    return np.concatenate([np.zeros(0), *parts])


def _steps_m(places_m: np.ndarray) -> np.ndarray:
    lengths_m: np.ndarray = np.linalg.norm(np.diff(places_m, axis=0), axis=-1)
    return lengths_m


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


def accelerations(points_m: Points, runs: Sequence[Rows], trim: int = 0) -> Samples:
    """Mean length of the accelerations of joints, or of what they are off by [m/frame^2].

    `trim` samples at both ends of a run are left out.
    """
    parts = [np.linalg.norm(np.diff(points_m[a:b], n=2, axis=0), axis=-1).mean(-1) for a, b in runs]
    return pooled([part[trim : len(part) - trim] for part in parts])


def acceleration_length_errors(
    predicted_m: Points, true_m: Points, runs: Sequence[Rows]
) -> Samples:
    """Length of the vector over joints of the differences of |acceleration| [m/frame^2]."""
    errors = []
    for start, stop in runs:
        lengths = [
            np.linalg.norm(np.diff(one[start:stop], n=2, axis=0), axis=-1)
            for one in (predicted_m, true_m)
        ]
        errors.append(np.linalg.norm(lengths[1] - lengths[0], axis=-1))
    return pooled(errors)


def path_error_m(predicted_m: Places, true_m: Places, *, scale: bool) -> float:
    """ATE: mean distance of two camera paths after the best alignment of the whole [m]."""
    true_from_predicted = fit_similarity(true_m, predicted_m, scale=scale)
    return float(np.linalg.norm(true_from_predicted.apply(predicted_m) - true_m, axis=-1).mean())
