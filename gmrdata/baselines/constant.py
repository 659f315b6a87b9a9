"""Stages that look at nothing: nobody moves, and everybody moves as people do on average."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.baselines.predictions import (
    MethodFigures,
    Prediction,
    Predictions,
    Subject,
    first_pose,
    manifest_subjects,
    predicted,
    write_predictions,
)
from gmrdata.gmr.runs import runs_at, usable_clips
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest
from gmrdata.values.motion_deltas import accumulate, deltas
from gmrdata.values.records import Config
from gmrdata.values.transforms import rigid


class ZeroConfig(Config):
    """No motion at all; there is nothing to choose."""


def predict_zero(manifest_path: Path, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Predict that everybody stays in the pose of the first valid frame, local pose as it is.

    Errors as of `manifest_subjects` and `first_pose`.
    """

    def work(partial_dir: Path) -> None:
        subjects, skipped = manifest_subjects(manifest_path)
        write_predictions(partial_dir, "zero", [at_rest(one) for one in subjects], skipped)

    inputs = {"manifest": manifest_path}
    return run_stage("baseline-zero", out_dir, ZeroConfig(), inputs, work, run=run)


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
    """How the mean is taken."""

    fps_hz: float = Field(default=10.0, gt=0.0)
    """Frame rate at which motions are averaged [Hz]; the paper's 10."""


class MeanFigures(MethodFigures):
    """The mean motion, as the record has it."""

    mean_rotvec_rad: tuple[float, float, float]  # dR as a rotation vector [rad]
    mean_m: tuple[float, float, float]  # dT [m]
    fps_hz: float
    n_motions: int  # how many were averaged


class MeanPredictions(Predictions):
    """Of this baseline."""

    figures: MeanFigures


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean motion from one frame to the next."""

    delta_rotmat: np.ndarray  # (3, 3) dR
    delta_m: np.ndarray  # (3,) dT [m]
    fps_hz: float
    n_motions: int  # how many were averaged


def predict_mean(
    manifest_path: Path,
    training_paths: Sequence[Path],
    out_dir: Path,
    config: MeanConfig | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict the mean motion of training clips for every clip, local pose as it is.

    The record has the mean.  `training_paths` are manifests whose clips are averaged.

    Raises:
        BadManifest: no training clip has a motion at that rate, or one is not in the world frame.
        GmrdataError: as `manifest_subjects` and `first_pose`.
    """
    config = config or MeanConfig()

    def work(partial_dir: Path) -> None:
        training = [one.clip for path in training_paths for one in usable_clips(path).clips]
        mean = mean_motion(training, config.fps_hz)
        subjects, skipped = manifest_subjects(manifest_path)
        predictions = [moving_as(mean, one) for one in subjects]
        write_predictions(
            partial_dir, "mean", predictions, skipped, MeanPredictions, _figures(mean)
        )

    inputs = {"manifest": manifest_path}
    inputs |= {f"training_{i}": path for i, path in enumerate(training_paths)}
    return run_stage("baseline-mean", out_dir, config, inputs, work, run=run)


def mean_motion(clips: Sequence[Clip], fps_hz: float) -> MeanMotion:
    """Mean of all motions between valid frames, all phases of higher rates.

    dR by the chordal mean on SO(3) (Hartley et al. 2013, section 5.3), dT componentwise.

    Args:
        clips: Clips in the world frame, at `fps_hz` or above.

    Raises:
        BadManifest: there is no motion, or a clip is not in the world frame.
        BadMotionFile: a clip holds NaN in a valid frame, or has a lower rate.
    """
    from scipy.spatial.transform import Rotation

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
        raise BadManifest(
            f"none of the {len(clips)} training clips has two valid frames in a row at"
            f" {fps_hz:g} fps, so there is no mean motion. Give other manifests"
        )
    delta_rotmats, delta_m = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    mean_rotmat = Rotation.from_matrix(delta_rotmats).mean().as_matrix()
    return MeanMotion(mean_rotmat, delta_m.mean(axis=0), fps_hz, len(delta_m))


def moving_as(mean: MeanMotion, subject: Subject) -> Prediction:
    """A subject that repeats the mean motion from its first valid frame on.

    At another frame rate it moves along the same screw: as many frames as make up the mean's step
    have the mean's motion between them.
    """
    motion = subject.clip.motion
    step = _power(rigid(mean.delta_rotmat, mean.delta_m), mean.fps_hz / motion.fps_hz)
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


def _power(a_from_b: np.ndarray, exponent: float) -> np.ndarray:
    """A rigid transform (4, 4) done `exponent` times, along its screw."""
    from scipy.linalg import expm, logm

    result: np.ndarray = expm(exponent * np.real(logm(a_from_b)))
    return result


def _figures(mean: MeanMotion) -> MeanFigures:
    from scipy.spatial.transform import Rotation

    return MeanFigures(
        mean_rotvec_rad=Rotation.from_matrix(mean.delta_rotmat).as_rotvec().tolist(),
        mean_m=mean.delta_m.tolist(),
        fps_hz=mean.fps_hz,
        n_motions=mean.n_motions,
    )
