"""What every baseline writes: a world-frame clip for each clip of the manifest, and a record.

out/predictions/<clip id>.npz   the predicted motion: one row for each row of the clip, or for
                                every k-th where the method works at a lower frame rate
out/predictions.json            method, clips with their figures, clips left out with the reason
out/stage.json                  recipe, inputs, versions

The people of a manifest whose motion is to be predicted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.gmr.runs import usable_files
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile, StageFailed
from gmrdata.values.files import read_npz, resolve_inside, write_json
from gmrdata.values.motion import Motion


@dataclass(frozen=True, eq=False)
class Subject:
    """A clip of the manifest, and what writing another motion of the same body takes."""

    clip: Clip
    """The clip; `valid` is False outside the manifest's kept ranges, and True somewhere."""
    rest_pelvis_m: np.ndarray
    """(3,) J0 of its body and shape, rest frame [m]."""


def manifest_subjects(path: Path) -> tuple[list[Subject], dict[str, str]]:
    """The clips of a manifest, and the reason by id of those that can't be used.

    Raises:
        MissingInput: the manifest or a clip's file is not there.
        BadManifest: the manifest is broken, or only a list.
        BadMotionFile: a clip's file is broken.
    """
    files, left_out = usable_files(path)
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
    """Root rotation (3, 3) and pelvis (3,) [m] of the first valid row.

    A baseline that knows motions alone begins here; no error of motions sees where it begins.

    Raises:
        BadMotionFile: that row holds NaN or infinite numbers.
    """
    row = int(np.argmax(clip.valid))
    root_rotmat, pelvis_m = clip.motion.root_rotmats[row], clip.motion.pelvis_m[row]
    if not (np.isfinite(root_rotmat).all() and np.isfinite(pelvis_m).all()):
        raise BadMotionFile(
            f"clip {clip.id}: frame {row} holds NaN or infinite numbers. Mark such frames as not"
            " valid, or make the clip again"
        )
    return root_rotmat, pelvis_m


FORMAT = "gmrdata-predictions/1"
FOLDER = "predictions"
RECORD = "predictions.json"


@dataclass(frozen=True, eq=False)
class Prediction:
    """One clip's predicted world motion."""

    clip: Clip
    """The motion, without camera."""
    rest_pelvis_m: np.ndarray
    """(3,) J0 of its body and shape, rest frame [m]."""
    figures: Mapping[str, Any]
    """What the record says of it besides, as JSON values."""


def predicted(
    subject: Subject,
    motion: Motion,
    valid: np.ndarray,
    *,
    step: int = 1,
    rest_pelvis_m: np.ndarray | None = None,
    figures: Mapping[str, Any] | None = None,
) -> Prediction:
    """A prediction for a subject.

    Args:
        subject: Whose motion is predicted.
        motion: The prediction, `frame` "world", with the subject's rows 0, step, 2 step, ...
        valid: (T,) bool: rows that are predicted.
        step: The subject's rows for one of the prediction.
        rest_pelvis_m: (3,) J0 of the predicted body and shape [m]; None where those are the
            subject's.
        figures: See `Prediction`.
    """
    clip = Clip(subject.clip.id, motion, valid, subject.clip.image_numbers[::step], camera=None)
    rest_m = subject.rest_pelvis_m if rest_pelvis_m is None else rest_pelvis_m
    return Prediction(clip, rest_m, figures or {})


def write_predictions(
    folder: Path,
    method: str,
    predictions: Sequence[Prediction],
    left_out: Mapping[str, str],
    figures: Mapping[str, Any] | None = None,
) -> None:
    """Write a baseline's folder.

    Args:
        folder: The stage's folder.
        method: The baseline's name.
        predictions: What it predicts.
        left_out: Reason by id of the clips for which it predicts nothing.
        figures: What the record says of the method, as JSON values.

    Raises:
        StageFailed: there are no predictions.
    """
    if not predictions:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in sorted(left_out.items()))
        raise StageFailed(f"{method}: nothing to predict in any clip. {reasons}")
    for one in predictions:
        path = resolve_inside(folder, f"{FOLDER}/{one.clip.id}.npz")
        save_clip(path, _blanked(one.clip), one.rest_pelvis_m)
    record = {
        "format": FORMAT,
        "method": method,
        "figures": dict(figures or {}),
        "clips": {
            one.clip.id: {
                "fps_hz": one.clip.motion.fps_hz,
                "n_frames": one.clip.motion.n_frames,
                "n_valid": int(one.clip.valid.sum()),
            }
            | dict(one.figures)
            for one in predictions
        },
        "left_out": dict(left_out),
    }
    write_json(folder / RECORD, record)


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
