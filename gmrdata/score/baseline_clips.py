"""What every baseline predicts for, and writes: a world-frame clip for each clip of the manifest.

out/predictions/<clip id>.npz   the predicted motion: one row for each row of the clip, or for
                                every k-th where the method works at a lower frame rate
out/predictions.json            method, clips with their figures, clips left out with the reason
out/stage.json                  recipe, inputs, versions
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.gmr.runs import usable_files
from gmrdata.motion.resample import valid_runs
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile, StageFailed
from gmrdata.values.files import read_npz, resolve_inside
from gmrdata.values.motion import Motion
from gmrdata.values.motion_deltas import accumulate
from gmrdata.values.records import Config, Record


@dataclass(frozen=True, eq=False)
class Subject:
    """A clip of the manifest, and what writing another motion of the same body takes."""

    clip: Clip  # the clip; `valid` is False outside the manifest's kept ranges, and True somewhere
    rest_pelvis_m: np.ndarray  # (3,) J0 of its body and shape, rest frame [m]


def manifest_subjects(path: Path) -> tuple[list[Subject], dict[str, str]]:
    """The clips of a manifest, and the reason by id of those that can't be used."""
    files, left_out, _ = usable_files(path)
    subjects = []
    for file in files:
        clip = file.load()
        if clip.valid.any():
            arrays = read_npz(resolve_inside(path.parent, file.entry.arrays.path))
            subjects.append(Subject(clip, arrays["rest_pelvis_m"]))
        else:
            left_out[clip.id] = "no frame is valid"
    return subjects, left_out


def first_pose(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Root rotation (3, 3) and pelvis (3,) [m] of the first valid row, where baselines begin."""
    row = int(np.argmax(clip.valid))
    root_rotmat, pelvis_m = clip.motion.root_rotmats[row], clip.motion.pelvis_m[row]
    if not (np.isfinite(root_rotmat).all() and np.isfinite(pelvis_m).all()):
        remedy = "Mark such frames as not valid, or make the clip again"
        raise BadMotionFile(f"clip {clip.id}: frame {row} holds NaN or infinite numbers. {remedy}")
    return root_rotmat, pelvis_m


def roots_of_runs(
    valid: np.ndarray,
    start: tuple[np.ndarray, np.ndarray],
    motions_of: Callable[[slice], tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray]:
    """Roots (T, 3, 3) and pelves (T, 3) [m] of the rows that are `valid` (T,); NaN elsewhere.

    A run begins where the one before it ended, since nothing is known of the gap.  `start` is the
    pose of the first valid row; `motions_of` gives dR (n-1, 3, 3) and dT (n-1, 3) [m] of n rows.
    """
    root_rotmats, pelvis_m = np.full((len(valid), 3, 3), np.nan), np.full((len(valid), 3), np.nan)
    for first, stop in valid_runs(valid):
        rows = slice(first, stop)
        root_rotmats[rows], pelvis_m[rows] = accumulate(*motions_of(rows), *start)
        start = root_rotmats[stop - 1], pelvis_m[stop - 1]
    return root_rotmats, pelvis_m


FOLDER = "predictions"
RECORD = "predictions.json"


class ClipFigures(Config):
    """What the record says of a clip."""

    fps_hz: float  # rate of its predicted motion [Hz]
    n_frames: int
    n_valid: int  # those that are predicted


class MethodFigures(Config):
    """What the record says of a method: nothing, but for those with a class of their own."""


class NetworkFigures(MethodFigures):
    """A method that uses a trained network."""

    run: str  # name of its run folder


class Predictions(Record):
    """A `predictions.json`; methods with figures of their own have a class of their own."""

    format: Literal["gmrdata-predictions/1"] = "gmrdata-predictions/1"
    method: str
    figures: MethodFigures  # what there is to say of the method
    clips: Mapping[str, ClipFigures]  # clips that are predicted, by id
    left_out: dict[str, str]  # why clips are not predicted, by id


class NetworkPredictions(Predictions):
    """Of a method that uses a trained network."""

    figures: NetworkFigures


@dataclass(frozen=True, eq=False)
class Prediction:
    """One clip's predicted world motion."""

    clip: Clip  # the motion, without camera
    rest_pelvis_m: np.ndarray  # (3,) J0 of its body and shape, rest frame [m]
    figures: Mapping[str, object]  # what the method's record says of a clip besides `ClipFigures`


def predicted(
    subject: Subject,
    motion: Motion,
    valid: np.ndarray,
    *,
    step: int = 1,
    rest_pelvis_m: np.ndarray | None = None,
    figures: Mapping[str, object] | None = None,
) -> Prediction:
    """A prediction for a subject: a world motion of its rows 0, step, 2 step, ..., where `valid`.

    `rest_pelvis_m` (3,) is J0 of the predicted body and shape [m]; None where those are the
    subject's.
    """
    clip = Clip(subject.clip.id, motion, valid, subject.clip.image_numbers[::step], camera=None)
    rest_m = subject.rest_pelvis_m if rest_pelvis_m is None else rest_pelvis_m
    return Prediction(clip, rest_m, figures or {})


def write_predictions(
    folder: Path,
    method: str,
    predictions: Sequence[Prediction],
    left_out: Mapping[str, str],
    record: type[Predictions] = Predictions,
    figures: MethodFigures | None = None,
) -> None:
    """Write a baseline's folder, with a `predictions.json` of the class `record`.

    `left_out` is the reason by id for which clips have no prediction, `figures` what the record
    says of the method.  StageFailed where there are no predictions.
    """
    if not predictions:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in sorted(left_out.items()))
        raise StageFailed(f"{method}: nothing to predict in any clip. {reasons}")
    for one in predictions:
        path = resolve_inside(folder, f"{FOLDER}/{one.clip.id}.npz")
        save_clip(path, _blanked(one.clip), one.rest_pelvis_m)
    said = {
        "method": method,
        "figures": figures or MethodFigures(),
        "clips": {one.clip.id: _clip_figures(one) for one in predictions},
        "left_out": left_out,
    }
    record.model_validate(said).write(folder / RECORD)


def _clip_figures(one: Prediction) -> dict[str, object]:
    motion, valid = one.clip.motion, one.clip.valid
    counts = {"n_frames": motion.n_frames, "n_valid": int(valid.sum())}
    return {"fps_hz": motion.fps_hz} | counts | dict(one.figures)


def _blanked(clip: Clip) -> Clip:
    """NaN for root and pelvis of rows that are not predicted, so that no one takes them for it."""
    motion, valid = clip.motion, clip.valid
    return replace(
        clip,
        motion=replace(
            motion,
            root_rotmats=np.where(valid[:, None, None], motion.root_rotmats, np.nan),
            pelvis_m=np.where(valid[:, None], motion.pelvis_m, np.nan),
        ),
    )
