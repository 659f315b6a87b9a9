"""Scores as tables: rows for a reader, CSV, and Markdown that says what the figures mean."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, get_args

from gmrdata.score import METHODS, METRICS, CameraMetric, Interval, SeenIn, records
from gmrdata.score.protocols import DEVIATIONS
from gmrdata.score.records import ClipScore, GroupScore, Scores, metrics_with
from gmrdata.values.files import write_text

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]  # headings and rows
Cell = str | float | None  # a cell of a CSV file
ZERO_HEADING = "with no motion at all"
FEW_CLIPS = "They are too narrow for few clips: those of 5 hold the true mean about 8 times in 10."


class MetricWords(NamedTuple):
    title: str
    unit: str
    digits: int  # decimals that are shown


METRIC_WORDS = {  # by key in `scores.json`
    "ome_deg": MetricWords("OME", "°", 2),
    "tme_mm": MetricWords("TME", "mm", 1),
    "vme_mm": MetricWords("VME", "mm", 1),
    "w_mpjpe_mm": MetricWords("W-MPJPE", "mm", 1),
    "wa_mpjpe_mm": MetricWords("WA-MPJPE", "mm", 1),
    "rte_percent": MetricWords("RTE", "%", 2),
    "roe_deg": MetricWords("ROE", "°", 1),
    "erve_mm_per_frame": MetricWords("ERVE", "mm/frame", 1),
    "jitter_10m_per_s3": MetricWords("jitter", "10 m/s³", 1),
    "foot_sliding_mm": MetricWords("foot sliding", "mm", 1),
    "pa_mpjpe_mm": MetricWords("PA-MPJPE", "mm", 1),
    "mpjpe_mm": MetricWords("MPJPE", "mm", 1),
    "pve_mm": MetricWords("PVE", "mm", 1),
    "pa_pve_mm": MetricWords("PA-PVE", "mm", 1),
    "mpjae_deg": MetricWords("MPJAE", "°", 1),
    "pa_mpjae_deg": MetricWords("PA-MPJAE", "°", 1),
    "accel_error_m_per_s2": MetricWords("Accel error", "m/s²", 1),
    "accel_mm_per_frame2": MetricWords("Accel", "mm/frame²", 1),
    "accel_error_mm_per_frame2": MetricWords("Accel error", "mm/frame²", 1),
    "accel_length_error_mm_per_frame2": MetricWords("Accel length error", "mm/frame²", 1),
    "ate_m": MetricWords("ATE", "m", 3),
    "ate_s_m": MetricWords("ATE-S", "m", 3),
}
MEANINGS = {
    "ome_deg": "Angle between the predicted and the true turn from frame to frame.",
    "tme_mm": "Distance between the predicted and the true step, seen from the body.",
    "vme_mm": "Distance of the body's vertices after one predicted and one true motion.",
    "w_mpjpe_mm": "Distance of the joints after a segment's first frames were aligned.",
    "wa_mpjpe_mm": "Distance of the joints after all frames of a segment were aligned.",
    "rte_percent": "Distance of the roots after one rigid alignment of the whole path, per length "
    "of the true path.",
    "roe_deg": "Angle between the roots' orientations after the first ones were made equal.",
    "erve_mm_per_frame": "Error of the root's step as the body sees it.",
    "jitter_10m_per_s3": "Mean length of the joints' jerk; the true motion has some too.",
    "foot_sliding_mm": "Step of points on the predicted feet while the true ones stand.",
    "pa_mpjpe_mm": "Distance of the joints after the best similarity of each frame.",
    "mpjpe_mm": "Distance of the joints in the camera's frame, from the middle of the hips.",
    "pve_mm": "Distance of the vertices in the camera's frame, from the same point.",
    "pa_pve_mm": "Distance of the vertices after the best similarity of each frame's joints.",
    "mpjae_deg": "Angle between the orientations of nine joints in the camera's frame.",
    "pa_mpjae_deg": "The same after the rotation of the best similarity of each frame.",
    "accel_error_m_per_s2": "Length of the difference of the joints' accelerations.",
    "accel_mm_per_frame2": "Length of the predicted joints' accelerations.",
    "accel_error_mm_per_frame2": "Length of the difference of the joints' accelerations.",
    "accel_length_error_mm_per_frame2": "Difference of the lengths of the joints' accelerations, "
    "as the length of a vector over the joints.",
    "ate_m": "Distance of the camera's places after one best similarity of its path.",
    "ate_s_m": "Distance of the camera's places after one rigid alignment of its path.",
}
SEEN_IN: dict[SeenIn, str] = {
    "own_camera": "seen by their own cameras",
    "true_camera": "turned to the first true orientation and seen by the truth's cameras",
    "world": "turned to the first true orientation in the world, as the truth has no cameras",
}


def heading(metric: str) -> str:
    words = METRIC_WORDS[metric]
    return f"{words.title} [{words.unit}]"


def meanings(metrics: Iterable[str]) -> list[str]:
    return [f"{METRIC_WORDS[one].title}: {MEANINGS[one]}" for one in metrics]


def figure_text(metric: str, value: float | None) -> str:
    """A figure without its unit; a dash where there is none."""
    return "–" if value is None else f"{value:.{METRIC_WORDS[metric].digits}f}"


def interval_text(metric: str, ends: Interval | None) -> str:
    """An interval without its unit, like `3.1 to 4.2`; empty where there is none."""
    return "" if ends is None else " to ".join(figure_text(metric, end) for end in ends)


def rows_of(scores: Scores) -> Iterator[tuple[str, str, ClipScore | GroupScore]]:
    """Kind, name and row of each clip, class of camera motion, type of motion, then of all."""
    yield from (("clip", clip.id, clip) for clip in scores.clips)
    yield from (("camera_motion", *named) for named in scores.camera_motion.items())
    yield from (("motion_type", *named) for named in scores.motion_type.items())
    yield from (("subset", *named) for named in scores.subset.items())
    yield "overall", "all", scores.overall


def score_rows(scores: Scores) -> Table:
    """Rows for a reader: OME, TME and VME pooled over motions, zero motion and the floor."""
    has_floor = scores.overall.floor is not None
    headings = ("clip", "motions", *map(heading, METRICS), ZERO_HEADING)
    rows = []
    for kind, name, row in rows_of(scores):
        cells = (_shown_name(kind, name), str(row.n_motions), *_cells(row, METRICS))
        cells += (_listed(row.paper().zero),)
        floor = "" if row.floor is None else f"{_listed(row.floor)} ({row.floor.of})"
        rows.append((*cells, floor) if has_floor else cells)
    return (*headings, "pseudo ground truth's own") if has_floor else headings, rows


def protocol_rows(scores: Scores) -> Table | None:
    """The protocol's figures in the same way, zero motion's in a last row; None without any."""
    if scores.protocol is None or not (metrics := scores.protocol.metrics):
        return None
    rows = [(_shown_name(kind, name), *_cells(row, metrics)) for kind, name, row in rows_of(scores)]
    zero = scores.overall.figures("zero")
    rows.append((ZERO_HEADING, *(figure_text(metric, zero[metric]) for metric in metrics)))
    return ("clip", *map(heading, metrics)), rows


def csv_rows(scores: Scores) -> list[list[Cell]]:
    """Headings and rows for a program: every figure at full precision, with both ends."""
    metrics = metrics_with(scores.protocol)
    head: list[Cell] = ["kind", "name", "camera_motion", "motion_type", "n_clips", "n_motions"]
    for method in METHODS:
        for metric in metrics:
            head += [f"{method}_{metric}{end}" for end in ("", "_low", "_high")]
    if scores.overall.floor is not None:
        head += ["floor_of", *(f"floor_{metric}" for metric in METRICS)]
    return [head, *(_csv_row(*one, metrics) for one in rows_of(scores))]


def _csv_row(
    kind: str, name: str, row: ClipScore | GroupScore, metrics: Sequence[str]
) -> list[Cell]:
    cells: list[Cell] = [kind, name]
    if isinstance(row, ClipScore):
        cells += [row.camera_motion, row.motion_type, 1, row.n_motions]
    else:
        cells += [None, None, row.n_clips, row.n_motions]
    for method in METHODS:
        figures, intervals = row.figures(method), row.intervals(method)
        for metric in metrics:
            cells += [figures[metric], *(intervals.get(metric) or (None, None))]
    if row.floor is not None:
        cells += [row.floor.of, *row.floor.by_metric().values()]
    return cells


def _shown_name(kind: str, name: str) -> str:
    return f"all {name}" if kind in ("camera_motion", "motion_type", "subset") else name


def _cells(row: records.ScoreRow, metrics: Sequence[str]) -> tuple[str, ...]:
    figures, intervals = row.figures("predicted"), row.intervals("predicted")
    cells = []
    for metric in metrics:
        ends = interval_text(metric, intervals.get(metric))
        figure = figure_text(metric, figures[metric])
        cells.append(f"{figure} ({ends})" if ends else figure)
    return tuple(cells)


def _listed(figures: records.PaperMetrics[float]) -> str:
    return " / ".join(figure_text(metric, figures.get(metric)) for metric in METRICS)


def scores_markdown(scores: Scores) -> str:
    """The scores as Markdown: the table, and what must be known to read it."""
    tables = {"": score_rows(scores)}
    protocol = protocol_rows(scores)
    if protocol is not None and scores.protocol is not None:
        tables[f"Protocol {scores.protocol.name}"] = protocol
    lines = (*scores.statements, *explanations(scores))
    return markdown(f"Scores of {scores.name}", lead(scores), tables, lines)


def lead(scores: Scores) -> str:
    """What was scored, in a sentence or two."""
    overall, model = scores.overall, scores.model
    what = f"{overall.n_motions} motions of {overall.n_clips} clips at {scores.fps_hz:g} fps"
    if isinstance(model, records.ScoredNetwork):
        how = f"predicted by network {model.run} (step {model.step})"
    elif isinstance(model, records.ScoredResults):
        how = f"predicted by {model.system} (results in {model.predictions})"
    else:
        how = f"read from files ({model.predictions})"
    protocol = f" Protocol {scores.protocol.name}." if scores.protocol else ""
    return f"{what}, {how}; body {scores.body}.{protocol}"


def explanations(scores: Scores) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    return [
        *meanings(metrics_with(scores.protocol)),
        "Figures are means over all motions, or over all samples of a protocol, of the clips of a "
        f"row. In brackets: 95 % bootstrap intervals, for which {scores.bootstrap.resamples} times "
        f"clips were drawn with replacement; a single clip has none. {FEW_CLIPS}",
        "Zero motion is a body that neither turns nor moves.",
        "OME, TME and VME take no difference between frames over a gap.",
        *_of_protocol(scores),
        *of_predictions(scores),
        *left_out(scores),
    ]


def left_out(scores: Scores) -> list[str]:
    """Which valid frames and which clips are not scored, as sentences."""
    lines = [f"{id}: {why}" for id, why in sorted(scores.skipped.items())]
    if n := scores.dropped_frames:
        lines.append(f"{n} valid frames without a prediction, here or in a set beside it.")
    return [f"Left out: {line}" for line in lines]


def of_predictions(scores: Scores) -> list[str]:
    """What was scored, and which camera it knew, as sentences."""
    lines = _seen_in(scores)
    if isinstance(scores.model, records.ScoredResults):
        lines += result_lines(scores.model)
    if given := sum(clip.took_true_camera for clip in scores.clips):
        lines.append(
            f"{given} predictions are in the camera's frame, without a camera. The true one took "
            "them to the world, so that their figures there know how it moved."
        )
    return lines


def result_lines(model: records.ScoredResults) -> list[str]:
    """What of another system's results was scored, as sentences."""
    lines = []
    if model.camera is not None:
        how = "as if it stood still" if model.camera == "ignored" else "by the truth's own path"
        lines.append(f"Its motions are in the camera's frame; the camera was taken {how}.")
    for id, one in sorted(model.clips.items()):
        of_all = f" of {one.people}" if one.people > 1 else ""
        line = f"{id}: {one.file}, {one.person}{of_all}, {one.used_frames} of {one.frames} frames"
        if one.first_unused_frame is not None:
            line += (
                f"; {one.unused_frames} are not the clip's, from frame {one.first_unused_frame} on"
            )
        lines.append("; ".join([line, *one.notes]) + ".")
    return lines


