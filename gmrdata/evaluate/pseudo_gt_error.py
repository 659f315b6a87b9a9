"""Error of a pseudo ground truth against the truth, where a rendered clip has both."""

from dataclasses import dataclass

import numpy as np

from gmrdata.clip import Clip
from gmrdata.errors import StageFailed
from gmrdata.evaluate.alignment import fit_similarity, mean_rotation
from gmrdata.evaluate.metrics import angles_rad, orientation_errors_deg, translation_errors_mm
from gmrdata.geometry import transforms
from gmrdata.gmr.motion_deltas import deltas

MIN_CAMERA_EXTENT_M = 0.05
"""Extent of the true camera path below which a scale can't be read off it [m]."""
BODY_AXIS_M = 0.5
"""Length that stands for the body's orientation where trajectories are aligned [m]."""


@dataclass(frozen=True, eq=False)
class PseudoGtError:
    """How far a pseudo ground truth is from the truth."""

    ome_deg: float
    """Mean orientation motion error at the clip's frame rate (eq. 15) [deg]."""
    tme_mm: float
    """Mean translation motion error at the clip's frame rate (eq. 16) [mm]."""
    camera_rotation_deg: float | None
    """Mean angle between the cameras' rotations after one best rotation of the pseudo world [deg];
    None without cameras."""
    scale_error_percent: float | None
    """By how much the pseudo camera path is too large (> 0) or too small (< 0) in the best
    similarity fit of its centres [%]; None where the true camera stays within 5 cm, or the pseudo
    cameras have no positions."""
    trajectory_mm: float
    """Mean distance of the pelvis after `true_from_pseudo` [mm]."""
    frames: int
    """Frames with a pseudo ground truth and a truth."""
    frames_with_camera: int
    """Those in which both have a camera."""
    true_from_pseudo: np.ndarray
    """(4, 4) rigid transform between the worlds that fits the bodies' places and orientations
    best."""


def compare_clips(pseudo: Clip, true: Clip, *, fps_hz: float | None = None) -> PseudoGtError:
    """Compare a pseudo ground truth with the truth of the same video.

    Rows are paired by image number where both clips have images, by position otherwise.  Motions
    are taken between paired frames that follow each other in both clips, never across a gap.

    Args:
        pseudo: What was recovered, in a world of its own.
        true: What was rendered.
        fps_hz: Rate at which motions are taken [Hz], of which the clips' rate is a multiple; each
            frame begins one, so all phases count.  None for the clips' own rate.

    Raises:
        StageFailed: the clips are not in the world frame, differ in frame rate, are no multiple of
            `fps_hz`, or have no two frames in a row in common.
    """
    _check_comparable(pseudo, true)
    rows, true_rows = _paired_rows(pseudo, true)
    both = pseudo.valid[rows] & true.valid[true_rows]
    rows, true_rows = rows[both], true_rows[both]
    step = 1 if fps_hz is None else _frames_per_motion(true, fps_hz)
    ome_deg, tme_mm = _motion_errors(pseudo, true, rows, true_rows, step)
    true_from_pseudo = _align_bodies(pseudo, true, rows, true_rows)
    moved_m = transforms.apply(true_from_pseudo, pseudo.motion.pelvis_m[rows])
    distances_m = np.linalg.norm(moved_m - true.motion.pelvis_m[true_rows], axis=1)
    pseudo_cameras, true_cameras = _paired_cameras(pseudo, true, rows, true_rows)
    return PseudoGtError(
        ome_deg=ome_deg,
        tme_mm=tme_mm,
        camera_rotation_deg=_camera_rotation_deg(pseudo_cameras, true_cameras),
        scale_error_percent=_scale_error_percent(pseudo_cameras, true_cameras),
        trajectory_mm=float(distances_m.mean() * 1000),
        frames=len(rows),
        frames_with_camera=len(pseudo_cameras),
        true_from_pseudo=true_from_pseudo,
    )


def _check_comparable(pseudo: Clip, true: Clip) -> None:
    for clip in (pseudo, true):
        if clip.motion.frame != "world":
            raise StageFailed(f"clip {clip.id}: not in the world frame. Give a clip with a world")
    if abs(pseudo.motion.fps_hz - true.motion.fps_hz) > 1e-6 * true.motion.fps_hz:
        raise StageFailed(
            f"clip {pseudo.id}: {pseudo.motion.fps_hz:g} fps, but its truth {true.id} has"
            f" {true.motion.fps_hz:g} fps. Compare clips of one video"
        )


def _paired_rows(pseudo: Clip, true: Clip) -> tuple[np.ndarray, np.ndarray]:
    if (pseudo.image_numbers >= 0).all() and (true.image_numbers >= 0).all():
        _, rows, true_rows = np.intersect1d(
            pseudo.image_numbers, true.image_numbers, return_indices=True
        )
        return rows, true_rows
    if pseudo.motion.n_frames != true.motion.n_frames:
        raise StageFailed(
            f"clip {pseudo.id}: {pseudo.motion.n_frames} frames, but its truth {true.id} has"
            f" {true.motion.n_frames}, and they cannot be paired. Compare clips of one video"
        )
    rows = np.arange(true.motion.n_frames)
    return rows, rows


