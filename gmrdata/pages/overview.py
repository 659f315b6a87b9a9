"""A whole run at a glance: one wide picture, and its figures for the terminal."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gmrdata.pages import report_data
from gmrdata.pages.frames import frame_tiles, tile_sheet
from gmrdata.pages.plots import COLOURS, Draw, picture, plot_top_view
from gmrdata.pages.report_data import ClipReport, ReportData, Summary
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import write_bytes

TILE_PX = (340, 255)  # width and height of a frame's part round the person
AROUND = 1.9  # height of that part in heights of the person
DPI = 144
KINDS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}


def write_overview(path: Path, report: ReportData, n_frames: int = 5) -> Path:
    """Write a row per clip, `n_frames` with overlays and the paths from above, to a .png or .jpg;
    BadFrames for another file, or where an image or mask can't be read."""
    if not report.clips:
        raise BadFrames(f"{path}: the report has no clip to draw")
    if path.suffix.lower() not in KINDS:
        raise BadFrames(f"{path}: name the picture .png or .jpg")
    plot, size_in = overview_plot(report, n_frames)
    write_bytes(path, picture(plot, *size_in, DPI, KINDS[path.suffix.lower()]))
    return path


def overview_plot(report: ReportData, n_frames: int) -> tuple[Draw, tuple[float, float]]:
    """What draws the overview, and its width and height [inch]."""
    sheets = []
    for clip in report.clips:
        tiles = frame_tiles(clip, n_frames)
        around_person = [tile.close_up(*TILE_PX, around=AROUND) for tile in tiles]
        sheets.append(tile_sheet(around_person, columns=n_frames, gap_px=6))
    height, width = np.max([sheet.shape[:2] for sheet in sheets], axis=0)
    rows_in = len(sheets) * (height / DPI + 0.42)
    strip_in, paths_in = width / DPI, 1.25 * height / DPI

    def draw(plot: Figure) -> None:
        panels = plot.subplots(len(sheets), 2, squeeze=False, width_ratios=[strip_in, paths_in])
        for (frames, paths), clip, sheet in zip(panels, report.clips, sheets, strict=True):
            frames.imshow(cv2.cvtColor(sheet, cv2.COLOR_BGR2RGB), interpolation="lanczos")
            frames.set_axis_off()
            frames.set_anchor("W")
            frames.set_title(f"{clip.camera_motion} camera", fontsize=11, fontweight="bold")
            frames.set_title(_figures(clip), loc="right", fontsize=10, color=COLOURS["muted"])
            spacing_m = plot_top_view(paths, clip)
            paths.set(xlabel="", ylabel="")
            paths.set_title(f"from above, grid {spacing_m:g} m", color=COLOURS["muted"])
            paths.tick_params(labelleft=False, labelbottom=False)

    return draw, (strip_in + paths_in, rows_in)


def _figures(clip: ClipReport) -> str:
    texts = report_data.figure_texts(clip.figures)
    figures = f"OME {texts['ome_deg']}° · TME {texts['tme_mm']} mm"
    if clip.figures.scale_error_percent is not None:
        figures += f" · scale {texts['scale_error_percent']} %"
    return figures


def summary_table(summary: Summary) -> RenderableType:
    """Tables of the figures for the terminal, at most 80 columns wide."""
    parts: list[RenderableType] = [_clip_table(summary)]
    if summary.gmr:
        parts += [Text(), _gmr_table(summary)]
    if summary.seconds:
        stages = " · ".join(f"{name} {value:.0f} s" for name, value in summary.seconds.items())
        total_s = sum(summary.seconds.values())
        parts += [Text(), Text(f"{total_s:.0f} s in all: {stages}", style="dim")]
    return Group(*parts)


_STYLE = {True: "green", False: "bold red", None: ""}


def _clip_table(summary: Summary) -> Table:
    headings = ("OME\n\\[deg]", "TME\n\\[mm]", "cam. rot.\n\\[deg]", "scale err.\n\\[%]")
    table = _table("Pseudo ground truth against the truth", ("clip", "cameras", *headings))
    for clip in summary.clips:
        texts, met = report_data.figure_texts(clip), report_data.verdicts(clip)
        cells = [Text(text, style=_STYLE[met.get(key)]) for key, text in texts.items()]
        table.add_row(escape(clip.id), *cells)
    table.add_section()
    ome, tme, scale = (f"≤ {value:g}" for value in report_data.THRESHOLDS.values())
    table.add_row("threshold", "all", ome, tme, "", scale, style="dim")
    return table


def _gmr_table(summary: Summary) -> Table:
    table = _table(
        "GMR (in brackets: zero motion)", ("manifest", "OME \\[deg]", "TME \\[mm]", "VME \\[mm]")
    )
    for name, score in summary.gmr.items():
        ours, zero = report_data.score_texts(score), report_data.score_texts(score.zero_motion)
        table.add_row(escape(name), *(f"{ours[key]} ({zero[key]})" for key in ours))
    return table


def _table(title: str, headings: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=None)
    table.add_column(headings[0], overflow="fold")
    for heading in headings[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    return table
