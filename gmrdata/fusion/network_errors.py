"""How wrong networks' motions are on people whom they were not trained on, measured and fitted.

What a gap of some length adds up to is a variance of the error's mean over that time; the two
processes of `network_evidence` are fitted to it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.fusion.network_evidence import (
    LEAST_DOUBT,
    SPEEDS_M_PER_S,
    DeltaErrors,
    DoubtPart,
    ErrorPart,
    mean_doubts,
    mean_speeds_m_per_s,
    process_at,
)
from gmrdata.fusion.smoothing import mean_variance
from gmrdata.gmr.augmentation import turned
from gmrdata.gmr.config import DataConfig, Which, WindowConfig
from gmrdata.gmr.predict import TrainedGmr, deltas_at_source_rate, load_gmr
from gmrdata.gmr.runs import runs_at, split_manifests, subject_of
from gmrdata.stage.progress import track
from gmrdata.stage.store import StageRecord
from gmrdata.values import limits
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, BadRecord, MissingInput
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.records import Config

SPANS_S = (0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Times over which the error's mean is looked at."""
FAST_TIMES_S = (0.05, 0.1, 0.2, 0.4)
SLOW_TIMES_S = (3.0, 10.0)
FEWEST_S = 20.0  # of motion behind a figure
DOUBT_SHARES = (0.25, 0.5, 0.7, 0.85, 0.95)  # of the motions: between levels of doubt
LEAST_FACTOR = 0.2  # nothing is so sure that an error bar shrinks to nothing


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
class SeenBesideTruth:
    """Motions that a network sees, beside the true ones."""

    delta_rotmats: np.ndarray  # (T-1, 3, 3)
    delta_m: np.ndarray  # (T-1, 3) [m]
    doubt: np.ndarray  # (T-1, 2) [rad/s, m/s]
    true_rotmats: np.ndarray  # (T, 3, 3) world_from_root
    true_pelvis_m: np.ndarray  # (T, 3) [m]
    fps_hz: float


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
    `held_out_motions`, BadMotionFile where there are too few of them, and BadRecipe for networks of
    several frame rates, whose errors grow otherwise.
    """
    networks = [load_gmr(run_dir, config.which) for run_dir in run_dirs]
    rates = {gmr.fps_hz: gmr.name for gmr in networks}
    if len(rates) > 1:
        said = " and ".join(f"{name} is of {fps_hz:g} fps" for fps_hz, name in rates.items())
        raise BadRecipe(f"--network: {said}. Measure networks of one frame rate together")
    held_out = [
        one
        for run_dir in run_dirs
        for one in held_out_motions(run_dir, manifest_paths, config, people=people)
    ]
    return delta_errors(networks, held_out, config)


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
    data = DataConfig(held_out_subjects=people) if people else _data_of(run_dir)
    files = split_manifests(manifest_paths, data, to_train=False).held_out
    if not files:
        raise BadManifest(
            f"{run_dir}: its recipe held none of these clips out. Errors are measured on people"
            " that a network has not seen: train with data.held_out_subjects"
        )
    gmr, rng = load_gmr(run_dir, config.which), np.random.default_rng(config.seed)
    motions = []
    for file in track(files, f"predicting, {gmr.name}", total=len(files)):
        person = subject_of(file.entry.source) or file.entry.id
        runs = tuple(beside_truth(gmr, file.load(), config, rng))
        motions.append(HeldOut(file.entry.id, person, runs))
    return motions


def _data_of(run_dir: Path) -> DataConfig:
    """That of a training's recipe, whose other settings may be of a former version."""
    if not (run_dir / STAGE_FILE).is_file():
        what = f"no {STAGE_FILE}, which would say whom it was not trained on"
        raise MissingInput(f"{run_dir}: {what}. Name such people with --people")
    try:
        return DataConfig.model_validate(StageRecord.of(run_dir).config.get("data"))
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
            predicted = deltas_at_source_rate(gmr, noisy(true, config, rng))
            yield SeenBesideTruth(*predicted, true.root_rotmats, true.pelvis_m, fps_hz)


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
    held_out = [one for one in held_out if one.runs]
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
        doubt=fitted.doubt,
    )


