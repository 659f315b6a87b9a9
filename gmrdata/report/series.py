"""Errors of a recovered clip per frame, and the rigid alignment of its world to the true one."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.clip import Clip
from gmrdata.errors import BadFrames
from gmrdata.geometry import transforms
from gmrdata.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors over time, NaN where the pseudo clip has no camera."""

    times_s: np.ndarray
    """(T,) time of each frame [s]."""
    ome_deg: np.ndarray
    """(T-1,) angle between the recovered and the true turn from a frame to the next [deg]."""
    tme_mm: np.ndarray
    """(T-1,) distance between the recovered and the true step, in the body's frame [mm]."""
    camera_rotation_deg: np.ndarray
    """(T,) angle between the recovered and the true camera after the alignment [deg]."""


def paired_rows(true: Clip, pseudo: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two clips that show the same image, in the order of time.

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


def rigid_alignment(true: Clip, pseudo: Clip) -> np.ndarray:
    """The rigid true_from_pseudo (4, 4) [m] that fits root orientations and pelvis positions best.

    The rotation is the chordal mean over the frames, so it is defined on a straight path and for a
    person who stands still, where fitting points alone would not be.
    """
    true_rows, pseudo_rows = paired_rows(true, pseudo)
    keep = usable(pseudo)[pseudo_rows] & true.valid[true_rows].astype(bool)
    true_rows, pseudo_rows = true_rows[keep], pseudo_rows[keep]
    if not len(true_rows):
        return np.eye(4)
    turns = true.motion.root_rotmats[true_rows] @ np.swapaxes(
        pseudo.motion.root_rotmats[pseudo_rows], 1, 2
    )
    rotmat = Rotation.from_matrix(turns).mean().as_matrix()
    offsets_m = true.motion.pelvis_m[true_rows] - pseudo.motion.pelvis_m[pseudo_rows] @ rotmat.T
    return transforms.rigid(rotmat, offsets_m.mean(axis=0))


def error_series(true: Clip, pseudo: Clip, true_from_pseudo: np.ndarray) -> ErrorSeries:
    """Errors per frame of a pseudo clip, over the images that both clips have."""
    true_rows, pseudo_rows = paired_rows(true, pseudo)
    good = usable(pseudo)[pseudo_rows] & true.valid[true_rows].astype(bool)
    true_turns, true_steps_m = _motions(true.motion, true_rows)
    turns, steps_m = _motions(pseudo.motion, pseudo_rows)
    both = good[1:] & good[:-1] & (np.diff(true_rows) == 1)
    camera_deg = np.full(len(good), np.nan)
    if true.camera is not None and pseudo.camera is not None:
        true_rotmats = true.camera.world_from_cam[true_rows, :3, :3]
        rotmats = true_from_pseudo[:3, :3] @ pseudo.camera.world_from_cam[pseudo_rows, :3, :3]
        camera_deg = _angles_deg(true_rotmats, rotmats)
    return ErrorSeries(
        times_s=(true_rows - true_rows[0]) / true.motion.fps_hz,
        ome_deg=np.where(both, _angles_deg(true_turns, turns), np.nan),
        tme_mm=np.where(both, 1000 * np.linalg.norm(steps_m - true_steps_m, axis=1), np.nan),
        camera_rotation_deg=np.where(good, camera_deg, np.nan),
    )


def _motions(motion: Motion, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns (T-1, 3, 3) and steps (T-1, 3) [m] between rows, in the body's frame (eqs. 2-4)."""
    body_from_world = np.swapaxes(motion.root_rotmats[rows[:-1]], 1, 2)
    steps_m = np.einsum("tij,tj->ti", body_from_world, np.diff(motion.pelvis_m[rows], axis=0))
    return body_from_world @ motion.root_rotmats[rows[1:]], steps_m


def _angles_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (T,) between rotations (T, 3, 3) [deg]; NaN where an entry is."""
    angles = np.full(len(a), np.nan)
    finite = np.isfinite(a).all(axis=(1, 2)) & np.isfinite(b).all(axis=(1, 2))
    between = Rotation.from_matrix(np.swapaxes(a[finite], 1, 2) @ b[finite])
    angles[finite] = np.rad2deg(between.magnitude())
    return angles
