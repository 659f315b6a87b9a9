"""Tables as CSV and Markdown."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any


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
