"""A scores.json as the rows of a table, and of a CSV file.

Names, units and meanings of all metrics, for tables and pages.

Scores in words: what was scored, what was left out, and what the figures mean.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from gmrdata.score.clip_errors import METHODS, METRICS


class MetricWords(NamedTuple):
    """What a metric is called."""

    title: str
    """Its short name."""
    unit: str
    """Its unit."""
    digits: int
    """Decimals that are shown."""
    meaning: str
    """What it says, in a sentence."""


METRIC_WORDS = {
    "ome_deg": MetricWords(
        "OME", "°", 2, "Angle between the predicted and the true turn from frame to frame."
    ),
    "tme_mm": MetricWords(
        "TME", "mm", 1, "Distance between the predicted and the true step, seen from the body."
    ),
    "vme_mm": MetricWords(
        "VME", "mm", 1, "Distance of the body's vertices after one predicted and one true motion."
    ),
    "w_mpjpe_mm": MetricWords(
        "W-MPJPE", "mm", 1, "Distance of the joints after a segment's first frames were aligned."
    ),
    "wa_mpjpe_mm": MetricWords(
        "WA-MPJPE", "mm", 1, "Distance of the joints after all frames of a segment were aligned."
    ),
    "rte_percent": MetricWords(
        "RTE",
        "%",
        2,
        "Distance of the roots after one rigid alignment of the whole path, per length of the "
        "true path.",
    ),
    "roe_deg": MetricWords(
        "ROE", "°", 1, "Angle between the roots' orientations after the first ones were made equal."
    ),
    "erve_mm_per_frame": MetricWords(
        "ERVE", "mm/frame", 1, "Error of the root's step as the body sees it."
    ),
    "jitter_10m_per_s3": MetricWords(
        "jitter", "10 m/s³", 1, "Mean length of the joints' jerk; the true motion has some too."
    ),
    "foot_sliding_mm": MetricWords(
        "foot sliding", "mm", 1, "Step of points on the predicted feet while the true ones stand."
    ),
}
"""By key in `scores.json`."""


def heading(metric: str) -> str:
    """A column's heading: name and unit."""
    words = METRIC_WORDS[metric]
    return f"{words.title} [{words.unit}]"


def figure_text(metric: str, value: float | None) -> str:
    """A figure without its unit; a dash where there is none."""
    return "–" if value is None else f"{value:.{METRIC_WORDS[metric].digits}f}"


def interval_text(metric: str, ends: list[float] | tuple[float, float] | None) -> str:
    """An interval without its unit, like `3.1 to 4.2`; empty where there is none."""
    if ends is None:
        return ""
    return f"{figure_text(metric, ends[0])} to {figure_text(metric, ends[1])}"


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


def lead(scores: dict[str, Any]) -> str:
    """What was scored, in a sentence or two."""
    overall, model = scores["overall"], scores["model"]
    what = (
        f"read from files ({model['predictions']})"
        if "predictions" in model
        else f"predicted by network {model['run']} (step {model['step']})"
    )
    text = (
        f"{overall['n_motions']} motions of {overall['n_clips']} clips at {scores['fps_hz']:g} "
        f"fps, {what}; body {scores['body']}."
    )
    if scores["protocol"]:
        text += f" Protocol {scores['protocol']['name']}."
    return text


def explanations(scores: dict[str, Any]) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    lines = [
        f"{METRIC_WORDS[metric].title}: {METRIC_WORDS[metric].meaning}"
        for metric in metrics_of(scores)
    ]
    lines += [
        "Figures are means over all motions, or over all samples of a protocol, of the clips of a "
        "row. In brackets: 95 % bootstrap intervals, for which "
        f"{scores['bootstrap']['resamples']} times clips were drawn with replacement; a single "
        "clip has none.",
        "Zero motion is a body that neither turns nor moves.",
        "No difference between frames is taken over a gap.",
    ]
    lines += _of_protocol(scores)
    if scores["dropped_frames"]:
        lines.append(f"{scores['dropped_frames']} valid frames had no prediction and are left out.")
    return lines + [f"Left out: {id}: {why}" for id, why in sorted(scores["skipped"].items())]


def _of_protocol(scores: dict[str, Any]) -> list[str]:
    protocol = scores["protocol"]
    if not protocol:
        return []
    lines = [f"Protocol {protocol['name']} follows {protocol['source']}.", *protocol["notes"]]
    rates = sorted({clip["protocol_fps_hz"] for clip in scores["clips"]})
    if protocol["metrics"] and rates != [protocol["fps_hz"]]:
        lines.append(
            f"Its published figures are of video at {protocol['fps_hz']:g} fps, these are at "
            f"{' and '.join(f'{rate:g}' for rate in rates)} fps: segments of "
            f"{protocol['segment_frames']} frames last longer or shorter than there, and figures "
            "per frame, jitter and sliding can't be compared with published ones."
        )
    return lines
