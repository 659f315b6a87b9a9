"""Compare several scored runs on the clips that all of them have."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from gmrdata.score import METRICS, Interval, table
from gmrdata.score.records import ClipScore, Protocol, Scores, metrics_with, same_names
from gmrdata.score.summary import PairedDifference, paired_difference
from gmrdata.score.table import METRIC_WORDS, Cell, figure_text
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values import limits
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import as_paths
from gmrdata.values.records import Config, Record

HEADINGS = ("metric", "run", "mean of clips", "difference", "95 % interval", "p", "clips")
CSV_HEADINGS: list[Cell] = [
    "metric", "run", "n_clips", "mean_of_clips", "difference", "low", "high", "p_value",
]  # fmt: skip
SAME_ZERO = 1e-6  # largest difference of two scores of zero motion on the same frames


class CompareConfig(Config):
    """How scored runs are compared."""

    names: tuple[str, ...] = ()
    """What the runs are called, in their order; as in their scores when left out."""
    resamples: int = Field(default=2000, ge=100, le=limits.MOST_DRAWS)
    """How often clips are drawn for a bootstrap interval."""
    permutations: int = Field(default=9999, ge=99, le=limits.MOST_DRAWS)
    """At most."""
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)


class ComparedRun(Config):
    """One run in one metric."""

    run: str
    n_clips: int
    """Clips in which all runs have a figure."""
    mean_of_clips: float | None
    """Mean of their figures; None without any."""
    difference: float | None
    """None for the first run; for this and the next two see `intervals.PairedDifference`."""
    interval95: Interval | None
    p_value: float | None


class Comparison(Record):
    """A `comparison.json`."""

    format: Literal["gmrdata-comparison/3"] = "gmrdata-comparison/3"
    runs: tuple[str, ...]
    """Names of the runs; the others are compared with the first."""
    fps_hz: float
    """Rate of OME, TME and VME [Hz]."""
    protocol: Protocol | None
    """What all of them measured besides; None where they have no protocol in common."""
    protocol_left_out: str | None
    """Why a protocol that they have in common is not compared; None where it is, or there is none.
    """
    resamples: int
    clips: tuple[str, ...]
    left_out: dict[str, tuple[str, ...]]
    """Clips that only some have, by run."""
    metrics: dict[str, tuple[ComparedRun, ...]]
    """By metric: each run, in their order."""
    statements: tuple[str, ...]
    """What must be known of single runs, as sentences."""

    @model_validator(mode="after")
    def _has_every_run(self) -> Self:
        same_names("left_out", self.left_out, set(self.runs))
        same_names("metrics", self.metrics, set(metrics_with(self.protocol)))
        for metric, rows in self.metrics.items():
            if tuple(row.run for row in rows) != self.runs:
                raise ValueError(f"`metrics.{metric}` has not the runs of `runs`")
        return self


def compare(
    scores_paths: str | Path | Iterable[str | Path],
    out_dir: Path | str,
    config: CompareConfig | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Lay scored runs beside the first one, clip by clip: by two or more `scores.json`, or folders.

    Each clip counts once, whatever its length.  Only clips that all runs have are compared; the
    others are named.  A protocol's metrics are, where all have it on the same frames of each clip.
    `out_dir` gets `comparison.json`, whose path is returned, `comparison.csv` and `.md`.
    """
    config, out_dir = config or CompareConfig(), Path(out_dir)
    paths = scores_files(as_paths(scores_paths))
    if len(paths) < 2:
        raise MissingInput("fewer than two scored runs. Give a scores.json for each run")

    def work(partial_dir: Path) -> None:
        records = [Scores.read(path) for path in paths]
        comparison = compare_records(records, paths, _names(paths, records, config.names), config)
        path = partial_dir / "comparison.json"
        comparison.write(path)
        shown = {"": (HEADINGS, table_rows(comparison))}
        lines = [*comparison_explanations(comparison), *comparison_remarks(comparison)]
        text = table.markdown("Comparison of runs", comparison_lead(comparison), shown, lines)
        table.write_table_files(path, csv_rows(comparison), text)

    inputs = {f"scores_{number}": path for number, path in enumerate(paths, 1)}
    return run_stage("compare", out_dir, config, inputs, work, run=run) / "comparison.json"


def scores_files(paths: Iterable[Path]) -> list[Path]:
    """The `scores.json` of each run: the file, or that of the folder which `score` made."""
    return [path / "scores.json" if path.is_dir() else path for path in paths]