def _of_protocol(scores: Scores) -> list[str]:
    protocol = scores.protocol
    if not protocol:
        return []
    lines = [f"Protocol {protocol.name} follows {protocol.source}.", *protocol.notes]
    lines += [f"{DEVIATIONS[one]} `--original {one}` switches that." for one in protocol.deviations]
    if protocol.original:
        names = " ".join(protocol.original)
        lines.append(f"As its released code in what `--original {names}` switches.")
    if protocol.joints_from == "mesh":
        lines.append("Joints are regressed from both meshes by the given regressor.")
    rates = sorted({clip.protocol_fps_hz for clip in scores.clips if clip.protocol_fps_hz})
    if protocol.metrics and rates != [protocol.fps_hz]:
        lines.append(
            f"Its published figures are of video at {protocol.fps_hz:g} fps, these are at "
            f"{' and '.join(f'{rate:g}' for rate in rates)} fps: segments of "
            f"{protocol.segment_frames} frames last longer or shorter than there, and figures "
            "per frame, jitter and sliding can't be compared with published ones."
        )
    return lines


def _seen_in(scores: Scores) -> list[str]:
    counts = Counter(clip.seen_in for clip in scores.clips if clip.seen_in is not None)
    lines = [f"{n} predictions are {SEEN_IN[way]}." for way, n in counts.items()]
    in_camera = set(get_args(CameraMetric)) & set(metrics_with(scores.protocol))
    unseen = [clip for clip in scores.clips if clip.seen_in is None and _has_figures(clip)]
    if in_camera and unseen:
        lines.append(
            f"{len(unseen)} predictions have no camera of their own, and so no figures in its "
            "frame but PA-MPJPE."
        )
    return lines


