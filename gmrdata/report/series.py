"""Errors of a recovered clip per frame."""

from dataclasses import dataclass

import numpy as np

from gmrdata.clip import Clip
from gmrdata.errors import BadFrames
from gmrdata.evaluate.alignment import mean_rotation
from gmrdata.evaluate.metrics import angles_rad, orientation_errors_deg, translation_errors_mm
from gmrdata.gmr.motion_deltas import deltas


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors over time, NaN where the pseudo clip has no camera."""

    times_s: np.ndarray
    """(T,) time of each frame [s]."""
    ome_deg: np.ndarray
    """(T-1,) orientation motion error of each motion [deg]."""
    tme_mm: np.ndarray
    """(T-1,) translation motion error of each motion [mm]."""
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


def error_series(true: Clip, pseudo: Clip) -> ErrorSeries:
    """Errors per frame of a pseudo clip, over the images that both clips have.

    Their means are `gmrdata.evaluate.pseudo_gt_error.compare_clips`' figures at the clip's rate.
    """
    true_rows, rows = paired_rows(true, pseudo)
    good = usable(pseudo)[rows] & true.valid[true_rows].astype(bool)
    turns, steps_m = deltas(pseudo.motion.root_rotmats[rows], pseudo.motion.pelvis_m[rows])
    true_turns, true_steps_m = deltas(
        true.motion.root_rotmats[true_rows], true.motion.pelvis_m[true_rows]
    )
    both = good[1:] & good[:-1] & (np.diff(true_rows) == 1) & (np.diff(rows) == 1)
    return ErrorSeries(
        times_s=(true_rows - true_rows[0]) / true.motion.fps_hz,
        ome_deg=np.where(both, orientation_errors_deg(turns, true_turns), np.nan),
        tme_mm=np.where(both, translation_errors_mm(steps_m, true_steps_m), np.nan),
        camera_rotation_deg=_camera_rotation_deg(true, pseudo, true_rows, rows),
    )


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