def compare_records(
    records: Sequence[Scores], paths: Sequence[Path], names: Sequence[str], config: CompareConfig
) -> Comparison:
    clips = [{clip.id: clip for clip in record.clips} for record in records]
    common = sorted(set.intersection(*map(set, clips)))  # so that their order changes no draw
    _check_comparable(records, paths, clips, common)
    of_runs = [[by_id[id] for id in common] for by_id in clips]
    first = records[0].protocol
    left_out = None
    if any(record.protocol != first for record in records):
        left_out = _several_protocols(records, names)
    elif first is not None and first.metrics:
        left_out = _measured_otherwise(first, of_runs, names)
    protocol = None if left_out else first
    return Comparison(
        runs=tuple(names),
        fps_hz=records[0].fps_hz,
        protocol=protocol,
        protocol_left_out=left_out,
        resamples=config.resamples,
        clips=tuple(common),
        left_out={
            name: tuple(sorted(by_id.keys() - set(common)))
            for name, by_id in zip(names, clips, strict=True)
        },
        metrics={one: _compared(one, of_runs, names, config) for one in metrics_with(protocol)},
        statements=tuple(
            f"{name}: {line}"
            for name, record in zip(names, records, strict=True)
            for line in (*record.statements, *table.of_predictions(record))
        ),
    )


def _several_protocols(records: Sequence[Scores], names: Sequence[str]) -> str:
    """Which were scored by which, with what was switched."""
    said = []
    for name, record in zip(names, records, strict=True):
        one = record.protocol
        switched = f" --original {' '.join(one.original)}" if one and one.original else ""
        said.append(f"{name} by {one.name if one else 'none'}{switched}")
    return f"Protocols differ and are left out: {', '.join(said)}. Score all by one."


def _measured_otherwise(
    protocol: Protocol, clips: Sequence[Sequence[ClipScore]], names: Sequence[str]
) -> str | None:
    """Why a protocol's figures differ between runs whatever was predicted: they depend on which of
    a clip's frames have a prediction, and at which rate.  None where each clip has the same."""
    left_out = f"Protocol {protocol.name} is left out"
    for of_clip in zip(*clips, strict=True):
        first, named = of_clip[0], list(zip(names, of_clip, strict=True))
        if len({clip.protocol_fps_hz for clip in of_clip}) > 1:
            rates = ", ".join(f"{clip.protocol_fps_hz:g} fps in {name}" for name, clip in named)
            what = f"its figures depend on the frame rate, and clip {first.id} has {rates}"
            return f"{left_out}: {what}. Give predictions of one rate."
        if other := [name for name, clip in named if not _same_zero(first, clip, protocol)]:
            where = f"clip {first.id} has other frames in {other[0]} than in {names[0]}"
            what = f"{where}, or begins anew after gaps in one of them"
            return f"{left_out}: {what}. Give all as files of one folder, with --missing drop."
    return None


def _same_zero(a: ClipScore, b: ClipScore, protocol: Protocol) -> bool:
    """Whether zero motion has the same figures, where it has any: they are the truth's alone."""
    pairs = ((a.figures("zero")[one], b.figures("zero")[one]) for one in protocol.metrics)
    known = ((x, y) for x, y in pairs if x is not None and y is not None)
    return all(math.isclose(x, y, rel_tol=SAME_ZERO, abs_tol=SAME_ZERO) for x, y in known)


def _compared(
    metric: str,
    clips: Sequence[Sequence[ClipScore]],
    names: Sequence[str],
    config: CompareConfig,
) -> tuple[ComparedRun, ...]:
    """Each run; clips in which a run has no figure are left out for all."""
    figures = [[clip.figures("predicted")[metric] for clip in of_run] for of_run in clips]
    values = np.array(figures, dtype=float)  # None becomes NaN
    values = values[:, np.isfinite(values).all(axis=0)]
    n_clips = values.shape[1]
    rows = []
    for number, (name, of_run) in enumerate(zip(names, values, strict=True)):
        mean = float(of_run.mean()) if n_clips else None
        diff = PairedDifference(n_clips, None, None, None)
        if number and n_clips:
            # Anew for each, so that other runs and metrics beside it change nothing.
            rng = np.random.default_rng(config.seed)
            diff = paired_difference(values[0], of_run, config.resamples, config.permutations, rng)
        rows.append(ComparedRun(run=name, mean_of_clips=mean, **diff._asdict()))
    return tuple(rows)


