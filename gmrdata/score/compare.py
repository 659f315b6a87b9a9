"""Compare several scored runs on the clips that all of them have.

A comparison as the rows of a table, and of a CSV file.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from gmrdata.score.clip_errors import METRICS
from gmrdata.score.files import csv_text, markdown_table, read_scores
from gmrdata.score.intervals import paired_difference
from gmrdata.score.table import METRIC_WORDS, figure_text, heading, interval_text
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import write_json, write_text
from gmrdata.values.records import Config

HEADINGS = ("metric", "run", "mean of clips", "difference", "95 % interval", "p", "clips")


def table_rows(comparison: dict[str, Any]) -> list[tuple[str, ...]]:
    """Rows for a reader: for each metric the first run, then the others beside it."""
    return [_cells(metric, row) for metric, row in _table_rows(comparison)]


def csv_rows(comparison: dict[str, Any]) -> list[list[Any]]:
    """Headings and rows for a program."""
    head = ["metric", "run", "n_clips", "mean_of_clips", "difference", "low", "high", "p_value"]
    return [head, *(_csv_row(metric, row) for metric, row in _table_rows(comparison))]


def p_text(p_value: float | None) -> str:
    """A p-value for a reader."""
    if p_value is None:
        return ""
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


def _table_rows(comparison: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for metric in METRIC_WORDS:
        for row in comparison["metrics"].get(metric, ()):
            yield metric, row


def _cells(metric: str, row: dict[str, Any]) -> tuple[str, ...]:
    difference = row.get("difference")
    signed = "" if difference is None else figure_text(metric, difference)
    if difference is not None and difference > 0:
        signed = f"+{signed}"
    return (
        heading(metric),
        row["run"],
        figure_text(metric, row["mean_of_clips"]),
        signed,
        interval_text(metric, row.get("interval95")),
        p_text(row.get("p_value")),
        str(row["n_clips"]),
    )


def _csv_row(metric: str, row: dict[str, Any]) -> list[Any]:
    low, high = row.get("interval95") or ("", "")
    figures = [row["mean_of_clips"], row.get("difference"), low, high, row.get("p_value")]
    return [metric, row["run"], row["n_clips"], *("" if v is None else v for v in figures)]


def comparison_markdown(comparison: dict[str, Any]) -> str:
    """The comparison as Markdown."""
    parts = ["# Comparison of runs\n", comparison_lead(comparison) + "\n"]
    parts.append(markdown_table(HEADINGS, table_rows(comparison)))
    return (
        "\n".join([*parts, *(f"- {line}" for line in comparison_explanations(comparison))]) + "\n"
    )


def comparison_lead(comparison: dict[str, Any]) -> str:
    """What was compared, in a sentence."""
    first, *others = comparison["runs"]
    return (
        f"{', '.join(others)} against {first}, on {len(comparison['clips'])} clips that all runs "
        f"have, at {comparison['fps_hz']:g} fps."
    )


def comparison_explanations(comparison: dict[str, Any]) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    lines = [
        "Figures are means of the clips' means: each clip counts once. A difference below 0 is a "
        "smaller error than the first run's.",
        f"Intervals: 95 %, by bootstrap: {comparison['resamples']} times clips were drawn with "
        "replacement.",
        "p: two-sided paired permutation test over clips. Values are not corrected for the number "
        "of metrics and runs.",
    ]
    lines += [
        f"{METRIC_WORDS[metric].title}: {METRIC_WORDS[metric].meaning}"
        for metric in METRIC_WORDS
        if metric in comparison["metrics"]
    ]
    return lines + [
        f"Only in some runs, and left out of {name}: {', '.join(ids)}."
        for name, ids in comparison["left_out"].items()
        if ids
    ]


FORMAT = "gmrdata-comparison/1"
"""Name and version of the format."""
SAME_ZERO = 1e-6
"""Largest difference, in deg or mm, between two scores of zero motion on the same frames."""


class CompareConfig(Config):
    """How runs are compared."""

    names: tuple[str, ...] = ()
    """What the runs are called, in their order; as in their scores when left out."""
    resamples: int = Field(default=2000, ge=100)
    """How often clips are drawn for a bootstrap interval."""
    permutations: int = Field(default=9999, ge=99)
    """Permutations of a test at most."""
    seed: int = Field(default=0, ge=0)
    """What both are drawn by."""


def compare_scores(
    paths: Sequence[Path],
    out_dir: Path,
    config: CompareConfig | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Differences of runs to the first one, clip by clip.

    Each clip counts once, whatever its length.  Only clips that all runs have are compared; the
    others are named.  A protocol's metrics are compared where all runs have the same protocol.

    Args:
        paths: `scores.json` of each run, two or more.
        out_dir: Gets `comparison.json`, `comparison.csv` and `comparison.md`.
        config: The recipe; None for its defaults.

    Returns:
        Path of `comparison.json`.

    Raises:
        MissingInput: a file is not there, or there are fewer than two.
        BadRecord: a file is no scores, or the runs can't be compared: other frame rates, no clip in
            common, or a clip of the same id that was scored on other frames.
    """
    config = config or CompareConfig()
    if len(paths) < 2:
        raise MissingInput("fewer than two scored runs. Give a scores.json for each run")

    def work(partial_dir: Path) -> None:
        records = [read_scores(path) for path in paths]
        names = _names(paths, records, config.names)
        comparison = compare_records(records, paths, names, config)
        write_json(partial_dir / "comparison.json", comparison)
        write_text(partial_dir / "comparison.csv", csv_text(csv_rows(comparison)))
        write_text(partial_dir / "comparison.md", comparison_markdown(comparison))

    inputs = {f"scores_{number}": path for number, path in enumerate(paths, 1)}
    return run_stage("compare", out_dir, config, inputs, work, run=run) / "comparison.json"


