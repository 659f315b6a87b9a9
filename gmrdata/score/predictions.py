"""Predictions beside their truth, whoever predicted: a trained network, or files in a folder."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.gmr.runs import UsableClip, runs_at
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.motion import Motion, whole_ratio
from gmrdata.values.motion_deltas import accumulate

if TYPE_CHECKING:
    from gmrdata.gmr.predict import TrainedGmr


@dataclass(frozen=True, eq=False)
class PredictedRun:
    """A person over consecutive frames without a gap: the truth and a prediction of it."""

    true: Motion
    predicted: Motion  # the same frames at the same rate, in a world of the prediction's own


World = tuple[PredictedRun, ...]  # runs, in the order of time, whose predictions share one world


@dataclass(frozen=True, eq=False)
class PredictedClip:
    """A clip's predictions."""

    clip_id: str
    camera_motion: str
    runs: tuple[PredictedRun, ...]  # for OME, TME, VME and vertex error over time, at their rate
    worlds: tuple[World, ...]  # for a protocol, at the prediction's own rate
    dropped_frames: int = 0  # valid frames, at the prediction's rate, without a prediction


def still_motion(true: Motion, first: Motion) -> Motion:
    """Zero motion: the body stays where `first` is at first."""
    return replace(
        true,
        root_rotmats=np.tile(first.root_rotmats[0], (true.n_frames, 1, 1)),
        pelvis_m=np.tile(first.pelvis_m[0], (true.n_frames, 1)),
    )


def network_clip(gmr: "TrainedGmr", one: UsableClip, *, all_phases: bool) -> PredictedClip | str:
    """What a network sees in runs of valid frames, from their true first poses; or why nothing."""
    from gmrdata.gmr.predict import predict_deltas

    runs = []
    for true in runs_at(one.clip, gmr.fps_hz, all_phases=all_phases):
        found = predict_deltas(gmr, true.local_rotmats)
        root_rotmats, pelvis_m = accumulate(*found, true.root_rotmats[0], true.pelvis_m[0])
        predicted = replace(true, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
        runs.append(PredictedRun(true, predicted))
    if not runs:
        return f"no two valid frames in a row at {gmr.fps_hz:g} fps"
    return PredictedClip(one.clip.id, one.camera_motion, tuple(runs), tuple((run,) for run in runs))


def file_clip(
    folder: Path,
    one: UsableClip,
    fps_hz: float,
    *,
    protocol_fps_hz: float | None = None,
    all_phases: bool = False,
    drop_missing: bool = False,
) -> PredictedClip | str:
    """A clip beside `<clip id>.npz` of a folder; the reason where there is no prediction.

    The file is a clip as `save_clip` writes it, in a world of its own.  Its row i is the truth's
    row i, or row k i where the truth's rate is k times the prediction's.

    Args:
        fps_hz: Rate of OME, TME and VME [Hz].
        protocol_fps_hz: Rate of a protocol's figures [Hz], which is taken where the prediction's is
            a multiple of it; the prediction's own otherwise.
        drop_missing: Whether clips and true frames without a prediction are dropped, the frames
            counted; they are an error otherwise.
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder of predictions")
    path = folder / f"{one.clip.id}.npz"
    if not path.is_file():
        reason = f"no prediction {path.name}"
        if drop_missing:
            return reason
        raise BadMotionFile(
            f"{folder}: {reason}. Predict this clip too, or pass --missing drop to leave it out"
        )
    predicted = load_clip(path)
    true = _at_its_rate(path, predicted, one.clip)
    true, predicted, n_missing = _with_both(path, true, predicted, drop_missing=drop_missing)
    runs = _paired(true, predicted, fps_hz, all_phases=all_phases)
    if not runs:
        return f"no two frames in a row with a prediction at {fps_hz:g} fps"
    world_hz = predicted.motion.fps_hz
    if protocol_fps_hz is not None and whole_ratio(world_hz, protocol_fps_hz) is not None:
        world_hz = protocol_fps_hz
    world = _paired(true, predicted, world_hz, all_phases=False)
    return PredictedClip(one.clip.id, one.camera_motion, runs, (world,), n_missing)


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
    n = min(true.motion.n_frames, predicted.motion.n_frames)
    valid = (true.valid & has)[:n]
    # By its path, so that what is said of it names the file.
    parts = (_first_rows(true, true.id, valid), _first_rows(predicted, str(path), valid))
    return *parts, int(missing.size)


def _at_its_rate(path: Path, predicted: Clip, true: Clip) -> Clip:
    """The truth at the rate of a prediction that fits it."""
    if predicted.id != true.id:
        raise BadMotionFile(
            f"{path}: holds clip {predicted.id}. Name each file by the id of its clip"
        )
    if predicted.motion.frame != "world":
        raise BadMotionFile(
            f"{path}: its motion is in the camera's frame. Give predictions in the world"
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
    motion = true.motion.take(slice(0, None, step), true.motion.fps_hz / step)
    return replace(true, motion=motion, valid=valid, image_numbers=rows, camera=None)


def _first_rows(clip: Clip, name: str, valid: np.ndarray) -> Clip:
    n = len(valid)
    return Clip(name, clip.motion.take(slice(0, n)), valid, np.full(n, -1), None)


def _paired(
    true: Clip, predicted: Clip, fps_hz: float, *, all_phases: bool
) -> tuple[PredictedRun, ...]:
    runs = (runs_at(clip, fps_hz, all_phases=all_phases) for clip in (true, predicted))
    return tuple(PredictedRun(*both) for both in zip(*runs, strict=True))