def _check_comparable(
    records: Sequence[Scores],
    paths: Sequence[Path],
    clips: Sequence[dict[str, ClipScore]],
    common: Sequence[str],
) -> None:
    for path, record, by_id in zip(paths, records, clips, strict=True):
        if record.fps_hz != records[0].fps_hz:
            raise BadRecord(
                f"{path}: of motions at {record.fps_hz:g} fps, but {paths[0]} is of motions at "
                f"{records[0].fps_hz:g} fps. Compare scores of one frame rate"
            )
        other = (id for id in common if not _same_frames(clips[0][id], by_id[id]))
        if id := next(other, None):
            raise BadRecord(
                f"{path}: clip {id} was scored on other frames or another truth than in "
                f"{paths[0]}. Score both on the same manifest, with the same settings"
            )
    if not common:
        raise BadRecord(
            f"{paths[0]}: no clip is in all {len(paths)} scores. Score all runs on one manifest"
        )


def _same_frames(a: ClipScore, b: ClipScore) -> bool:
    """Whether two rows are of the same motions: zero motion's scores are the truth's own size."""
    return a.n_motions == b.n_motions and all(
        abs(a.zero.get(metric) - b.zero.get(metric)) <= SAME_ZERO for metric in METRICS
    )


def _names(paths: Sequence[Path], records: Sequence[Scores], given: Sequence[str]) -> list[str]:
    """Names that tell the runs apart."""
    if given and (len(given) != len(paths) or len(set(given)) != len(given)):
        raise BadRecord(
            f"--names: {len(given)} names for {len(paths)} runs. Give each run a name of its own"
        )
    names = list(given) or [record.name for record in records]
    if len(set(names)) < len(names):
        pairs = zip(names, paths, strict=True)
        names = [f"{name} ({path.resolve().parent.name})" for name, path in pairs]
    often = Counter(names)
    return [
        f"{number}: {name}" if often[name] > 1 else name for number, name in enumerate(names, 1)
    ]


def table_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Rows under `HEADINGS`: for each metric the first run, then the others beside it."""
    return [_cells(metric, row) for metric, row in _rows(comparison)]


def _rows(comparison: Comparison) -> list[tuple[str, ComparedRun]]:
    return [(one, row) for one in METRIC_WORDS for row in comparison.metrics.get(one, ())]


def _cells(metric: str, row: ComparedRun) -> tuple[str, ...]:
    difference, p_value = row.difference, row.p_value
    sign = "+" if difference is not None and difference > 0 else ""
    p_text = "" if p_value is None else "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"
    return (
        table.heading(metric),
        row.run,
        figure_text(metric, row.mean_of_clips),
        "" if difference is None else sign + figure_text(metric, difference),
        table.interval_text(metric, row.interval95),
        p_text,
        str(row.n_clips),
    )


def csv_rows(comparison: Comparison) -> list[list[Cell]]:
    rows = [CSV_HEADINGS]
    for metric, row in _rows(comparison):
        ends = row.interval95 or (None, None)
        figures = (row.n_clips, row.mean_of_clips, row.difference, *ends, row.p_value)
        rows.append([metric, row.run, *figures])
    return rows


def comparison_lead(comparison: Comparison) -> str:
    """What was compared, in a sentence."""
    first, *others = comparison.runs
    return (
        f"{', '.join(others)} against {first}, on {len(comparison.clips)} clips that all runs "
        f"have, at {comparison.fps_hz:g} fps."
    )


def comparison_explanations(comparison: Comparison) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    metrics = (metric for metric in METRIC_WORDS if metric in comparison.metrics)
    return [
        "Figures are means of the clips' means: each clip counts once. A difference below 0 is a "
        "smaller figure than the first run's: a smaller error, but for jitter and Accel.",
        f"Intervals: 95 %, by bootstrap: {comparison.resamples} times clips were drawn with "
        f"replacement. {table.FEW_CLIPS}",
        "p: two-sided paired permutation test over clips. Values are not corrected for the number "
        "of metrics and runs.",
        *table.meanings(metrics),
    ]


def comparison_remarks(comparison: Comparison) -> list[str]:
    """What is not compared, and what must be known of single runs, as sentences."""
    return [
        *([comparison.protocol_left_out] if comparison.protocol_left_out else []),
        *(
            f"Only in some runs, and left out of {name}: {', '.join(ids)}."
            for name, ids in comparison.left_out.items()
            if ids
        ),
        *comparison.statements,
    ]
