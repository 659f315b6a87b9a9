"""What every baseline predicts for, and writes: a world-frame clip for each clip of the manifest;
and the two that look at nothing: nobody moves, and everybody moves as people do on average.

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
from pydantic import Field

from gmrdata.gmr.runs import LazyClips, no_runs, runs_at, usable_files
from gmrdata.motion.resample import valid_runs
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values import transforms
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadManifest, BadMotionFile, StageFailed
from gmrdata.values.files import read_npz, resolve_inside
from gmrdata.values.motion import Motion, accumulate, deltas
from gmrdata.values.records import Config, Record


@dataclass(frozen=True, eq=False)
class Subject:
    """A clip of the manifest, and what writing another motion of the same body takes."""

    clip: Clip  # the clip; `valid` is False outside the manifest's kept ranges, and True somewhere
    rest_pelvis_m: np.ndarray  # (3,) J0 of its body and shape, rest frame [m]


def manifest_subjects(
    path: Path, files_of: Callable[[str], Sequence[Path]] = lambda id: ()
) -> tuple[list[Subject], dict[str, str]]:
    """The clips of a manifest, and the reason by id of those that can't be used.

    A clip that lacks one of its files, `files_of` its id, can't.  Where all lack one, the folder is
    wrong: they are kept, and whoever reads them says so.
    """
    files, left_out, _ = usable_files(path)
    lacking = {}
    for id in (file.entry.id for file in files):
        if (missing := next((one for one in files_of(id) if not one.exists()), None)) is not None:
            lacking[id] = f"no {missing.parent.name}/{missing.name}"
    left_out |= lacking if len(lacking) < len(files) else {}
    subjects = []
    for file in files:
        if file.entry.id in left_out:
            continue
        clip = file.load()
        if clip.valid.any():
            subjects.append(Subject(clip, read_npz(file.arrays_path)["rest_pelvis_m"]))
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


def predict_zero(manifest_path: Path, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Predict that everybody stays in the pose of the first valid frame, local pose as it is."""

    def work(partial_dir: Path) -> None:
        subjects, skipped = manifest_subjects(manifest_path)
        write_predictions(partial_dir, "zero", [at_rest(one) for one in subjects], skipped)

    inputs = {"manifest": manifest_path}
    # There is nothing to choose.
    return run_stage("baseline-zero", out_dir, Config(), inputs, work, run=run)


def at_rest(subject: Subject) -> Prediction:
    """A subject that stays where it is."""
    root_rotmat, pelvis_m = first_pose(subject.clip)
    n = subject.clip.motion.n_frames
    roots = np.tile(root_rotmat, (n, 1, 1)), np.tile(pelvis_m, (n, 1))
    return _moving(subject, *roots, "zero motion")


def _moving(
    subject: Subject, root_rotmats: np.ndarray, pelvis_m: np.ndarray, what: str
) -> Prediction:
    moving = replace(
        subject.clip.motion,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m,
        frame="world",
        source=f"{what}, local pose of: {subject.clip.motion.source}",
    )
    return predicted(subject, moving, subject.clip.valid)


class MeanConfig(Config):
    fps_hz: float = Field(default=10.0, gt=0.0)
    """Frame rate at which motions are averaged [Hz]; the paper's 10."""


class MeanFigures(MethodFigures):
    """The mean motion from one frame to the next."""

    mean_rotvec_rad: tuple[float, float, float]  # dR as a rotation vector [rad]
    mean_m: tuple[float, float, float]  # dT [m]
    fps_hz: float
    n_motions: int  # how many were averaged

    @property
    def delta_rotmat(self) -> np.ndarray:
        """(3, 3) dR."""
        return transforms.rotmats_from_rotvecs(np.array(self.mean_rotvec_rad))


class MeanPredictions(Predictions):
    figures: MeanFigures


def predict_mean(
    manifest_path: Path,
    training_paths: Sequence[Path],
    out_dir: Path,
    config: MeanConfig | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict the mean motion of training clips for every clip, local pose as it is.

    The record has the mean.  `training_paths` are manifests of the clips that are averaged, which
    are in the world frame.
    """
    config = config or MeanConfig()

    def work(partial_dir: Path) -> None:
        training = [file for path in training_paths for file in usable_files(path)[0]]
        mean = mean_motion(LazyClips(training), config.fps_hz)
        subjects, skipped = manifest_subjects(manifest_path)
        predictions = [moving_as(mean, one) for one in subjects]
        write_predictions(partial_dir, "mean", predictions, skipped, MeanPredictions, mean)

    inputs = {"manifest": manifest_path}
    inputs |= {f"training_{i}": path for i, path in enumerate(training_paths)}
    return run_stage("baseline-mean", out_dir, config, inputs, work, run=run)


def mean_motion(clips: Sequence[Clip], fps_hz: float) -> MeanFigures:
    """Mean of all motions between valid frames, all phases of higher rates.

    dR by the chordal mean on SO(3) (Hartley et al. 2013, section 5.3), dT componentwise.  The clips
    are in the world frame, at `fps_hz` or above.
    """
    pairs = []
    for clip in clips:
        if clip.motion.frame != "world":
            raise BadManifest(
                f"clip {clip.id}: its motion is in the camera's frame, which moves. Average clips"
                " in the world frame"
            )
        for run in runs_at(clip, fps_hz, all_phases=True):
            pairs.append(deltas(run.root_rotmats, run.pelvis_m))
    if not pairs:
        raise no_runs(len(clips), "training", fps_hz, "Give other manifests")
    delta_rotmats, delta_m = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    mean = transforms.mean_rotation(delta_rotmats)
    return MeanFigures(
        mean_rotvec_rad=transforms.rotvecs_from_rotmats(mean).tolist(),
        mean_m=delta_m.mean(axis=0).tolist(),
        fps_hz=fps_hz,
        n_motions=len(delta_m),
    )


def moving_as(mean: MeanFigures, subject: Subject) -> Prediction:
    """A subject that repeats the mean motion from its first valid frame on.

    At another frame rate it moves along the same screw: as many frames as make up the mean's step
    have the mean's motion between them.
    """
    from scipy.linalg import expm, logm

    motion = subject.clip.motion
    along_screw = np.real(logm(transforms.rigid(mean.delta_rotmat, np.array(mean.mean_m))))
    step = expm(mean.fps_hz / motion.fps_hz * along_screw)
    first = int(np.argmax(subject.clip.valid))
    root_rotmat, place_m = first_pose(subject.clip)
    root_rotmats = np.tile(root_rotmat, (motion.n_frames, 1, 1))
    pelvis_m = np.tile(place_m, (motion.n_frames, 1))
    n_steps = motion.n_frames - first - 1
    root_rotmats[first:], pelvis_m[first:] = accumulate(
        np.tile(step[:3, :3], (n_steps, 1, 1)),
        np.tile(step[:3, 3], (n_steps, 1)),
        root_rotmat,
        place_m,
    )
    return _moving(subject, root_rotmats, pelvis_m, "mean motion")
