"""The report's figures for the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gmrdata.report.bars import BARS, figure_texts, score_texts, verdicts


def summary_table(summary: Mapping[str, Any]) -> RenderableType:
    """Tables of the figures, at most 80 columns wide.

    Args:
        summary: What `gmrdata.report.bars.summary` gives, or the same read from summary.json.
    """
    parts: list[RenderableType] = [_clip_table(summary["clips"])]
    if summary.get("gmr"):
        parts += [Text(), _gmr_table(summary["gmr"])]
    if summary.get("seconds"):
        total_s = sum(summary["seconds"].values())
        stages = " · ".join(f"{name} {value:.0f} s" for name, value in summary["seconds"].items())
        parts += [Text(), Text(f"{total_s:.0f} s in all: {stages}", style="dim")]
    return Group(*parts)


def _clip_table(clips: list[Mapping[str, Any]]) -> Table:
    table = Table(title="Pseudo ground truth against the truth", title_justify="left", box=None)
    table.add_column("clip", overflow="fold")
    for heading in (
        "cameras",
        "OME\n\\[deg]",
        "TME\n\\[mm]",
        "cam. rot.\n\\[deg]",
        "scale err.\n\\[%]",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    keys = ("frames_with_camera", "ome_deg", "tme_mm", "camera_rotation_deg", "scale_error_percent")
    for clip in clips:
        texts, met = figure_texts(clip), verdicts(clip)
        texts["frames_with_camera"] = texts["cameras"]
        cells = [Text(texts[key], style=_STYLE[met.get(key)]) for key in keys]
        table.add_row(escape(clip["id"]), *cells)
    table.add_section()
    bar_cells = [f"≤ {BARS[key]:g}" if key in BARS else "" for key in keys[1:]]
    table.add_row("bar", "all", *bar_cells, style="dim")
    return table


_STYLE = {True: "green", False: "bold red", None: ""}


def _gmr_table(scores: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(title="GMR (in brackets: zero motion)", title_justify="left", box=None)
    table.add_column("manifest", overflow="fold")
    for heading in ("OME \\[deg]", "TME \\[mm]", "VME \\[mm]"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, score in scores.items():
        ours, zero = score_texts(score), score_texts(score["zero_motion"])
        table.add_row(escape(name), *(f"{ours[key]} ({zero[key]})" for key in ours))
    return table
