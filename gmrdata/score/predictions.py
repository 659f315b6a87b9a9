"""Predictions beside their truth, whoever predicted: a trained network, or files in a folder."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.gmr.runs import UsableClip, check_rate, run_slices, runs_at
from gmrdata.motion.resample import valid_runs
from gmrdata.values.body import BodyModel, on_body
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion, accumulate, whole_ratio
from gmrdata.world.compose import motion_in_world

if TYPE_CHECKING:
    from gmrdata.gmr.predict import TrainedGmr


@dataclass(frozen=True, eq=False)
class PredictedRun:
    """A person over consecutive frames without a gap: the truth and a prediction of it."""

    true: Motion
    predicted: Motion  # the same frames at the same rate, in a world of the prediction's own
    true_cam_rotmats: np.ndarray | None = None  # (T, 3, 3) cam_from_world of the truth
    predicted_cam_rotmats: np.ndarray | None = None
    """(T, 3, 3) the same of the prediction's own camera and world; None where it has none."""
    frames: np.ndarray | None = None  # (T,) number of each frame in the video, from 0


@dataclass(frozen=True)
class Pairing:
    """How predictions are laid beside the truth."""

    fps_hz: float
    """Rate of OME, TME and VME [Hz]; a network has its own."""
    protocol_fps_hz: float | None = None
    """Rate of a protocol's figures [Hz], which is taken where the prediction's is a multiple of it;
    the prediction's own otherwise."""
    smoothing_frames: float = 0.0
    """Standard deviation of the Gaussian that smooths the predicted path for a protocol first, in
    frames of its rate; 0 for none."""
    all_phases: bool = False
    """Whether a clip of a higher rate gives all its phases, or the first."""
    drop_missing: bool = False
    """Whether clips and true frames without a prediction are dropped, the frames counted; they are
    an error otherwise."""


World = tuple[PredictedRun, ...]  # runs, in the order of time, whose predictions share one world


@dataclass(frozen=True, eq=False)
class PredictedClip:
    """A clip's predictions."""

    clip_id: str
    camera_motion: str
    runs: tuple[PredictedRun, ...]  # for OME, TME, VME and vertex error over time, at their rate
    worlds: tuple[World, ...]  # for a protocol, at its rate; none where all runs are too short
    dropped_frames: int = 0  # valid frames, at the prediction's rate, without a prediction
    camera_paths_m: tuple[np.ndarray, np.ndarray] | None = None
    """(N, 3) the prediction's own camera and the true one, in the frames that both have [m]."""
    video_frames: tuple[int, int] = (0, 0)
    """The clip's first frame in the video, and one past its last, at the rate of `worlds`."""
    took_true_camera: bool = False
    """Whether it is in the camera's frame, without one, and the truth's took it to the world."""


def on_its_body(predicted: PredictedClip, body: BodyModel) -> PredictedClip:
    """The same with as many shape coefficients as the prediction's body; itself if it has them."""
    if predicted.runs[0].predicted.shape.size == body.n_shape:
        return predicted

    def fitting(runs: tuple[PredictedRun, ...]) -> tuple[PredictedRun, ...]:
        return tuple(replace(run, predicted=on_body(run.predicted, body)) for run in runs)

    return replace(
        predicted, runs=fitting(predicted.runs), worlds=tuple(map(fitting, predicted.worlds))
    )


def still_motion(true: Motion, first: Motion) -> Motion:
    """Zero motion: the body stays where `first` is at first."""
    return replace(
        true,
        root_rotmats=np.tile(first.root_rotmats[0], (true.n_frames, 1, 1)),
        pelvis_m=np.tile(first.pelvis_m[0], (true.n_frames, 1)),
    )


