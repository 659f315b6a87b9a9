"""Error of a pseudo ground truth against the truth, where a rendered clip has both."""

from dataclasses import dataclass

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import StageFailed
from gmrdata.evaluate.alignment import fit_similarity
from gmrdata.evaluate.camera_error import camera_path_mm, camera_rotation_deg, scale_error_percent
from gmrdata.evaluate.motion_error import motion_errors
from gmrdata.geometry import transforms

BODY_AXIS_M = 0.5
"""Length that stands for the body's orientation where trajectories are aligned [m]."""


@dataclass(frozen=True, eq=False)
class PseudoGtError:
    """How far a pseudo ground truth is from the truth."""

    ome_deg: float
    """Mean orientation motion error at the clip's frame rate (eq. 15) [deg]."""
    tme_mm: float
    """Mean translation motion error at the clip's frame rate (eq. 16) [mm]."""
    vme_mm: float | None
    """Mean vertex motion error of the true body in its true local pose (eq. 17) [mm], so it is of
    the motion alone; None where no body was given."""
    n_motions: int
    """Motions of which the three are means."""
    camera_rotation_deg: float | None
    """Mean angle between the cameras' rotations after one best rotation of the pseudo world [deg];
    None without cameras."""
    camera_path_mm: float | None
    """Mean distance of the cameras' centres after one best rigid transform of the pseudo world
    [mm], the scale as it is; None without cameras."""
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


def compare_clips(
    pseudo: Clip, true: Clip, *, fps_hz: float | None = None, body: BodyModel | None = None
) -> PseudoGtError:
    """Compare a pseudo ground truth with the truth of the same video.

    Rows are paired by image number where both clips have images, by position otherwise.  Motions
    are taken between paired frames that follow each other in both clips, never across a gap.

    Args:
        pseudo: What was recovered, in a world of its own.
        true: What was rendered.
        fps_hz: Rate at which motions are taken [Hz], of which the clips' rate is a multiple; each
            frame begins one, so all phases count.  None for the clips' own rate.
        body: The true clip's body, for VME.

    Raises:
        NothingToCompare: the clips have no two frames in a row in common.
        StageFailed: the clips are not in the world frame, differ in frame rate, or are no multiple
            of `fps_hz`.
    """
    _check_comparable(pseudo, true)
    rows, true_rows = _paired_rows(pseudo, true)
    both = pseudo.valid[rows] & true.valid[true_rows]
    rows, true_rows = rows[both], true_rows[both]
    step = 1 if fps_hz is None else _frames_per_motion(true, fps_hz)
    errors = motion_errors(pseudo, true, rows, true_rows, step, body)
    true_from_pseudo = _align_bodies(pseudo, true, rows, true_rows)
    moved_m = transforms.apply(true_from_pseudo, pseudo.motion.pelvis_m[rows])
    distances_m = np.linalg.norm(moved_m - true.motion.pelvis_m[true_rows], axis=1)
    pseudo_cameras, true_cameras = _paired_cameras(pseudo, true, rows, true_rows)
    return PseudoGtError(
        ome_deg=float(errors.ome_deg.mean()),
        tme_mm=float(errors.tme_mm.mean()),
        vme_mm=None if body is None else float(errors.vme_mm.mean()),
        n_motions=len(errors.ome_deg),
        camera_rotation_deg=camera_rotation_deg(pseudo_cameras, true_cameras),
        camera_path_mm=camera_path_mm(pseudo_cameras, true_cameras),
        scale_error_percent=scale_error_percent(pseudo_cameras, true_cameras),
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
