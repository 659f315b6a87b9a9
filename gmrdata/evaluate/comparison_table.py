"""A comparison as the rows of a table, and of a CSV file."""

from collections.abc import Iterator
from typing import Any

from gmrdata.evaluate.metric_words import METRIC_WORDS, figure_text, heading, interval_text

HEADINGS = ("metric", "run", "mean of clips", "difference", "95 % interval", "p", "clips")


def table_rows(comparison: dict[str, Any]) -> list[tuple[str, ...]]:
    """Rows for a reader: for each metric the first run, then the others beside it."""
    return [_cells(metric, row) for metric, row in _rows(comparison)]


def csv_rows(comparison: dict[str, Any]) -> list[list[Any]]:
    """Headings and rows for a program."""
    head = ["metric", "run", "n_clips", "mean_of_clips", "difference", "low", "high", "p_value"]
    return [head, *(_csv_row(metric, row) for metric, row in _rows(comparison))]


def p_text(p_value: float | None) -> str:
    """A p-value for a reader."""
    if p_value is None:
        return ""
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


def _rows(comparison: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
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