def network_clip(gmr: "TrainedGmr", one: UsableClip, how: Pairing) -> PredictedClip | str:
    """What a network sees in runs of valid frames, from their true first poses; or why nothing."""
    from gmrdata.gmr.predict import predict_deltas

    runs, all_phases = [], how.all_phases
    for true in runs_at(one.clip, gmr.fps_hz, all_phases=all_phases):
        motions = predict_deltas(gmr, true.local_rotmats)
        root_rotmats, pelvis_m = accumulate(*motions, true.root_rotmats[0], true.pelvis_m[0])
        predicted = replace(true, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
        runs.append(PredictedRun(true, predicted))
    if not runs:
        return f"no two valid frames in a row at {gmr.fps_hz:g} fps"
    smoothed = [_smoothed(run.predicted, how.smoothing_frames) for run in runs]
    cameras = _cam_rotmats(one.clip, gmr.fps_hz, all_phases=all_phases)
    worlds = tuple(
        (replace(run, predicted=predicted, true_cam_rotmats=seen),)
        for run, predicted, seen in zip(runs, smoothed, cameras, strict=True)
    )
    return PredictedClip(one.clip.id, one.camera_motion, tuple(runs), worlds)


def rows_between(valid: np.ndarray, step: int, n_rows: int) -> np.ndarray:
    """(T,) bool: rows of a clip up to each `step`-th that a file has as `valid` (N,), from the one
    before on."""
    at = -(-np.arange(n_rows) // step)
    return np.asarray((at < len(valid)) & valid[at.clip(max=len(valid) - 1)])


def whole_steps(valid: np.ndarray, step: int) -> np.ndarray:
    """(T,) bool: `valid` (T,) rows from a `step`-th row to another without a gap between."""
    rows, known = every_row(valid, step)
    kept = np.zeros(len(valid), dtype=bool)
    for first, stop in valid_runs(known):
        kept[rows[first] : rows[stop - 1] + 1] = True
    return kept


def on_rows(predicted: Clip, true: Clip, wanted: np.ndarray) -> Clip:
    """A prediction at a clip's rate or a k-th of it, with its body and its camera on `wanted` (T,)
    rows of it alone."""
    step = whole_ratio(true.motion.fps_hz, predicted.motion.fps_hz) or 1
    rows = wanted[::step][: predicted.motion.n_frames]
    valid = predicted.valid.copy()
    valid[: len(rows)] &= rows
    camera = predicted.camera
    if camera is not None:
        camera = replace(camera, has_camera=camera.has_camera & valid)
    return replace(predicted, valid=valid, camera=camera)


def known_rows(path: Path, predicted: Clip, true: Clip) -> np.ndarray:
    """(N,) bool: rows that a prediction has in the world, as `clip_beside_truth` takes them."""
    return _in_world(path, predicted, _at_its_rate(path, predicted, true)).valid


def file_clip(
    folder: Path, one: UsableClip, how: Pairing, shared: Callable[[Clip], np.ndarray] | None = None
) -> PredictedClip | str:
    """A clip beside `<clip id>.npz` of a folder; the reason where it can't be scored.

    The file is a clip as `save_clip` writes it, in a world of its own, or in the camera's frame:
    then its own camera puts it into the world, or the truth's where it has none.  Its row i is the
    truth's row i, or row k i where the truth's rate is k times the prediction's.  Its local pose
    and shape count in VME and in a protocol.  `shared` gives the truth's rows (T,) bool to take.
    """
    path = folder / f"{one.clip.id}.npz"
    predicted = load_clip(path)
    if shared is not None:
        predicted = on_rows(predicted, one.clip, shared(one.clip))
    return clip_beside_truth(path, predicted, one, how)


def clip_beside_truth(
    path: Path, predicted: Clip, one: UsableClip, how: Pairing
) -> PredictedClip | str:
    """A predicted clip beside the true one, as `file_clip` says; `path` is of its file."""
    true = _at_its_rate(path, predicted, one.clip)
    remedy = f"Predict at a higher rate, or pass --fps-hz {predicted.motion.fps_hz:g}"
    check_rate(str(path), predicted.motion.fps_hz, how.fps_hz, remedy)
    paths_m = _camera_paths(predicted, true)
    took_true_camera = predicted.motion.frame == "camera" and predicted.camera is None
    whole = predicted = _in_world(path, predicted, true)
    true, predicted, n_missing = _with_both(path, true, predicted, drop_missing=how.drop_missing)
    runs = _paired(true, predicted, how.fps_hz, all_phases=how.all_phases)
    if not runs:
        return f"no two frames in a row with a prediction at {how.fps_hz:g} fps"
    world_hz = predicted.motion.fps_hz
    if how.protocol_fps_hz is not None and whole_ratio(world_hz, how.protocol_fps_hz) is not None:
        world_hz = how.protocol_fps_hz
    if how.smoothing_frames > 0:
        whole = _smoothed_clip(whole, how.smoothing_frames * whole.motion.fps_hz / world_hz)
        predicted = _first_rows(whole, str(path), predicted.valid)
    numbers = _frame_numbers(one.clip, world_hz)
    world = _world(true, predicted, world_hz, numbers)
    return PredictedClip(
        one.clip.id,
        one.camera_motion,
        runs,
        (world,) if world else (),
        n_missing,
        paths_m,
        (int(numbers[0]), int(numbers[-1]) + 1),
        took_true_camera,
    )


def every_row(valid: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows 0, step, 2 step, ..., and which are valid: those with no gap since the one before."""
    rows = np.arange(0, len(valid), step)
    return rows, np.array([valid[max(0, row - step + 1) : row + 1].all() for row in rows])


def _with_both(
    path: Path, true: Clip, predicted: Clip, *, drop_missing: bool
) -> tuple[Clip, Clip, int]:
    """Both on the rows that both have, and how many valid rows have no prediction."""
    has = np.zeros(true.motion.n_frames, bool)
    has[: predicted.motion.n_frames] = predicted.valid[: len(has)]
    missing = np.flatnonzero(true.valid & ~has)
    if missing.size and not drop_missing:
        raise BadMotionFile(
            f"{path}: no prediction for {missing.size} of {int(true.valid.sum())} valid frames, "
            f"the first is row {missing[0]}. Predict them, or pass --missing drop to leave them out"
        )
    valid = (true.valid & has)[: predicted.motion.n_frames]
    # By its path, so that what is said of it names the file.
    parts = (_first_rows(true, true.id, valid), _first_rows(predicted, str(path), valid))
    return *parts, int(missing.size)


def _at_its_rate(path: Path, predicted: Clip, true: Clip) -> Clip:
    """The truth at the rate of a prediction that fits it."""
    if predicted.id != true.id:
        raise BadMotionFile(
            f"{path}: holds clip {predicted.id}. Name each file by the id of its clip"
        )
    step = whole_ratio(true.motion.fps_hz, predicted.motion.fps_hz)
    if step is None:
        raise BadMotionFile(
            f"{path}: {predicted.motion.fps_hz:g} fps, but the truth's {true.motion.fps_hz:g} fps "
            "is no multiple of that. Resample the prediction to the truth's rate"
        )
    n_rows = -(-true.motion.n_frames // step)
    if predicted.motion.n_frames > n_rows:
        raise BadMotionFile(
            f"{path}: {predicted.motion.n_frames} frames, but the clip has {n_rows} at "
            f"{predicted.motion.fps_hz:g} fps. Give one row for each row of the clip"
        )
    rows, valid = every_row(true.valid, step)
    taken = true.take(rows, true.motion.fps_hz / step)
    return replace(taken, valid=valid, image_numbers=rows)


def _in_world(path: Path, predicted: Clip, true: Clip) -> Clip:
    """A prediction in the camera's frame, in its own camera's world, or else in the truth's."""
    motion, n = predicted.motion, predicted.motion.n_frames
    if motion.frame == "world":
        return predicted
    camera = predicted.camera or (None if true.camera is None else true.camera.at_rows(slice(n)))
    if camera is None:
        raise BadMotionFile(
            f"{path}: its motion is in the camera's frame, and neither it nor the clip has a "
            "camera. Give a prediction in the world, or one with its camera"
        )
    in_world, valid = motion_in_world(motion, camera.world_from_cam), camera.has_camera
    return replace(predicted, motion=in_world, valid=predicted.valid & valid, camera=camera)


def _camera_paths(predicted: Clip, true: Clip) -> tuple[np.ndarray, np.ndarray] | None:
    """The prediction's own camera and the true one in the frames that both have, if three do.

    None too where the prediction was given the true camera: its error of 0 would say nothing.
    """
    if predicted.camera is None or true.camera is None:
        return None
    n = predicted.camera.n_frames
    both = predicted.camera.has_camera & true.camera.has_camera[:n]
    paths_m = predicted.camera.centres_world_m[both], true.camera.centres_world_m[:n][both]
    return None if both.sum() < 3 or np.array_equal(*paths_m) else paths_m


def _first_rows(clip: Clip, name: str, valid: np.ndarray) -> Clip:
    return replace(clip.take(slice(len(valid))), id=name, valid=valid)


def _frame_numbers(clip: Clip, fps_hz: float) -> np.ndarray:
    """Numbers of a clip's rows among the video's frames at a rate of which its own is a multiple.

    They are those of its images, which may be every other one, or of its rows where it has none; a
    row without an image counts from one that has.
    """
    numbers, step = clip.image_numbers, whole_ratio(clip.motion.fps_hz, fps_hz) or 1
    rows, known = np.arange(len(numbers)), np.flatnonzero(numbers >= 0)
    if not known.size:
        return np.asarray(rows[::step] // step)
    apart = np.diff(numbers[known]) / np.diff(known)
    stride = max(1, round(float(np.median(apart)))) if apart.size else 1
    before = known[(np.searchsorted(known, rows, side="right") - 1).clip(min=0)]
    numbers = numbers[before] + stride * (rows - before)
    return np.asarray(numbers[::step] // (stride * step))


def _world(true: Clip, predicted: Clip, fps_hz: float, numbers: np.ndarray) -> World:
    """The runs of one world, with their cameras and `numbers` of the frames at its rate."""
    runs = _paired(true, predicted, fps_hz, all_phases=False)
    cameras = (_cam_rotmats(clip, fps_hz, all_phases=False) for clip in (true, predicted))
    # A whole ratio; the numbers are of every step-th row from the first one on.
    step = whole_ratio(true.motion.fps_hz, fps_hz) or 1
    rows = [np.arange(len(true.valid))[of_run] for of_run in run_slices(true.valid, step, 1)]
    return tuple(
        replace(
            run,
            true_cam_rotmats=true_camera,
            predicted_cam_rotmats=own_camera,
            frames=numbers[of_run // step],
        )
        for run, of_run, true_camera, own_camera in zip(runs, rows, *cameras, strict=True)
    )


def _cam_rotmats(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[np.ndarray] | list[None]:
    """cam_from_world rotations (T, 3, 3) of each of the runs that `runs_at` takes, at their times;
    None for all unless all frames have one."""
    camera, motion = clip.camera, clip.motion
    known = np.zeros_like(clip.valid) if camera is None else camera.has_camera
    seen = np.tile(np.eye(3), (motion.n_frames, 1, 1))
    if camera is not None:
        seen[known] = camera.world_from_cam[known, :3, :3]
    # The camera in the root's place, and whether it is known in the pelvis's.
    looks = replace(motion, root_rotmats=seen, pelvis_m=np.tile(1.0 * known[:, None], 3))
    runs = runs_at(replace(clip, motion=looks), fps_hz, all_phases=all_phases)
    if any((run.pelvis_m < 1).any() for run in runs):
        return [None] * len(runs)
    return [np.swapaxes(run.root_rotmats, 1, 2) for run in runs]


def _smoothed_clip(clip: Clip, sigma_rows: float) -> Clip:
    """A prediction whose path is smoothed within each of its unbroken runs."""
    pelvis_m = clip.motion.pelvis_m.copy()
    for start, stop in valid_runs(clip.valid):
        part = clip.motion.take(slice(start, stop))
        pelvis_m[start:stop] = _smoothed(part, sigma_rows).pelvis_m
    return replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m))


def _smoothed(motion: Motion, sigma_rows: float) -> Motion:
    """A motion whose path went through a Gaussian, as traj_filter of yufu-wang/tram does it."""
    if sigma_rows <= 0:
        return motion
    from scipy.ndimage import gaussian_filter1d

    return replace(motion, pelvis_m=gaussian_filter1d(motion.pelvis_m, sigma_rows, axis=0))


def _paired(
    true: Clip, predicted: Clip, fps_hz: float, *, all_phases: bool
) -> tuple[PredictedRun, ...]:
    runs = (runs_at(clip, fps_hz, all_phases=all_phases) for clip in (true, predicted))
    return tuple(PredictedRun(*both) for both in zip(*runs, strict=True))