def error_rates(seen: SeenBesideTruth) -> np.ndarray:
    """By how much motions are off, (T-1, 6) in the body's axes [rad/s, m/s]."""
    true_deltas, true_m = deltas(seen.true_rotmats, seen.true_pelvis_m)
    wrong = true_deltas.swapaxes(-1, -2) @ seen.delta_rotmats
    turns = Rotation.from_matrix(wrong).as_rotvec()
    return np.concatenate([turns, seen.delta_m - true_m], axis=1) * seen.fps_hz


@dataclass(frozen=True, eq=False)
class FittedErrors:
    """The two processes, and their growth with doubt, fitted."""

    fast: ErrorPart
    slow: ErrorPart
    doubt: DoubtPart


def fit_errors(clips: Sequence[SeenBesideTruth]) -> FittedErrors:
    """The processes whose means over 0.1 to 3 s vary as the errors of clips do.

    BadMotionFile where they are too few, or too short to tell a slow part.
    """
    variances, seconds = _variances(clips)
    enough = seconds[:, 0] >= FEWEST_S
    if not enough.any() or not (seconds[enough, SPANS_S.index(1.0)] > 0).any():
        raise BadMotionFile(
            f"the held-out motions are {seconds[:, 0].sum():.0f} s in all, at any one speed less"
            f" than {FEWEST_S:g} s, or none lasts a second. Hold out more of them"
        )
    parts = [_fit_axis(variances[enough, :, axis], seconds[enough]) for axis in range(6)]
    times = np.array([one[0] for one in parts])
    # (speed, part, axis); a speed that hardly occurs has the figures of the nearest that does.
    sigma = np.stack([one[1] for one in parts], axis=-1)
    known = np.flatnonzero(enough)
    nearest = np.abs(np.arange(len(SPEEDS_M_PER_S))[:, None] - known).argmin(axis=1)
    fast, slow = (_part(times[:, k], sigma[nearest, k]) for k in (0, 1))
    return FittedErrors(fast, slow, _fit_doubt(clips, fast, slow))


def _fit_doubt(clips: Sequence[SeenBesideTruth], fast: ErrorPart, slow: ErrorPart) -> DoubtPart:
    """How much larger errors over `SPANS_S[0]` are than their speed says, by doubt."""
    doubts, ratios = [], []
    for clip in clips:
        n = max(1, round(SPANS_S[0] * clip.fps_hz))
        if len(clip.delta_m) < n:
            continue
        sigma = span_sigma(fast, slow, mean_speeds_m_per_s(clip.delta_m, clip.fps_hz), SPANS_S[0])
        about = mean_doubts(clip.doubt, clip.fps_hz)
        values = np.column_stack([error_rates(clip), sigma**2, about])
        means = np.lib.stride_tricks.sliding_window_view(values, n, axis=0).mean(axis=-1)
        squares, variances = means[:, :6] ** 2, means[:, 6:12]
        of_turn_and_place = (slice(0, 3), slice(3, 6))
        ratios.append(
            np.stack([squares[:, a].sum(1) / variances[:, a].sum(1) for a in of_turn_and_place], 1)
        )
        doubts.append(means[:, 12:])
    turn, place = (
        _factors_by_level(np.concatenate(doubts)[:, k], np.concatenate(ratios)[:, k])
        for k in (0, 1)
    )
    return DoubtPart(tuple(np.rad2deg(turn[0]).tolist()), turn[1], *place)


