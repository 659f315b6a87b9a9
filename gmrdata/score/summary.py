"""Scores of clips by class of camera motion, by type of motion and overall, beside the floor.

Bootstrap intervals of means over clips are percentile intervals (Efron 1979).  They are those of
`scipy.stats.bootstrap` for the same draws, which a test holds.  It is not used, because all figures
of a score share their draws here, which takes up to an 18th of the time.  It also has no interval
where a resample draws only clips without a figure.
"""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeVar, get_args

import numpy as np

from gmrdata.score import (
    METRICS,
    CameraMetric,
    Interval,
    Method,
    Metric,
    ProtocolMetric,
    WorldMetric,
    records,
)
from gmrdata.score.clip_errors import ClipErrors
from gmrdata.score.records import Protocol
from gmrdata.twins.floor_record import Floor, FloorGroup
from gmrdata.values.errors import BadManifest, BadRecord
from gmrdata.values.shapes import Float

LEVEL = 0.95  # share of the resampled figures that an interval holds
MOST_PERMUTED = 1 << 20  # figures that are permuted at a time
Counts = Float[np.ndarray, "resamples clips"]
PerClip = Float[np.ndarray, " clips"]


def resampled_counts(n_clips: int, resamples: int, rng: np.random.Generator) -> Counts:
    """How often each clip is drawn in each resample."""
    drawn = rng.integers(0, n_clips, (resamples, n_clips))
    counts = np.zeros((resamples, n_clips))
    np.add.at(counts, (np.arange(resamples)[:, None], drawn), 1.0)
    return counts


def ratio_interval(sums: PerClip, weights: PerClip, counts: Counts) -> Interval | None:
    """Interval of sum(sums) / sum(weights) over resampled clips; None below two with weight."""
    if np.count_nonzero(weights) < 2:
        return None
    below = counts @ weights
    drawn = below > 0
    low, high = _ends((counts @ sums)[drawn] / below[drawn])
    return float(low), float(high)


def mean_intervals(
    values: Float[np.ndarray, "clips columns"], counts: Counts
) -> Float[np.ndarray, "2 columns"] | None:
    """Lower and upper ends for the means of several columns; None for fewer than two clips."""
    return _ends(counts @ values / len(values)) if len(values) >= 2 else None


def _ends(resampled: np.ndarray) -> np.ndarray:
    tail = (1 - LEVEL) / 2
    return np.asarray(np.quantile(resampled, [tail, 1 - tail], axis=0))


class PairedDifference(NamedTuple):
    """How a run differs from the first one in one metric; of one clip without interval and p."""

    n_clips: int
    difference: float | None  # mean over clips of the run's figures minus the first run's
    interval95: Interval | None  # ends of its 95 % bootstrap interval over clips
    p_value: float | None
    """Two-sided permutation test over clips: how often a difference as large comes about where it
    is chance which of the two runs a figure belongs to."""


