"""A table beside the paper's: JSON for programs, CSV for spreadsheets, Markdown for readers.

Which of the paper's orderings of a table's rows hold here, in sentences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from gmrdata.score.files import csv_text, markdown_table
from gmrdata.score.table import METRIC_WORDS
from gmrdata.tables.recipe import METRICS, Metric
from gmrdata.values.files import write_json, write_text


@dataclass(frozen=True)
class RowFigures:
    """A row of the table that was made."""

    name: str
    """The row."""
    paper: dict[Metric, float]
    """The paper's figures; empty where it has none."""
    mean: dict[Metric, float]
    """Ours, as the mean over seeds."""
    spread: dict[Metric, float | None]
    """Standard deviation over seeds; None for a single one."""


def orderings(rows: Sequence[RowFigures]) -> list[str]:
    """For each metric, how many of the paper's orderings hold here, and which hold or don't."""
    return [line for metric in METRICS for line in _of_metric(metric, rows)]


def _of_metric(metric: Metric, rows: Sequence[RowFigures]) -> list[str]:
    known = [row for row in rows if metric in row.paper]
    pairs = [
        (a, b) if a.paper[metric] < b.paper[metric] else (b, a)
        for a, b in combinations(known, 2)
        if a.paper[metric] != b.paper[metric]
    ]
    if not pairs:
        return []
    title = METRIC_WORDS[metric].title
    holds = [pair for pair in pairs if pair[0].mean[metric] < pair[1].mean[metric]]
    fails = [pair for pair in pairs if pair not in holds]
    lines = [f"{title}: {len(holds)} of the paper's {len(pairs)} orderings hold here."]
    if holds:
        lines.append(f"{title}, holds: {_listed(metric, holds)}.")
    if fails:
        lines.append(f"{title}, does not hold: {_listed(metric, fails)}.")
    best_there = min(known, key=lambda row: row.paper[metric])
    best_here = min(known, key=lambda row: row.mean[metric])
    if len(known) > 2:
        same = best_there is best_here
        there = f"{title}: the paper's best row is {best_there.name}"
        lines.append(f"{there}, as here." if same else f"{there}, here it is {best_here.name}.")
    return lines


def _listed(metric: Metric, pairs: Sequence[tuple[RowFigures, RowFigures]]) -> str:
    return "; ".join(
        f"{better.name} below {worse.name}{_doubt(metric, better, worse)}"
        for better, worse in pairs
    )


def _doubt(metric: Metric, a: RowFigures, b: RowFigures) -> str:
    """A remark where two rows differ by no more than seeds do."""
    spreads = [row.spread[metric] for row in (a, b)]
    known = [spread for spread in spreads if spread is not None]
    if len(known) < len(spreads):
        return ""
    is_small = abs(a.mean[metric] - b.mean[metric]) <= max(known)
    return " (within the seeds' spread)" if is_small else ""


def write_table(folder: Path, record: dict[str, Any]) -> Path:
    """Write `table<N>.json`, `.csv` and `.md`; returns the JSON file's path."""
    path = folder / f"table{record['table']}.json"
    write_json(path, record)
    write_text(path.with_suffix(".csv"), csv_text(_csv_rows(record)))
    headings, rows = shown_rows(record)
    lines = [f"- {line}" for line in (*explanations(record), *record["statements"])]
    parts = [f"# Table {record['table']}: {record['title']}\n", markdown_table(headings, rows)]
    write_text(path.with_suffix(".md"), "\n".join([*parts, *lines]) + "\n")
    return path


def explanations(record: dict[str, Any]) -> list[str]:
    """What must be known to read the table: the data of both, the size, and what is missing."""
    data = record["data"]
    trained = ", ".join(f"{one['name']} ({one['clips']} clips)" for one in data["training"])
    found = [
        f"Paper: {data['paper']}.",
        f"Here: trained on {trained or 'nothing'}; scored on {data['scored']}.",
    ]
    if data["held_out_subjects"]:
        found.append(f"Not trained on: subjects {', '.join(map(str, data['held_out_subjects']))}.")
    found.append(f"Scale {record['scale']}. {record['note']}".strip())
    found.append(
        "± is the standard deviation over seeds. The data differ, so figures don't compare."
    )
    for name, wanted in record["lacking"].items():
        found.append(f"{name}: not made. It needs {'; '.join(wanted)}.")
    return found


def shown_rows(record: dict[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows for a reader: the paper's figure and ours, metric by metric."""
    headings = ["row", "seeds"]
    for metric in METRICS:
        words = METRIC_WORDS[metric]
        headings += [f"{words.title} paper [{words.unit}]", f"{words.title} here [{words.unit}]"]
    rows = []
    for row in record["rows"]:
        cells = [row["name"], str(len(row["seeds"])) if row["seeds"] else "-"]
        for metric in METRICS:
            paper = row["paper"].get(metric)
            cells += ["-" if paper is None else f"{paper:.2f}", _ours(row["ours"], metric)]
        rows.append(tuple(cells))
    return tuple(headings), rows


def _ours(ours: dict[str, Any] | None, metric: str) -> str:
    if ours is None:
        return "not made"
    spread = ours[metric]["spread"]
    mean = f"{ours[metric]['mean']:.2f}"
    return mean if spread is None else f"{mean} ± {spread:.2f}"


def _csv_row(row: dict[str, Any]) -> list[Any]:
    cells = [row["name"], len(row["seeds"])]
    for metric in METRICS:
        ours = (row["ours"] or {}).get(metric, {})
        values = (row["paper"].get(metric), ours.get("mean"), ours.get("spread"))
        cells += ["" if value is None else value for value in values]
    return cells


def _csv_rows(record: dict[str, Any]) -> list[list[Any]]:
    head = ["row", "n_seeds"]
    for metric in METRICS:
        head += [f"paper_{metric}", f"{metric}_mean", f"{metric}_spread"]
    return [head, *map(_csv_row, record["rows"])]