def _has_figures(clip: ClipScore) -> bool:
    """Whether the protocol measured anything: of a clip too short for it, it did not."""
    of_clip = clip.protocol.predicted if clip.protocol else {}
    return any(figure is not None for figure in of_clip.values())


def write_table_files(path: Path, rows: Iterable[Sequence[Cell]], text: str) -> None:
    """Write a table's `<name>.csv` and `<name>.md` beside its `<name>.json`, which is `path`."""
    write_text(path.with_suffix(".csv"), csv_text(rows))
    write_text(path.with_suffix(".md"), text)


def csv_text(rows: Iterable[Sequence[Cell]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def markdown(title: str, lead: str, tables: Mapping[str, Table], lines: Iterable[str]) -> str:
    """A page of Markdown: tables by their heading ("" for none), and `lines` as a list."""
    parts = [f"# {title}\n"] + ([f"{lead}\n"] if lead else [])
    for name, (headings, rows) in tables.items():
        parts += [f"## {name}\n"] if name else []
        rule = ["---", *("---:" for _ in headings[1:])]
        parts.append("\n".join(map(_line, [headings, rule, *rows])) + "\n")
    return "\n".join([*parts, *(f"- {line}" for line in lines)]) + "\n"


def _line(cells: Sequence[str]) -> str:
    # A bar would end the cell, and a line break the table.
    texts = (str(cell).replace("\\", "\\\\").replace("|", "\\|") for cell in cells)
    return "| " + " | ".join(" ".join(text.split()) for text in texts) + " |"