def paired_difference(
    first: PerClip, other: PerClip, resamples: int, permutations: int, rng: np.random.Generator
) -> PairedDifference:
    """Compare two runs clip by clip; p is exact where all 2^n permutations are no more."""
    from scipy.stats import permutation_test

    differences = other - first
    n, mean = len(differences), float(differences.mean())
    if n < 2:
        return PairedDifference(n, mean, None, None)
    interval = ratio_interval(differences, np.ones(n), resampled_counts(n, resamples, rng))
    test = permutation_test(
        (other, first),
        lambda a, b, axis: np.mean(a - b, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=permutations,
        batch=max(1, MOST_PERMUTED // n),  # all at once take 7 GB for 10,000 clips
        alternative="two-sided",
        rng=rng,
    )
    return PairedDifference(n, mean, interval, float(test.pvalue))


T = TypeVar("T")
R = TypeVar("R", bound=records.ScoreRow)
BELOW: dict[Metric, str] = {
    "ome_deg": "OME {:.3f}° is below {:.3f}°",
    "tme_mm": "TME {:.2f} mm is below {:.2f} mm",
    "vme_mm": "VME {:.2f} mm is below {:.2f} mm",
}
SUBSET_METRICS: dict[str, tuple[str, ...]] = {
    "EMDB 1": get_args(CameraMetric),
    "EMDB 2": get_args(WorldMetric),
}
"""What papers take of each part of a data set: poses of one, paths of the other."""
OWN_SUBSET_METRICS: dict[str, tuple[str, ...]] = {"EMDB 1": get_args(ProtocolMetric), "EMDB 2": ()}
"""The same of EMDB's own evaluation, whose jitter is of EMDB 1 too (eth-ait/emdb, evaluate.py)."""
Draws = Callable[[int], np.ndarray]  # how often each of n clips is drawn: n -> (resamples, n)


def summarise(
    scored: Sequence[ClipErrors],
    fps_hz: float,
    resamples: int,
    rng: np.random.Generator,
    protocol: Protocol | None = None,
) -> records.ScoreSummary:
    """Scores of one clip or more: per clip, per class, per type and overall."""

    @cache
    def draws(n_clips: int) -> np.ndarray:
        # Groups of as many clips share their draws, so that equal groups get equal intervals.
        return resampled_counts(n_clips, resamples, rng)

    # What draws first decides the figures of the others: the order stays.
    by_id = sorted(scored, key=lambda one: one.clip_id)  # so that a manifest's order changes none
    overall = _group(by_id, draws)
    return records.ScoreSummary(
        clips=tuple(map(_clip, scored)),
        overall=overall,
        over_time=over_time(by_id, fps_hz, draws),
        camera_motion=_groups(by_id, lambda one: one.camera_motion, draws),
        motion_type=_groups(by_id, lambda one: one.motion_type, draws),
        subset=_subsets(by_id, draws, protocol),
        statements=(),
    )


def over_time(scored: Sequence[ClipErrors], fps_hz: float, draws: Draws) -> records.OverTime:
    """Mean over clips of the vertex error after t seconds (fig. 5).

    It goes as far as half of the clips last, and is of those clips alone: with others at its start
    it would jump where they end.
    """
    lengths = sorted((len(one.over_time_mm["predicted"]) for one in scored), reverse=True)
    n_frames = lengths[(len(scored) - 1) // 2]
    lasting = [one for one in scored if len(one.over_time_mm["predicted"]) >= n_frames]

    def curve(method: Method) -> records.Curve:
        values = np.array([one.over_time_mm[method][:n_frames] for one in lasting])
        ends = mean_intervals(values, draws(len(lasting)))
        interval = None if ends is None else (tuple(ends[0].tolist()), tuple(ends[1].tolist()))
        return records.Curve(vertex_mm=tuple(values.mean(axis=0).tolist()), interval95_mm=interval)

    return records.OverTime(
        times_s=tuple(frame / fps_hz for frame in range(n_frames)),
        clips=tuple(one.clip_id for one in lasting),
        predicted=curve("predicted"),
        zero=curve("zero"),
    )


def _clip(one: ClipErrors) -> records.ClipScore:
    return records.ClipScore(
        id=one.clip_id,
        camera_motion=one.camera_motion,
        motion_type=one.motion_type,
        n_motions=one.n_motions,
        dropped_frames=one.dropped_frames,
        **dict(_pooled([one])),
        protocol=_protocol([one]),
        protocol_fps_hz=one.protocol_fps_hz,
        subsets=one.subsets,
        seen_in=one.seen_in,
        took_true_camera=one.took_true_camera,
        floor=None,
        below_floor=(),
    )


def _groups(
    scored: Sequence[ClipErrors], name_of: Callable[[ClipErrors], str | None], draws: Draws
) -> dict[str, records.GroupScore]:
    """Groups by name, sorted; clips without a name are in none."""
    names = sorted({name for one in scored if (name := name_of(one)) is not None})
    return {name: _group([one for one in scored if name_of(one) == name], draws) for name in names}


def _subsets(
    scored: Sequence[ClipErrors], draws: Draws, protocol: Protocol | None
) -> dict[str, records.GroupScore]:
    """Named parts of the data set, sorted, each with the figures that are taken of it."""
    of_emdb = protocol is not None and protocol.name == "emdb"
    metrics = OWN_SUBSET_METRICS if of_emdb else SUBSET_METRICS
    names = sorted({name for one in scored for name in one.subsets})
    groups = {}
    for name in names:
        group = _group([one for one in scored if name in one.subsets], draws)
        groups[name] = _with_figures_of(group, metrics.get(name))
    return groups


def _with_figures_of(
    group: records.GroupScore, metrics: tuple[str, ...] | None
) -> records.GroupScore:
    """The group with null for a protocol's other metrics; all of them for None."""
    if metrics is None or group.protocol is None or group.protocol_interval95 is None:
        return group

    def kept(both: records.ByMethod[dict[str, T]]) -> records.ByMethod[dict[str, T | None]]:
        def of(values: dict[str, T]) -> dict[str, T | None]:
            return {one: value if one in metrics else None for one, value in values.items()}

        return records.ByMethod(predicted=of(both.predicted), zero=of(both.zero))

    figures, ends = kept(group.protocol), kept(group.protocol_interval95)
    return group.model_copy(update={"protocol": figures, "protocol_interval95": ends})


def _group(scored: Sequence[ClipErrors], draws: Draws) -> records.GroupScore:
    counts = draws(len(scored))

    def interval(values: list[np.ndarray]) -> Interval | None:
        weights = np.array([float(len(part)) for part in values])
        return ratio_interval(np.array([part.sum() for part in values]), weights, counts)

    return records.GroupScore(
        n_clips=len(scored),
        n_motions=sum(one.n_motions for one in scored),
        pooled_over_motions=_pooled(scored),
        pooled_interval95=_paper(scored, interval),
        mean_of_clips=_paper(scored, lambda values: float(np.mean([v.mean() for v in values]))),
        mean_of_clips_interval95=_paper(
            scored, lambda values: interval([part.mean(keepdims=True) for part in values])
        ),
        protocol=_protocol(scored),
        protocol_interval95=_world(scored, interval),
        floor=None,
        below_floor=(),
    )


def _pooled(scored: Sequence[ClipErrors]) -> records.ByMethod[records.PaperMetrics[float]]:
    return _paper(scored, lambda values: float(np.concatenate(values).mean()))


def _protocol(scored: Sequence[ClipErrors]) -> records.ByMethod[records.WorldFigures] | None:
    def mean(values: list[np.ndarray]) -> float | None:
        pooled = np.concatenate(values)
        return float(pooled.mean()) if len(pooled) else None

    return _world(scored, mean)


def _paper(
    scored: Sequence[ClipErrors], figure: Callable[[list[np.ndarray]], T]
) -> records.ByMethod[records.PaperMetrics[T]]:
    """A figure of all clips' samples, for each method and each of the paper's errors."""

    def of(method: Method) -> records.PaperMetrics[T]:
        values = {m: figure([one.errors[method][m] for one in scored]) for m in METRICS}
        return records.PaperMetrics(**values)

    return records.ByMethod(predicted=of("predicted"), zero=of("zero"))


def _world(
    scored: Sequence[ClipErrors], figure: Callable[[list[np.ndarray]], T]
) -> records.ByMethod[dict[str, T]] | None:
    """The same for a protocol's metrics; None without a protocol."""
    if scored[0].protocol_fps_hz is None:
        return None

    def of(method: Method) -> dict[str, T]:
        metrics = scored[0].protocol[method]
        return {m: figure([one.protocol[method][m] for one in scored]) for m in metrics}

    return records.ByMethod(predicted=of("predicted"), zero=of("zero"))


def read_fitting_floor(path: Path, manifest_path: Path, kind: str, fps_hz: float) -> Floor:
    """A floor for the scores of a manifest, whose motions were scored at `fps_hz`."""
    floor = Floor.read(path)
    if kind != "pseudo_gt":
        raise BadManifest(
            f"{manifest_path}: of kind {kind}, but {path} is the error of a pseudo ground truth. "
            "Leave out --floor"
        )
    if floor.fps_hz != fps_hz:
        raise BadRecord(
            f"{path}: of motions at {floor.fps_hz:g} fps, but the scores are at {fps_hz:g} fps. "
            "Leave out --floor"
        )
    if _errors_of(floor.overall, "all") is None:
        raise BadRecord(f"{path}: no sequence was accepted. Measure a floor on more sequences")
    return floor


def beside_floor(scores: records.ScoreSummary, floor: Floor) -> records.ScoreSummary:
    """Scores with a floor in each row, and a sentence for each row with a score below it.

    A row's floor is that of its class of camera motion; where the floor has none, that of all.
    Types of motion have none: the floor does not know them.
    """
    clips = tuple(_beside(clip, clip.camera_motion, floor) for clip in scores.clips)
    classes = {name: _beside(row, name, floor) for name, row in scores.camera_motion.items()}
    overall = _beside(scores.overall, "all", floor)
    rows: list[tuple[str, records.ScoreRow]] = [(clip.id, clip) for clip in clips]
    rows += [*((f"all {name}", row) for name, row in classes.items()), ("all", overall)]
    statements = tuple(_statement(name, row) for name, row in rows if row.below_floor)
    changes = {"clips": clips, "camera_motion": classes, "overall": overall}
    return scores.model_copy(update=changes | {"statements": statements})


def _beside(row: R, camera_motion: str, floor: Floor) -> R:
    group = floor.classes.get(camera_motion)
    of_class = None if group is None else _errors_of(group, camera_motion)
    used = of_class or _errors_of(floor.overall, "all")
    assert used is not None
    score = row.paper().predicted
    below = tuple(metric for metric in METRICS if score.get(metric) < used.get(metric))
    return row.model_copy(update={"floor": used, "below_floor": below})


def _errors_of(group: FloorGroup, of: str) -> records.RowFloor | None:
    """None where no sequence was accepted."""
    errors = {metric: getattr(group, metric) for metric in METRICS}
    return None if None in errors.values() else records.RowFloor(of=of, **errors)


def _statement(name: str, row: records.ScoreRow) -> str:
    assert row.floor is not None
    score, own = row.paper().predicted, row.floor
    parts = ", ".join(BELOW[one].format(score.get(one), own.get(one)) for one in row.below_floor)
    return f"{name}: {parts}: not distinguishable from the pseudo ground truth's own error"
