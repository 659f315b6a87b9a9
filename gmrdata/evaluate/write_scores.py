"""Write scores: JSON for programs, CSV for spreadsheets, Markdown and HTML for readers."""

from pathlib import Path
from typing import Any

from gmrdata.evaluate.over_time_figure import SIZE_IN, curve_of, over_time
from gmrdata.evaluate.scores_page import scores_page
from gmrdata.evaluate.table import csv_rows, protocol_rows, score_rows
from gmrdata.evaluate.text_files import csv_text, markdown_table
from gmrdata.evaluate.words import explanations, lead
from gmrdata.report.style import picture
from gmrdata.store import atomic_path, write_json, write_text


def write_scores(folder: Path, scores: dict[str, Any]) -> None:
    """Write `scores.json`, `scores.csv`, `scores.md`, `scores.html` and `over_time.png`.

    Args:
        folder: Where to.
        scores: The record, as in `scores.json`.
    """
    write_json(folder / "scores.json", scores)
    write_text(folder / "scores.csv", csv_text(csv_rows(scores)))
    write_text(folder / "scores.md", scores_markdown(scores))
    write_text(folder / "scores.html", scores_page(scores))
    curves = [curve_of(scores["name"], scores)]
    zero = curve_of("zero motion", scores, "zero")
    with atomic_path(folder / "over_time.png") as temporary:
        temporary.write_bytes(picture(lambda figure: over_time(figure, curves, zero), *SIZE_IN))


def scores_markdown(scores: dict[str, Any]) -> str:
    """The scores as Markdown: the table, and what must be known to read it."""
    parts = [f"# Scores of {scores['name']}\n", lead(scores) + "\n"]
    parts.append(markdown_table(*score_rows(scores)))
    protocol = protocol_rows(scores)
    if protocol is not None:
        parts += [f"## Protocol {scores['protocol']['name']}\n", markdown_table(*protocol)]
    for line in (*scores.get("statements", ()), *explanations(scores)):
        parts.append(f"- {line}")
    return "\n".join(parts) + "\n"
