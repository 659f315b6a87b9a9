"""The tables that the measurements print."""

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from gmrdata.progress import answers


def show(title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows that have the same keys."""
    table = Table(title=title, title_justify="left")
    for key in rows[0]:
        table.add_column(key.replace("_", " "))
    for row in rows:
        table.add_row(*(_cell(value) for value in row.values()))
    answers.print(table)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_cell(part) for part in value)
    return str(value)
