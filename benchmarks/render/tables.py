"""The tables that the measurements print."""

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from gmrdata.stage.progress import answers


def show(title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows that have the same keys."""
    # Without this "[mm]" is taken for markup, and is not shown.
    table = Table(title=escape(title), title_justify="left")
    for key in rows[0]:
        table.add_column(escape(key.replace("_", " ")))
    for row in rows:
        table.add_row(*(escape(_cell(value)) for value in row.values()))
    answers.print(table)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_cell(part) for part in value)
    return str(value)
