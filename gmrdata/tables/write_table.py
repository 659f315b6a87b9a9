"""A table beside the paper's: JSON for programs, CSV for spreadsheets, Markdown for readers."""

from pathlib import Path
from typing import Any

from gmrdata.evaluate.metric_words import METRIC_WORDS
from gmrdata.evaluate.text_files import csv_text, markdown_table
from gmrdata.store import write_json, write_text
from gmrdata.tables.recipe import METRICS


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