def _factors_by_level(
    doubts: np.ndarray, ratios: np.ndarray
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Levels of doubt, and the root mean square of what errors are of those by speed: of as many
    motions at each level, and never less at a higher one.  Motions of equal doubt are of one level:
    one answer alone has no doubt, and the order of its motions says nothing."""
    order = np.argsort(doubts, kind="stable")
    cuts = _between_levels(doubts[order])
    levels = _median_levels(doubts, np.split(order, cuts))
    parts = np.split(order, cuts[np.diff(levels) > 1e-6 * levels[:-1]])
    factors = np.maximum.accumulate([np.sqrt(ratios[part].mean()) for part in parts])
    factors = np.maximum(factors, LEAST_FACTOR)
    return tuple(_median_levels(doubts, parts).tolist()), tuple(factors.tolist())


def _between_levels(doubts: np.ndarray) -> np.ndarray:
    """Where sorted doubts are cut, at `DOUBT_SHARES` of them: at the nearer end of equal ones."""
    at = np.array([round(share * len(doubts)) for share in DOUBT_SHARES])
    value = doubts[np.minimum(at, len(doubts) - 1)]
    first, end = (np.searchsorted(doubts, value, side) for side in ("left", "right"))
    cuts = np.unique(np.where(at - first <= end - at, first, end))
    return cuts[(cuts > 0) & (cuts < len(doubts))]


def _median_levels(doubts: np.ndarray, parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.array([max(np.median(doubts[part]), LEAST_DOUBT) for part in parts])


def span_sigma(fast: ErrorPart, slow: ErrorPart, speeds: np.ndarray, span_s: float) -> np.ndarray:
    """Standard deviations (T-1, 6) of the error's mean over a span, by speed [rad/s, m/s]."""
    variances = np.zeros((len(speeds), 6))
    for one in (fast, slow):
        process = process_at(one, speeds, SPEEDS_M_PER_S)
        variances += process.sigma**2 * mean_variance(span_s / process.time_s)
    return np.asarray(np.sqrt(variances))


def _part(times: np.ndarray, sigma: np.ndarray) -> ErrorPart:
    return ErrorPart(
        tuple(map(float, times)), _table(np.rad2deg(sigma[:, :3])), _table(sigma[:, 3:])
    )


def _table(sigma: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((left, up, front) for left, up, front in sigma.tolist())


def _variances(clips: Sequence[SeenBesideTruth]) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares (speed, span, 6) of the errors' means over spans, and seconds (speed, span) of
    motion that they are of: each window counts where its mean speed is nearest."""
    squares = np.zeros((len(SPEEDS_M_PER_S), len(SPANS_S), 6))
    counts, seconds = np.zeros(squares.shape[:2]), np.zeros(squares.shape[:2])
    for clip in clips:
        rates = error_rates(clip)
        speeds = mean_speeds_m_per_s(clip.delta_m, clip.fps_hz)
        values = np.column_stack([rates, speeds])
        for k, span_s in enumerate(SPANS_S):
            n = max(1, round(span_s * clip.fps_hz))
            if n > len(rates):
                continue
            means = np.lib.stride_tricks.sliding_window_view(values, n, axis=0).mean(axis=-1)
            nearest = np.abs(means[:, 6:] - SPEEDS_M_PER_S).argmin(axis=1)
            np.add.at(squares[:, k], nearest, means[:, :6] ** 2)
            np.add.at(counts[:, k], nearest, 1.0)
            np.add.at(seconds[:, k], nearest, 1 / clip.fps_hz)
    return squares / np.maximum(counts, 1.0)[..., None], seconds


def _fit_axis(variances: np.ndarray, seconds: np.ndarray) -> tuple[tuple[float, float], np.ndarray]:
    """Times of the two processes [s], and their standard deviations (speed, 2), for variances
    (speed, span): those with the least sum of squares between logarithms."""
    weights = np.sqrt(np.minimum(seconds / FEWEST_S, 1.0))
    measured = np.log(np.maximum(variances, 1e-12))
    fits = []
    for times_s in product(FAST_TIMES_S, SLOW_TIMES_S):
        shapes = np.stack([mean_variance(np.array(SPANS_S) / time_s) for time_s in times_s])
        minima = [
            least_squares(_log_misfit, np.sqrt(row[[0, -1]]) / 2, args=(shapes, at, weight))
            for row, at, weight in zip(variances, measured, weights, strict=True)
        ]
        fits.append((sum(one.cost for one in minima), times_s, [np.abs(one.x) for one in minima]))
    _, times_s, sigma = min(fits, key=lambda fit: fit[0])
    return times_s, np.array(sigma)


def _log_misfit(
    sigma: np.ndarray, shapes: np.ndarray, measured: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    return np.asarray(weights * (np.log(sigma**2 @ shapes + 1e-12) - measured))


HEADINGS = (
    "speed [m/s]", "turn, fast [deg/s]", "turn, slow [deg/s]", "place, fast [m/s]",
    "place, slow [m/s]",
)  # fmt: skip


def error_rows(record: DeltaErrors) -> list[tuple[str, ...]]:
    """A row of `HEADINGS` for each speed: standard deviations along left, up and front."""
    fast, slow = record.fast, record.slow
    tables = fast.turn_deg_per_s, slow.turn_deg_per_s, fast.place_m_per_s, slow.place_m_per_s
    return [
        (f"{speed:g}", *(" ".join(f"{value:.3g}" for value in table[k]) for table in tables))
        for k, speed in enumerate(record.speeds_m_per_s)
    ]
