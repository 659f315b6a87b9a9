"""Write scores: JSON for programs, CSV for spreadsheets, Markdown for readers.

`scores.json`: its format, and reading it back.

Tables as CSV and Markdown.
"""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gmrdata.score.protocols import PROTOCOLS, ProtocolName
from gmrdata.score.table import csv_rows, explanations, lead, protocol_rows, score_rows
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json, write_json, write_text

FORMAT = "gmrdata-scores/2"
"""Name and version of the format."""


def protocol_record(name: ProtocolName | None) -> dict[str, Any] | None:
    """A protocol as JSON values; None without one."""
    if name is None:
        return None
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(PROTOCOLS[name]).items()
    }


def read_scores(path: Path) -> dict[str, Any]:
    """Read a `scores.json`.

    Raises:
        MissingInput: there is no such file.
        BadRecord: it isn't JSON, or no scores of this format.
    """
    record = read_json(path)
    found = record.get("format") if isinstance(record, dict) else None
    if found != FORMAT:
        raise BadRecord(
            f"{path}: of format {found!r}, not {FORMAT!r}. Give the scores.json that "
            "`gmrdata evaluate` wrote; score again with --redo what an older version scored"
        )
    return dict(record)


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as CSV, quoted where needed; lines end as on Unix."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; the first column names the row, the others are aligned to the right."""
    rule = ["---", *("---:" for _ in headings[1:])]
    return "\n".join(map(_line, [headings, rule, *rows])) + "\n"


def _line(cells: Sequence[str]) -> str:
    # A bar would end the cell, and a line break the table.
    texts = (str(cell).replace("\\", "\\\\").replace("|", "\\|") for cell in cells)
    return "| " + " | ".join(" ".join(text.split()) for text in texts) + " |"


def write_scores(folder: Path, scores: dict[str, Any]) -> None:
    """Write `scores.json`, `scores.csv` and `scores.md`."""
    write_json(folder / "scores.json", scores)
    write_text(folder / "scores.csv", csv_text(csv_rows(scores)))
    write_text(folder / "scores.md", scores_markdown(scores))


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