def _motion_errors(
    pseudo: Clip, true: Clip, rows: np.ndarray, true_rows: np.ndarray, step: int
) -> tuple[float, float]:
    """OME [deg] and TME [mm] of motions between frames `step` apart, none of them over a gap."""
    errors_deg, errors_mm = [], []
    for phase in range(step):
        deg, mm = _errors_of_neighbours(pseudo, true, rows, true_rows, phase, step)
        errors_deg.append(deg)
        errors_mm.append(mm)
    if not sum(map(len, errors_deg)):
        raise StageFailed(
            f"clip {pseudo.id}: no two frames in a row are valid in it and in its truth {true.id}."
            " There is nothing to compare"
        )
    return float(np.concatenate(errors_deg).mean()), float(np.concatenate(errors_mm).mean())


def _errors_of_neighbours(
    pseudo: Clip, true: Clip, rows: np.ndarray, true_rows: np.ndarray, phase: int, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """Errors [deg], [mm] of the motions from frame to frame of one phase of the video."""
    chosen = np.flatnonzero(true_rows % step == phase)
    rows, true_rows = rows[chosen], true_rows[chosen]
    # Frames in between that are missing on either side would show in one of the three.
    adjacent = (np.diff(rows) == step) & (np.diff(true_rows) == step) & (np.diff(chosen) == step)
    rotmats, metres = deltas(pseudo.motion.root_rotmats[rows], pseudo.motion.pelvis_m[rows])
    true_rotmats, true_m = deltas(
        true.motion.root_rotmats[true_rows], true.motion.pelvis_m[true_rows]
    )
    return (
        orientation_errors_deg(rotmats, true_rotmats)[adjacent],
        translation_errors_mm(metres, true_m)[adjacent],
    )


def _frames_per_motion(clip: Clip, fps_hz: float) -> int:
    ratio = clip.motion.fps_hz / fps_hz
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
        raise StageFailed(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no multiple of {fps_hz:g} fps."
            " Resample both clips first"
        )
    return round(ratio)


def _align_bodies(pseudo: Clip, true: Clip, rows: np.ndarray, true_rows: np.ndarray) -> np.ndarray:
    """Rigid fit of pelvis and body axes, so that it is defined for a person who stands still,
    too."""
    similarity = fit_similarity(
        _body_points_m(true, true_rows), _body_points_m(pseudo, rows), scale=False
    )
    return transforms.rigid(similarity.rotmat, similarity.translation_m)


def _body_points_m(clip: Clip, rows: np.ndarray) -> np.ndarray:
    """Pelvis, and the points half a metre from it along the body's axes: (4 * rows, 3) [m]."""
    axes_m = BODY_AXIS_M * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    world_from_root = transforms.rigid(clip.motion.root_rotmats[rows], clip.motion.pelvis_m[rows])
    return transforms.apply(world_from_root, axes_m).reshape(-1, 3)


def _paired_cameras(
    pseudo: Clip, true: Clip, rows: np.ndarray, true_rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """world_from_cam of the frames in which both clips have a camera: (n, 4, 4) each."""
    if pseudo.camera is None or true.camera is None:
        return np.zeros((0, 4, 4)), np.zeros((0, 4, 4))
    both = pseudo.camera.has_camera[rows] & true.camera.has_camera[true_rows]
    return pseudo.camera.world_from_cam[rows[both]], true.camera.world_from_cam[true_rows[both]]


def _camera_rotation_deg(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    if not len(pseudo_cameras):
        return None
    pseudo_rotmats, true_rotmats = pseudo_cameras[:, :3, :3], true_cameras[:, :3, :3]
    true_from_pseudo = mean_rotation(true_rotmats @ np.swapaxes(pseudo_rotmats, 1, 2))
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_pseudo @ pseudo_rotmats
    return float(np.rad2deg(angles_rad(residuals)).mean())


def _scale_error_percent(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    centres_m, true_centres_m = pseudo_cameras[:, :3, 3], true_cameras[:, :3, 3]
    if len(centres_m) < 2 or _extent_m(true_centres_m) < MIN_CAMERA_EXTENT_M:
        return None
    # Cameras of which only the rotations were recovered all stand in one place.
    if _extent_m(centres_m) < 1e-9:
        return None
    true_scale_from_pseudo = fit_similarity(true_centres_m, centres_m, scale=True).scale
    if true_scale_from_pseudo <= 0:
        return None
    return 100 * (1 / true_scale_from_pseudo - 1)


def _extent_m(points_m: np.ndarray) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(points_m, axis=0)))
