"""A scores.json as the rows of a table, and of a CSV file."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from gmrdata.evaluate.clip_errors import METHODS, METRICS
from gmrdata.evaluate.metric_words import figure_text, heading, interval_text

ZERO_HEADING = "with no motion at all"
FLOOR_HEADING = "pseudo ground truth's own"

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""Headings and rows."""


class ScoreRow(NamedTuple):
    """One row: a clip or a group of clips."""

    kind: str
    """"clip", "camera_motion", "motion_type" or "overall"."""
    name: str
    """The clip's id or the group's name."""
    row: dict[str, Any]
    """Its values in the record."""
    figures: dict[str, dict[str, float | None]]
    """Pooled figures by method and metric, a protocol's among them."""
    intervals: dict[str, dict[str, list[float] | None]]
    """Ends of their 95 % intervals; empty for a clip."""


def rows_of(scores: dict[str, Any]) -> Iterator[ScoreRow]:
    """Each clip, each class of camera motion, each type of motion, then all."""
    for clip in scores["clips"]:
        yield ScoreRow("clip", clip["id"], clip, _figures(clip, clip), {})
    for kind in ("camera_motion", "motion_type"):
        for name, group in scores[kind].items():
            yield _group_row(kind, name, group)
    yield _group_row("overall", "all", scores["overall"])


def metrics_of(scores: dict[str, Any]) -> tuple[str, ...]:
    """OME, TME and VME, then the protocol's metrics."""
    protocol = scores["protocol"]
    return (*METRICS, *(protocol["metrics"] if protocol else ()))


def score_rows(scores: dict[str, Any]) -> Table:
    """OME, TME and VME, with zero motion and the floor: headings and rows for a reader.

    Figures are pooled over motions; groups have intervals beside them.
    """
    has_floor = "floor" in scores["overall"]
    headings = ("clip", "motions", *map(heading, METRICS), ZERO_HEADING)
    rows = []
    for row in rows_of(scores):
        cells = (_name(row), str(row.row["n_motions"]), *_cells(row, METRICS), _zero(row))
        rows.append((*cells, _floor(row)) if has_floor else cells)
    return (*headings, FLOOR_HEADING) if has_floor else headings, rows


def protocol_rows(scores: dict[str, Any]) -> Table | None:
    """The protocol's figures in the same way, zero motion's in a last row; None without any."""
    metrics = metrics_of(scores)[len(METRICS) :]
    if not metrics:
        return None
    found = list(rows_of(scores))
    rows = [(_name(row), *_cells(row, metrics)) for row in found]
    zero = found[-1].figures["zero"]
    rows.append((ZERO_HEADING, *(figure_text(metric, zero[metric]) for metric in metrics)))
    return ("clip", *map(heading, metrics)), rows


def csv_rows(scores: dict[str, Any]) -> list[list[Any]]:
    """Headings and rows for a program: every figure at full precision, with both ends."""
    metrics = metrics_of(scores)
    columns = [(method, metric) for method in METHODS for metric in metrics]
    head = ["kind", "name", "camera_motion", "motion_type", "n_clips", "n_motions"]
    for method, metric in columns:
        head += [f"{method}_{metric}", f"{method}_{metric}_low", f"{method}_{metric}_high"]
    if "floor" in scores["overall"]:
        head += ["floor_of", *(f"floor_{metric}" for metric in METRICS)]
    return [head, *(_csv_row(row, columns) for row in rows_of(scores))]


def _group_row(kind: str, name: str, group: dict[str, Any]) -> ScoreRow:
    intervals = {
        method: {
            **group["pooled_interval95"][method],
            **group.get("protocol_interval95", {}).get(method, {}),
        }
        for method in METHODS
    }
    return ScoreRow(kind, name, group, _figures(group["pooled_over_motions"], group), intervals)


def _figures(paper: dict[str, Any], row: dict[str, Any]) -> dict[str, dict[str, float | None]]:
    protocol = row.get("protocol", {})
    return {method: {**paper[method], **protocol.get(method, {})} for method in METHODS}


def _name(row: ScoreRow) -> str:
    return f"all {row.name}" if row.kind in ("camera_motion", "motion_type") else row.name


def _cells(row: ScoreRow, metrics: Sequence[str]) -> tuple[str, ...]:
    cells = []
    for metric in metrics:
        ends = interval_text(metric, row.intervals.get("predicted", {}).get(metric))
        figure = figure_text(metric, row.figures["predicted"][metric])
        cells.append(f"{figure} ({ends})" if ends else figure)
    return tuple(cells)


def _zero(row: ScoreRow) -> str:
    return " / ".join(figure_text(metric, row.figures["zero"][metric]) for metric in METRICS)


def _floor(row: ScoreRow) -> str:
    own = row.row.get("floor")
    if own is None:
        return ""
    return f"{' / '.join(figure_text(metric, own[metric]) for metric in METRICS)} ({own['of']})"


def _csv_row(row: ScoreRow, columns: list[tuple[str, str]]) -> list[Any]:
    of_clip = row.kind == "clip"
    cells = [
        row.kind,
        row.name,
        row.row["camera_motion"] if of_clip else "",
        (row.row["motion_type"] or "") if of_clip else "",
        1 if of_clip else row.row["n_clips"],
        row.row["n_motions"],
    ]
    for method, metric in columns:
        ends = row.intervals.get(method, {}).get(metric) or ("", "")
        value = row.figures[method][metric]
        cells += ["" if value is None else value, *ends]
    own = row.row.get("floor")
    if own is not None:
        cells += [own["of"], *(own[metric] for metric in METRICS)]
    return cells
