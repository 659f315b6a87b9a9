"""Errors of a person's path and pose in the world, from joints over time.

Pure functions of arrays at one frame rate.  Frames of a clip that has gaps are given one after the
other, and `runs` are their rows (start, stop) between the gaps: nothing that is a difference
between frames (path length, velocity, jitter, sliding) is taken from one run to the next.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gmrdata.score import Remainder
from gmrdata.values.alignment import fit_similarity
from gmrdata.values.motion_metrics import angles_rad

Rows = tuple[int, int]
"""Frames start, start + 1, ... stop - 1."""


def segments_of(n_frames: int, length: int, remainder: Remainder) -> list[Rows]:
    """Cut frames into segments of one length.

    Args:
        n_frames: Frames.
        length: Frames per segment.
        remainder: "own_segment": the frames left over are a shorter segment.
            "joined_but_last_frame": they belong to the last full segment, but for the very last
            frame; nothing up to `length` frames has a segment, and where none are left over the
            last full segment is not scored.  "joined": they belong to the last full segment, and
            where none are left over the last two segments are one; nothing up to `length` frames
            has a segment.
    """
    starts = list(range(0, n_frames, length))
    if remainder == "own_segment":
        return [(start, min(start + length, n_frames)) for start in starts]
    if remainder == "joined":
        edges = [*starts[:-1], n_frames]
        return list(pairwise(edges))
    return [
        (start, n_frames - 1 if start + 2 * length > n_frames else start + length)
        for start in range(0, n_frames - length, length)
    ]


def segment_errors_mm(
    predicted_joints_m: np.ndarray,
    true_joints_m: np.ndarray,
    segments: Sequence[Rows],
    *,
    first_frames: int | None,
    scale: bool,
) -> list[np.ndarray]:
    """Mean distance of joints per frame, each segment aligned by itself: W-MPJPE and WA-MPJPE.

    Args:
        predicted_joints_m: (T, J, 3) in the prediction's world [m].
        true_joints_m: (T, J, 3) in the true world [m].
        segments: Rows of the segments.
        first_frames: Frames at the start of a segment whose joints the alignment fits (W-MPJPE);
            None for all of them (WA-MPJPE).
        scale: Whether the alignment fits the scale as well (which hides an error of it).

    Returns:
        One (n,) array of errors [mm] per segment.
    """
    errors_mm = []
    for start, stop in segments:
        predicted_m, true_m = predicted_joints_m[start:stop], true_joints_m[start:stop]
        fitted = slice(0, first_frames)
        true_from_predicted = fit_similarity(
            true_m[fitted].reshape(-1, 3), predicted_m[fitted].reshape(-1, 3), scale=scale
        )
        offsets_m = true_from_predicted.apply(predicted_m) - true_m
        errors_mm.append(1000 * np.linalg.norm(offsets_m, axis=-1).mean(-1))
    return errors_mm


def root_errors_percent(
    predicted_root_m: np.ndarray, true_root_m: np.ndarray, runs: Sequence[Rows]
) -> np.ndarray:
    """RTE: distance of the roots per frame, in percent of the true path's length: (T,) [%].

    The whole predicted path is moved onto the true one by one best rigid transform; its scale is
    left as it is.

    Args:
        predicted_root_m: (T, 3) in the prediction's world [m].
        true_root_m: (T, 3) in the true world [m].
        runs: Rows without a gap; a jump over a gap is no part of the path's length.

    Returns:
        Errors, or (0,) where the true root does not move, so that there is nothing to divide by.
    """
    length_m = sum(
        float(np.linalg.norm(np.diff(true_root_m[start:stop], axis=0), axis=-1).sum())
        for start, stop in runs
    )
    if length_m <= 0:
        return np.zeros(0)
    true_from_predicted = fit_similarity(true_root_m, predicted_root_m, scale=False)
    offsets_m = true_from_predicted.apply(predicted_root_m) - true_root_m
    errors: np.ndarray = 100 * np.linalg.norm(offsets_m, axis=-1) / length_m
    return errors


def root_orientation_errors_deg(
    predicted_rotmats: np.ndarray, true_rotmats: np.ndarray
) -> np.ndarray:
    """ROE: angle between root orientations after the first frame's were made equal: (T,) [deg].

    Args:
        predicted_rotmats: (T, 3, 3) world_from_root in the prediction's world.
        true_rotmats: (T, 3, 3) world_from_root in the true world.
    """
    true_from_predicted = true_rotmats[0] @ predicted_rotmats[0].T
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_predicted @ predicted_rotmats
    return np.rad2deg(angles_rad(residuals))


def root_velocity_errors_mm_per_frame(
    predicted_rotmats: np.ndarray,
    predicted_root_m: np.ndarray,
    true_rotmats: np.ndarray,
    true_root_m: np.ndarray,
    runs: Sequence[Rows],
) -> np.ndarray:
    """ERVE: error of the root's step as the body sees it: (n,) [mm per frame].

    ||R* R^T v - v*|| with v = T_{i+1} - T_i, which is the length of dT - dT*: the paper's TME, by
    another name and at another frame rate.

    Args:
        predicted_rotmats: (T, 3, 3) world_from_root in the prediction's world.
        predicted_root_m: (T, 3) [m].
        true_rotmats: (T, 3, 3) world_from_root in the true world.
        true_root_m: (T, 3) [m].
        runs: Rows without a gap.
    """
    errors_mm = []
    for start, stop in runs:
        rows = slice(start, stop - 1)
        true_from_predicted = true_rotmats[rows] @ np.swapaxes(predicted_rotmats[rows], 1, 2)
        steps_m = np.diff(predicted_root_m[start:stop], axis=0)
        turned_m = (true_from_predicted @ steps_m[..., None])[..., 0]
        offsets_m = turned_m - np.diff(true_root_m[start:stop], axis=0)
        errors_mm.append(1000 * np.linalg.norm(offsets_m, axis=-1))
    return _pooled(errors_mm)


def jitter_10m_per_s3(joints_m: np.ndarray, fps_hz: float, runs: Sequence[Rows]) -> np.ndarray:
    """Jitter: mean length of the joints' jerk, from third differences: (n,) [10 m/s^3].

    Args:
        joints_m: (T, J, 3) [m].
        fps_hz: Their rate [Hz].
        runs: Rows without a gap; one of less than four frames has no jerk.
    """
    jerks = [np.diff(joints_m[start:stop], n=3, axis=0) * fps_hz**3 for start, stop in runs]
    return _pooled([np.linalg.norm(jerk, axis=-1).mean(-1) / 10 for jerk in jerks])


def foot_sliding_mm(
    predicted_feet_m: np.ndarray,
    true_feet_m: np.ndarray,
    runs: Sequence[Rows],
    contact_m: float,
) -> np.ndarray:
    """How far points of the predicted feet move from frame to frame while the true ones stand.

    Args:
        predicted_feet_m: (T, F, 3) points of the feet in the prediction's world [m].
        true_feet_m: (T, F, 3) the same of the true feet [m].
        runs: Rows without a gap.
        contact_m: A true point stands while it moves less than this from frame to frame [m].

    Returns:
        (n,) movement of each standing point in each step [mm].
    """
    slid_mm = []
    for start, stop in runs:
        true_steps_m = np.linalg.norm(np.diff(true_feet_m[start:stop], axis=0), axis=-1)
        steps_m = np.linalg.norm(np.diff(predicted_feet_m[start:stop], axis=0), axis=-1)
        slid_mm.append(1000 * steps_m[true_steps_m < contact_m])
    return _pooled(slid_mm)


def _pooled(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *parts])
