"""Errors of a recovered clip per frame."""

from dataclasses import dataclass

import numpy as np

from gmrdata.clip import Clip
from gmrdata.errors import BadFrames
from gmrdata.evaluate.alignment import mean_rotation
from gmrdata.evaluate.metrics import angles_rad, orientation_errors_deg, translation_errors_mm
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors over time, NaN where the pseudo clip has no camera."""

    times_s: np.ndarray
    """(T,) time of each frame [s]."""
    motion_times_s: np.ndarray
    """(n,) middle of each motion [s]; at a lower rate than the clip's they overlap."""
    ome_deg: np.ndarray
    """(n,) orientation motion error of each motion [deg]."""
    tme_mm: np.ndarray
    """(n,) translation motion error of each motion [mm]."""
    camera_rotation_deg: np.ndarray
    """(T,) angle between the recovered and the true camera, after one best rotation of the
    recovered world [deg]."""


def paired_rows(true: Clip, pseudo: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two clips that show the same image, in the order of the images' numbers.

    Raises:
        BadFrames: no image is in both.
    """
    numbers, true_rows, pseudo_rows = np.intersect1d(
        true.image_numbers, pseudo.image_numbers, return_indices=True
    )
    with_image = numbers >= 0
    if not with_image.any():
        raise BadFrames(
            f"clip {pseudo.id}: its truth and its pseudo ground truth have no image in common;"
            " give both the numbers of their images"
        )
    return true_rows[with_image], pseudo_rows[with_image]


def usable(pseudo: Clip) -> np.ndarray:
    """(T,) bool: frames of a pseudo clip with a valid motion and a camera."""
    if pseudo.camera is None:
        return pseudo.valid.astype(bool)
    return pseudo.valid.astype(bool) & pseudo.camera.has_camera.astype(bool)


def frames_per_motion(clip: Clip, fps_hz: float | None) -> int:
    """How many frames later a motion ends than it begins; None stands for the clip's own rate.

    Raises:
        BadFrames: the clip's rate is no multiple of `fps_hz`.
    """
    if fps_hz is None:
        return 1
    ratio = clip.motion.fps_hz / fps_hz
    step = round(ratio)
    if step < 1 or abs(ratio - step) > 1e-6 * ratio:
        raise BadFrames(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no multiple of the {fps_hz:g} fps at"
            " which its errors are shown; resample it"
        )
    return step


def error_series(true: Clip, pseudo: Clip, fps_hz: float | None = None) -> ErrorSeries:
    """Errors per frame of a pseudo clip, over the images that both clips have.

    Their means are `gmrdata.evaluate.pseudo_gt_error.compare_clips`' figures at the same rate.

    Args:
        true: What was rendered.
        pseudo: What was recovered.
        fps_hz: Rate at which motions are taken [Hz], one from each frame; None for the clips' own.

    Raises:
        BadFrames: the clips have no image in common, or their rate is no multiple of `fps_hz`.
    """
    step = frames_per_motion(true, fps_hz)
    true_rows, rows = paired_rows(true, pseudo)
    good = usable(pseudo)[rows] & true.valid[true_rows].astype(bool)
    turns, steps_m = _motions(pseudo.motion, rows, step)
    true_turns, true_steps_m = _motions(true.motion, true_rows, step)
    # Every frame of the span must be good: no motion goes over a gap.
    both = np.lib.stride_tricks.sliding_window_view(good, step + 1).all(axis=1)
    both &= (true_rows[step:] - true_rows[:-step] == step) & (rows[step:] - rows[:-step] == step)
    times_s = (true_rows - true_rows[0]) / true.motion.fps_hz
    return ErrorSeries(
        times_s=times_s,
        motion_times_s=0.5 * (times_s[step:] + times_s[:-step]),
        ome_deg=np.where(both, orientation_errors_deg(turns, true_turns), np.nan),
        tme_mm=np.where(both, translation_errors_mm(steps_m, true_steps_m), np.nan),
        camera_rotation_deg=_camera_rotation_deg(true, pseudo, true_rows, rows),
    )


def _motions(motion: Motion, rows: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """dR (n, 3, 3) and dT (n, 3) [m] from each row to the one `step` rows later."""
    pairs = np.stack([rows[:-step], rows[step:]], axis=1)
    turns, steps_m = deltas(motion.root_rotmats[pairs], motion.pelvis_m[pairs])
    return turns[:, 0], steps_m[:, 0]


def _camera_rotation_deg(
    true: Clip, pseudo: Clip, true_rows: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    errors_deg = np.full(len(rows), np.nan)
    if true.camera is None or pseudo.camera is None:
        return errors_deg
    both = usable(pseudo)[rows] & true.camera.has_camera[true_rows].astype(bool)
    if not both.any():
        return errors_deg
    true_rotmats = true.camera.world_from_cam[true_rows[both], :3, :3]
    rotmats = pseudo.camera.world_from_cam[rows[both], :3, :3]
    true_from_pseudo = mean_rotation(true_rotmats @ np.swapaxes(rotmats, 1, 2))
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_pseudo @ rotmats
    errors_deg[both] = np.rad2deg(angles_rad(residuals))
    return errors_deg
