"""Stages that look at nothing: nobody moves, and everybody moves as people do on average."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.gmr.runs import no_runs, runs_at, usable_clips
from gmrdata.score import baseline_clips as predictions
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest
from gmrdata.values.motion_deltas import accumulate, deltas
from gmrdata.values.records import Config
from gmrdata.values.transforms import rigid


def predict_zero(manifest_path: Path, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Predict that everybody stays in the pose of the first valid frame, local pose as it is."""

    def work(partial_dir: Path) -> None:
        subjects, skipped = predictions.manifest_subjects(manifest_path)
        predictions.write_predictions(
            partial_dir, "zero", [at_rest(one) for one in subjects], skipped
        )

    inputs = {"manifest": manifest_path}
    # There is nothing to choose.
    return run_stage("baseline-zero", out_dir, Config(), inputs, work, run=run)


def at_rest(subject: predictions.Subject) -> predictions.Prediction:
    """A subject that stays where it is."""
    root_rotmat, pelvis_m = predictions.first_pose(subject.clip)
    n = subject.clip.motion.n_frames
    roots = np.tile(root_rotmat, (n, 1, 1)), np.tile(pelvis_m, (n, 1))
    return _moving(subject, *roots, "zero motion")


def _moving(
    subject: predictions.Subject, root_rotmats: np.ndarray, pelvis_m: np.ndarray, what: str
) -> predictions.Prediction:
    moving = replace(
        subject.clip.motion,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m,
        frame="world",
        source=f"{what}, local pose of: {subject.clip.motion.source}",
    )
    return predictions.predicted(subject, moving, subject.clip.valid)


class MeanConfig(Config):
    fps_hz: float = Field(default=10.0, gt=0.0)
    """Frame rate at which motions are averaged [Hz]; the paper's 10."""


class MeanFigures(predictions.MethodFigures):
    """The mean motion, as the record has it."""

    mean_rotvec_rad: tuple[float, float, float]  # dR as a rotation vector [rad]
    mean_m: tuple[float, float, float]  # dT [m]
    fps_hz: float
    n_motions: int  # how many were averaged


class MeanPredictions(predictions.Predictions):
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

    The record has the mean.  `training_paths` are manifests of the clips that are averaged, which
    are in the world frame.
    """
    config = config or MeanConfig()

    def work(partial_dir: Path) -> None:
        training = [one.clip for path in training_paths for one in usable_clips(path).clips]
        mean = mean_motion(training, config.fps_hz)
        subjects, skipped = predictions.manifest_subjects(manifest_path)
        found = [moving_as(mean, one) for one in subjects]
        predictions.write_predictions(
            partial_dir, "mean", found, skipped, MeanPredictions, _figures(mean)
        )

    inputs = {"manifest": manifest_path}
    inputs |= {f"training_{i}": path for i, path in enumerate(training_paths)}
    return run_stage("baseline-mean", out_dir, config, inputs, work, run=run)


def mean_motion(clips: Sequence[Clip], fps_hz: float) -> MeanMotion:
    """Mean of all motions between valid frames, all phases of higher rates.

    dR by the chordal mean on SO(3) (Hartley et al. 2013, section 5.3), dT componentwise.  The clips
    are in the world frame, at `fps_hz` or above.
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
        raise no_runs(len(clips), "training", fps_hz, "Give other manifests")
    delta_rotmats, delta_m = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    mean_rotmat = Rotation.from_matrix(delta_rotmats).mean().as_matrix()
    return MeanMotion(mean_rotmat, delta_m.mean(axis=0), fps_hz, len(delta_m))


def moving_as(mean: MeanMotion, subject: predictions.Subject) -> predictions.Prediction:
    """A subject that repeats the mean motion from its first valid frame on.

    At another frame rate it moves along the same screw: as many frames as make up the mean's step
    have the mean's motion between them.
    """
    from scipy.linalg import expm, logm

    motion = subject.clip.motion
    along_screw = np.real(logm(rigid(mean.delta_rotmat, mean.delta_m)))
    step = expm(mean.fps_hz / motion.fps_hz * along_screw)
    first = int(np.argmax(subject.clip.valid))
    root_rotmat, place_m = predictions.first_pose(subject.clip)
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


def _figures(mean: MeanMotion) -> MeanFigures:
    from scipy.spatial.transform import Rotation

    return MeanFigures(
        mean_rotvec_rad=Rotation.from_matrix(mean.delta_rotmat).as_rotvec().tolist(),
        mean_m=mean.delta_m.tolist(),
        fps_hz=mean.fps_hz,
        n_motions=mean.n_motions,
    )
