"""Error of a pseudo ground truth against the truth of a rendered clip."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmrdata.twins.floor_record import CameraMotion, PersonErrors, SequenceErrors
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import NothingToCompare, StageFailed
from gmrdata.values.motion import deltas, whole_ratio
from gmrdata.values.motion_metrics import (
    orientation_errors_deg,
    posed_vertex_errors_mm,
    translation_errors_mm,
)
from gmrdata.values.transforms import angles_rad, fit_similarity, mean_rotation

MIN_CAMERA_EXTENT_M = 0.05
"""Extent of the true camera path below which a scale can't be read off it [m]."""


def camera_rotation_deg(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """Mean of `camera_angles_deg`; None without cameras."""
    some = len(pseudo_cameras) > 0
    return float(camera_angles_deg(pseudo_cameras, true_cameras).mean()) if some else None


def camera_angles_deg(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> np.ndarray:
    """(n,) angles between world_from_cam (n, 4, 4) after one best rotation of the pseudo world."""
    pseudo_rotmats, true_rotmats = pseudo_cameras[:, :3, :3], true_cameras[:, :3, :3]
    true_from_pseudo = mean_rotation(true_rotmats @ np.swapaxes(pseudo_rotmats, 1, 2))
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_pseudo @ pseudo_rotmats
    return np.asarray(np.rad2deg(angles_rad(residuals)))


def camera_path_mm(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """Mean distance of the centres of world_from_cam (n, 4, 4) after one best rigid transform of
    the pseudo world [mm]; None without cameras.  It is the absolute trajectory error of Sturm et
    al. (2012, section IV-D), as a mean.  The scale is not fitted, so its error counts."""
    if not len(pseudo_cameras):
        return None
    centres_m, true_centres_m = pseudo_cameras[:, :3, 3], true_cameras[:, :3, 3]
    fit = fit_similarity(true_centres_m, centres_m, scale=False)
    return float(np.linalg.norm(fit.apply(centres_m) - true_centres_m, axis=1).mean() * 1000)


def scale_error_percent(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """By how much the pseudo path is too large (> 0) or too small (< 0) in the best similarity fit
    of the centres of world_from_cam (n, 4, 4) [%]; None where the true camera stays within 5 cm, or
    the pseudo cameras have no positions."""
    centres_m, true_centres_m = pseudo_cameras[:, :3, 3], true_cameras[:, :3, 3]
    if len(centres_m) < 2 or _extent_m(true_centres_m) < MIN_CAMERA_EXTENT_M:
        return None
    # Cameras of which only the rotations were recovered all stand in one place.
    if _extent_m(centres_m) < 1e-9:
        return None
    scale = fit_similarity(true_centres_m, centres_m, scale=True).scale
    return 100 * (1 / scale - 1) if scale > 0 else None


def _extent_m(points_m: np.ndarray) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(points_m, axis=0)))


class MotionErrors(NamedTuple):
    """Errors per motion, (n,) each."""

    ome_deg: np.ndarray
    tme_mm: np.ndarray
    vme_mm: np.ndarray  # (0,) without a body


def motion_errors(
    pseudo: Clip,
    true: Clip,
    rows: np.ndarray,
    true_rows: np.ndarray,
    step: int,
    body: BodyModel | None,
) -> MotionErrors:
    """Errors of the motions between frames `step` apart, in all phases, none of them over a gap.
    `rows` of `pseudo`, ascending, may be used; `true_rows` of `true` show the same images."""
    pairs, unbroken = _pairs(rows, true_rows, step)
    if not unbroken.any():
        raise NothingToCompare(
            f"clip {pseudo.id}: no two frames in a row are valid in it and in its truth {true.id}."
            " There is nothing to compare"
        )
    pairs = pairs[unbroken]
    return _errors_between(pseudo, true, rows[pairs], true_rows[pairs], body)


def _pairs(rows: np.ndarray, true_rows: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) in the rows that are `step` apart, and (n,) bool: no frame lacks in between."""
    pairs = np.arange(len(rows) - step)[:, None] + [0, step]
    apart = np.stack([np.diff(rows[pairs])[:, 0], np.diff(true_rows[pairs])[:, 0]])
    return pairs, (apart == step).all(axis=0)


def _errors_between(
    pseudo: Clip, true: Clip, pairs: np.ndarray, true_pairs: np.ndarray, body: BodyModel | None
) -> MotionErrors:
    """Errors of the motions between pairs (n, 2) of each clip's rows."""
    found_deltas, true_deltas = _deltas(pseudo, pairs), _deltas(true, true_pairs)
    vertex_mm = np.zeros(0)
    if body is not None:
        poses = true.motion.local_rotmats[true_pairs[:, 0]]
        vertex_mm = posed_vertex_errors_mm(
            body, true.motion.shape, poses, found_deltas, true_deltas
        )
    return MotionErrors(
        orientation_errors_deg(found_deltas[0], true_deltas[0]),
        translation_errors_mm(found_deltas[1], true_deltas[1]),
        vertex_mm,
    )


def _deltas(clip: Clip, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """dR (n, 3, 3) and dT (n, 3) [m] between pairs (n, 2) of a clip's rows."""
    rotmats, metres = deltas(clip.motion.root_rotmats[pairs], clip.motion.pelvis_m[pairs])
    return rotmats[:, 0], metres[:, 0]


BODY_AXIS_M = 0.5
"""Length that stands for the body's orientation where trajectories are aligned [m]."""


@dataclass(frozen=True, eq=False)
class PseudoGtError:
    """How far a pseudo ground truth is from the truth: cameras as the functions of these names;
    OME, TME and VME as means over motions (eqs. 15-17)."""

    ome_deg: float
    tme_mm: float
    vme_mm: float | None  # of the true body in its true pose: of motion alone; None without a body
    n_motions: int
    camera_rotation_deg: float | None
    camera_path_mm: float | None
    scale_error_percent: float | None
    trajectory_mm: float  # mean distance of the pelvis after `true_from_pseudo`
    frames: int  # with a pseudo ground truth and a truth
    frames_with_camera: int
    true_from_pseudo: np.ndarray  # (4, 4) rigid: fits the bodies' places and orientations best


def compare_clips(
    pseudo: Clip, true: Clip, *, fps_hz: float | None = None, body: BodyModel | None = None
) -> PseudoGtError:
    """Compare a pseudo ground truth with the truth of the same video.

    Rows are paired by image number where both clips have images, by position otherwise.  Motions
    are taken between paired frames that follow each other in both clips, never across a gap.

    The clips' rate is a multiple of `fps_hz`, at which motions are taken; each frame begins one, so
    all phases count.  None is the clips' own rate.  VME needs the true clip's body.

    Raises:
        NothingToCompare: the clips have no two frames in a row in common.
        StageFailed: the clips are not in the world frame, differ in frame rate, or are no multiple
            of `fps_hz`.
    """
    _check_comparable(pseudo, true)
    rows, true_rows = paired_rows(pseudo, true)
    both = pseudo.valid[rows] & true.valid[true_rows]
    rows, true_rows = rows[both], true_rows[both]
    step = _frames_per_motion(true, fps_hz)
    errors = motion_errors(pseudo, true, rows, true_rows, step, body)
    # With the bodies' axes the fit is defined for a person who stands still, too.
    points_m = body_points_m(true, true_rows), body_points_m(pseudo, rows)
    fit = fit_similarity(*points_m, scale=False)
    true_from_pseudo = transforms.rigid(fit.rotmat, fit.translation_m)
    moved_m = transforms.apply(true_from_pseudo, pseudo.motion.pelvis_m[rows])
    distances_m = np.linalg.norm(moved_m - true.motion.pelvis_m[true_rows], axis=1)
    _, pseudo_cameras, true_cameras = _paired_cameras(pseudo, true, rows, true_rows)
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


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors over time, NaN where the pseudo clip has no camera."""

    times_s: np.ndarray  # (T,) of each frame
    motion_times_s: np.ndarray  # (n,) middle of each; below the clip's rate motions overlap
    ome_deg: np.ndarray  # (n,), as is `tme_mm`
    tme_mm: np.ndarray
    camera_rotation_deg: np.ndarray  # (T,) after one best rotation of the recovered world


def error_series(pseudo: Clip, true: Clip, *, fps_hz: float | None = None) -> ErrorSeries:
    """What `compare_clips` gives the means of, frame by frame."""
    rows, true_rows = paired_rows(pseudo, true)
    step = _frames_per_motion(true, fps_hz)
    if len(rows) <= step:
        what = f"it and its truth {true.id} have no image in common, or too few for one motion"
        raise NothingToCompare(f"clip {pseudo.id}: {what}. There is nothing to compare")
    good = has_camera(pseudo)[rows] & true.valid[true_rows]
    pairs, unbroken = _pairs(rows, true_rows, step)
    # Every frame of the span must be good: no motion goes over a gap.
    whole = unbroken & np.lib.stride_tricks.sliding_window_view(good, step + 1).all(axis=1)
    errors = _errors_between(pseudo, true, rows[pairs], true_rows[pairs], None)
    times_s = (true_rows - true_rows[0]) / true.motion.fps_hz
    camera_deg = np.full(len(rows), np.nan)
    both, *cameras = _paired_cameras(pseudo, true, rows, true_rows)
    if both.any():
        camera_deg[both] = camera_angles_deg(*cameras)
    return ErrorSeries(
        times_s=times_s,
        motion_times_s=times_s[pairs].mean(axis=1),
        ome_deg=np.where(whole, errors.ome_deg, np.nan),
        tme_mm=np.where(whole, errors.tme_mm, np.nan),
        camera_rotation_deg=camera_deg,
    )


def has_camera(pseudo: Clip) -> np.ndarray:
    """(T,) bool: frames of a pseudo clip with a valid motion and a camera, if it has any."""
    return pseudo.valid if pseudo.camera is None else pseudo.valid & pseudo.camera.has_camera


def _check_comparable(pseudo: Clip, true: Clip) -> None:
    for clip in (pseudo, true):
        if clip.motion.frame != "world":
            raise StageFailed(f"clip {clip.id}: not in the world frame. Give a clip with a world")
    if abs(pseudo.motion.fps_hz - true.motion.fps_hz) > 1e-6 * true.motion.fps_hz:
        raise StageFailed(
            f"clip {pseudo.id}: {pseudo.motion.fps_hz:g} fps, but its truth {true.id} has"
            f" {true.motion.fps_hz:g} fps. Compare clips of one video"
        )


def paired_rows(pseudo: Clip, true: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the two clips that show the same image."""
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


def _frames_per_motion(clip: Clip, fps_hz: float | None) -> int:
    step = 1 if fps_hz is None else whole_ratio(clip.motion.fps_hz, fps_hz)
    if step is None:
        raise StageFailed(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no multiple of {fps_hz:g} fps."
            " Resample both clips first"
        )
    return step


def body_points_m(clip: Clip, rows: np.ndarray) -> np.ndarray:
    """Pelvis, and the points half a metre from it along the body's axes: (4 * rows, 3) [m]."""
    axes_m = BODY_AXIS_M * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    world_from_root = transforms.rigid(clip.motion.root_rotmats[rows], clip.motion.pelvis_m[rows])
    points_root_m = np.broadcast_to(axes_m, (len(rows), *axes_m.shape))
    return transforms.apply(world_from_root, points_root_m).reshape(-1, 3)


def _paired_cameras(
    pseudo: Clip, true: Clip, rows: np.ndarray, true_rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which pairs have a camera in both clips, and world_from_cam of those: (n, 4, 4) each."""
    if pseudo.camera is None or true.camera is None:
        return np.zeros(len(rows), dtype=bool), np.zeros((0, 4, 4)), np.zeros((0, 4, 4))
    both = has_camera(pseudo)[rows] & true.camera.has_camera[true_rows]
    true_cameras = true.camera.world_from_cam[true_rows[both]]
    return both, pseudo.camera.world_from_cam[rows[both]], true_cameras


FPS_HZ = 10.0
"""Rate of the scores; clips have three times as much, so all three phases count."""
OF_PERSON = ("ome_deg", "tme_mm", "vme_mm", "camera_rotation_deg", "camera_path_mm")


@dataclass(frozen=True)
class RecoveredSequence:
    """What is known of a recovered sequence beside its clips."""

    id: str
    class_true: str  # what its camera does
    accepted: bool
    seconds: float
    class_measured: CameraMotion | None = None
    scale: float | None = None  # metres per unit of the recovered path
    scale_sigma: float | None = None  # its stated standard error
    reasons: Sequence[str] = ()


def sequence_errors(
    sequence: RecoveredSequence,
    clips: Sequence[Clip],
    truth: Sequence[Clip],
    body: BodyModel | None = None,
) -> SequenceErrors:
    """Figures of one sequence whose people, if any, were recovered in the order of `truth`."""
    n_frames = truth[0].motion.n_frames
    recovered = [*clips, *[None] * (len(truth) - len(clips))]
    people = [_person(clip, true, body) for clip, true in zip(recovered, truth, strict=True)]
    scale_error = max(_known(people, "scale_error_percent"), key=abs, default=None)
    return SequenceErrors(
        id=sequence.id,
        class_true=sequence.class_true,
        class_measured=sequence.class_measured,
        accepted=sequence.accepted,
        frames=n_frames,
        kept_share=sum(person.kept_frames for person in people) / (n_frames * len(truth)),
        **{key: max(_known(people, key), default=None) for key in OF_PERSON},
        scale_error_percent=scale_error,
        scale_within_2sigma=within_2sigma(scale_error, sequence.scale, sequence.scale_sigma),
        seconds=round(sequence.seconds, 2),
        people=tuple(people),
        reasons=tuple(sequence.reasons),
    )


def within_2sigma(
    scale_error_percent: float | None, scale: float | None, sigma: float | None
) -> bool | None:
    """Whether the true scale is inside the stated error bar; None where there is none."""
    if scale_error_percent is None or scale is None or sigma is None:
        return None
    true_scale = scale / (1 + scale_error_percent / 100)
    return bool(abs(scale - true_scale) <= 2 * sigma)


def _person(clip: Clip | None, true: Clip, body: BodyModel | None) -> PersonErrors:
    """Errors of one person; none where no two kept frames follow each other."""
    error = None
    if clip is not None and clip.motion.frame == "world" and clip.valid.any():
        with suppress(NothingToCompare):
            error = compare_clips(clip, true, fps_hz=FPS_HZ, body=body)
    return PersonErrors(
        id=true.id,
        kept_frames=0 if clip is None else int(clip.valid.sum()),
        n_motions=0 if error is None else error.n_motions,
        **{key: getattr(error, key, None) for key in (*OF_PERSON, "scale_error_percent")},
    )


def _known(people: Sequence[PersonErrors], key: str) -> list[float]:
    return [error for person in people if (error := getattr(person, key)) is not None]
