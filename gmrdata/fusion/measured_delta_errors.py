"""How wrong networks' motions are on people whom they were not trained on, measured."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError

from gmrdata.fusion.delta_errors import SPEEDS_M_PER_S, DeltaErrors, SeenBesideTruth, fit_errors
from gmrdata.gmr.augmentation import turned
from gmrdata.gmr.config import DataConfig, TrainConfig, Which, WindowConfig
from gmrdata.gmr.predict import TrainedGmr, deltas_at_source_rate, load_gmr
from gmrdata.gmr.runs import runs_at
from gmrdata.gmr.split import split_manifests, subject_of
from gmrdata.stage.progress import track
from gmrdata.stage.store import StageRecord
from gmrdata.values import limits
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadRecord
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config


class MeasureConfig(Config):
    """What a network is shown while its errors are measured."""

    fps_hz: float = Field(default=30.0, gt=0, le=1000.0)
    """Rate of the poses, if the clips have as much [Hz]."""
    pose_noise_deg: float = Field(default=3.0, ge=0, le=180.0)
    """Root mean square error of each joint: poses of pictures, or of 3DPW, are not exact."""
    pose_noise_time_s: float = Field(default=0.5, gt=0, le=limits.LONGEST_S)
    """Standard deviation of the Gaussian that smooths it in time [s]."""
    which: Which = "latest"
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)


DEFAULT_CONFIG = MeasureConfig()


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A clip that a network was not trained on, and what it sees in its runs of valid frames."""

    clip: str
    person: str  # as `subject_of` names them, or the clip's id
    runs: tuple[SeenBesideTruth, ...]


def measure_delta_errors(
    run_dirs: Sequence[Path],
    manifest_paths: Sequence[Path],
    config: MeasureConfig = DEFAULT_CONFIG,
    *,
    people: tuple[int | str, ...] = (),
) -> DeltaErrors:
    """Errors of one or more networks, each on the clips that its recipe held out, together.

    Networks of one recipe with other people held out say how the recipe does on anybody; one that
    was trained on all of them has no error of its own that could be measured.  Errors are those of
    `held_out_motions`, and BadMotionFile where there are too few of them.
    """
    found = [
        one
        for run_dir in run_dirs
        for one in held_out_motions(run_dir, manifest_paths, config, people=people)
    ]
    return delta_errors([load_gmr(run_dir, config.which) for run_dir in run_dirs], found, config)


def held_out_motions(
    run_dir: Path,
    manifest_paths: Sequence[Path],
    config: MeasureConfig = DEFAULT_CONFIG,
    *,
    people: tuple[int | str, ...] = (),
) -> list[HeldOut]:
    """What a network sees in the clips of manifests that its recipe held out, or of the people whom
    one says that it was not trained on, as `DataConfig.held_out_subjects` names them.

    BadManifest where there are none; BadRecord, MissingInput and BadCheckpoint for another run.
    """
    data = DataConfig(held_out_subjects=people) if people else _training(run_dir).data
    files = split_manifests(manifest_paths, data).held_out
    if not files:
        raise BadManifest(
            f"{run_dir}: its recipe held none of these clips out. Errors are measured on people"
            " whom a network has not seen: train with data.held_out_subjects"
        )
    gmr, rng = load_gmr(run_dir, config.which), np.random.default_rng(config.seed)
    found = []
    for file in track(files, f"predicting, {gmr.name}", total=len(files)):
        person = subject_of(file.entry.source) or file.entry.id
        runs = tuple(beside_truth(gmr, file.load(), config, rng))
        found.append(HeldOut(file.entry.id, person, runs))
    return found


def _training(run_dir: Path) -> TrainConfig:
    try:
        return TrainConfig.model_validate(StageRecord.of(run_dir).config)
    except ValidationError:
        what = "its recipe is none of a training"
        raise BadRecord(f"{run_dir / STAGE_FILE}: {what}. Give a run of `gmrdata train`") from None


def beside_truth(
    gmr: TrainedGmr, clip: Clip, config: MeasureConfig, rng: np.random.Generator
) -> Iterator[SeenBesideTruth]:
    """What a network sees in a clip's runs of valid frames, with noise on the poses."""
    fps_hz = min(config.fps_hz, clip.motion.fps_hz)
    for true in runs_at(clip, fps_hz, all_phases=False):
        if (true.n_frames - 1) / fps_hz >= 1 / gmr.fps_hz:
            found = deltas_at_source_rate(gmr, noisy(true, config, rng))
            yield SeenBesideTruth(*found, true.root_rotmats, true.pelvis_m, fps_hz)


def noisy(motion: Motion, config: MeasureConfig, rng: np.random.Generator) -> Motion:
    """A motion with the noise on its joints that a network is shown."""
    window = WindowConfig(
        fps_hz=motion.fps_hz,
        pose_noise_deg=config.pose_noise_deg,
        pose_noise_time_s=config.pose_noise_time_s,
    )
    return replace(motion, local_rotmats=turned(motion.local_rotmats, window, rng))


def delta_errors(
    networks: Sequence[TrainedGmr],
    held_out: Sequence[HeldOut],
    config: MeasureConfig = DEFAULT_CONFIG,
) -> DeltaErrors:
    """The record of what networks see in held-out clips; BadMotionFile where they are too few."""
    runs = [run for one in held_out for run in one.runs]
    fitted = fit_errors(runs)
    return DeltaErrors(
        networks=tuple(gmr.name for gmr in networks),
        fps_hz=networks[0].fps_hz,
        people=tuple(sorted({one.person for one in held_out})),
        clips=len(held_out),
        seconds=sum(len(run.delta_m) / run.fps_hz for run in runs),
        pose_noise_deg=config.pose_noise_deg,
        pose_noise_time_s=config.pose_noise_time_s,
        speeds_m_per_s=SPEEDS_M_PER_S,
        fast=fitted.fast,
        slow=fitted.slow,
    )