def compare_records(
    records: Sequence[dict[str, Any]],
    paths: Sequence[Path],
    names: Sequence[str],
    config: CompareConfig,
) -> dict[str, Any]:
    """The comparison as JSON values; see `compare_scores`."""
    clips = [{clip["id"]: clip for clip in record["clips"]} for record in records]
    common = [id for id in clips[0] if all(id in other for other in clips)]
    _check_comparable(records, paths, clips, common)
    rng = np.random.default_rng(config.seed)
    protocols = [record["protocol"] for record in records]
    same = protocols[0] is not None and all(found == protocols[0] for found in protocols)
    metrics = (*METRICS, *(protocols[0]["metrics"] if same else ()))
    return {
        "format": FORMAT,
        "runs": list(names),
        "fps_hz": records[0]["fps_hz"],
        "protocol": protocols[0]["name"] if same else None,
        "resamples": config.resamples,
        "clips": common,
        "left_out": {
            name: sorted(found.keys() - set(common))
            for name, found in zip(names, clips, strict=True)
        },
        "metrics": {
            metric: _rows(metric, [[c[id] for id in common] for c in clips], names, config, rng)
            for metric in metrics
        },
    }


def _rows(
    metric: str,
    clips: Sequence[Sequence[dict[str, Any]]],
    names: Sequence[str],
    config: CompareConfig,
    rng: np.random.Generator,
) -> list[dict[str, Any]]:
    """One row per run; clips in which a run has no figure are left out for all."""
    values = np.array([[_figure(clip, metric) for clip in of_run] for of_run in clips])
    values = values[:, np.isfinite(values).all(axis=0)]
    rows = []
    for number, (name, of_run) in enumerate(zip(names, values, strict=True)):
        row: dict[str, Any] = {"run": name, "n_clips": len(of_run), "mean_of_clips": None}
        if len(of_run):
            row["mean_of_clips"] = float(of_run.mean())
            if number:
                row |= asdict(
                    paired_difference(values[0], of_run, config.resamples, config.permutations, rng)
                )
        rows.append(row)
    return rows


def _figure(clip: dict[str, Any], metric: str) -> float:
    """A clip's figure; NaN where it has none."""
    found = clip["predicted"] if metric in METRICS else clip["protocol"]["predicted"]
    return float("nan") if found[metric] is None else float(found[metric])


def _check_comparable(
    records: Sequence[dict[str, Any]],
    paths: Sequence[Path],
    clips: Sequence[dict[str, dict[str, Any]]],
    common: Sequence[str],
) -> None:
    for path, record, found in zip(paths, records, clips, strict=True):
        if record["fps_hz"] != records[0]["fps_hz"]:
            raise BadRecord(
                f"{path}: of motions at {record['fps_hz']:g} fps, but {paths[0]} is of motions at "
                f"{records[0]['fps_hz']:g} fps. Compare scores of one frame rate"
            )
        for id in common:
            if not _same_frames(clips[0][id], found[id]):
                raise BadRecord(
                    f"{path}: clip {id} was scored on other frames or another truth than in "
                    f"{paths[0]}. Score both on the same manifest, with the same settings"
                )
    if not common:
        raise BadRecord(
            f"{paths[0]}: no clip is in all {len(paths)} scores. Score all runs on one manifest"
        )


def _same_frames(a: dict[str, Any], b: dict[str, Any]) -> bool:
    """Whether two rows are of the same motions: zero motion's scores are the truth's own size."""
    return a["n_motions"] == b["n_motions"] and all(
        abs(a["zero"][metric] - b["zero"][metric]) <= SAME_ZERO for metric in METRICS
    )


def _names(
    paths: Sequence[Path], records: Sequence[dict[str, Any]], given: Sequence[str]
) -> list[str]:
    """Names that tell the runs apart."""
    if given and (len(given) != len(paths) or len(set(given)) != len(given)):
        raise BadRecord(
            f"--names: {len(given)} names for {len(paths)} runs. Give each run a name of its own"
        )
    names = list(given) or [str(record["name"]) for record in records]
    if len(set(names)) < len(names):
        names = [
            f"{name} ({path.resolve().parent.name})"
            for name, path in zip(names, paths, strict=True)
        ]
    often = Counter(names)
    return [
        f"{number}: {name}" if often[name] > 1 else name for number, name in enumerate(names, 1)
    ]
