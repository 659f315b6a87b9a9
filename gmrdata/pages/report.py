"""The report of a run as one HTML file, its plots, and a run at a glance: a picture, tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rich import table as terminal
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from gmrdata.pages import frames, plots, report_data
from gmrdata.pages.frames import frame_tiles, tile_sheet
from gmrdata.pages.html import Cell, Table, css_colours, render, write_page
from gmrdata.pages.plots import COLOURS, Draw, picture, plot_top_view, quiet, svg
from gmrdata.pages.report_data import ClipReport, GmrSummary, ReportData, Summary
from gmrdata.twins.pseudo_gt_error import error_series
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion
from gmrdata.write.overlay import OVERLAY_BGR

CLOSE_UP_PX = (300, 380)  # width and height of a close-up: people stand

FIGURES = {
    "frames_with_camera": "Frames with a camera",
    "ome_deg": "Orientation motion error",
    "tme_mm": "Translation motion error",
    "camera_rotation_deg": "Camera rotation error",
    "scale_error_percent": "Error of the metric scale",
}
GEOMETRY_WORDS = {
    "full": "full (the camera translates)",
    "rotation_only": "rotation only (the camera pans)",
    "static": "static (the camera doesn't move)",
}


def write_report(path: Path, report: ReportData) -> Path:
    """Write the report as a whole or not at all; the same input gives the same bytes."""
    return write_page(path, page(report))


def page(report: ReportData) -> str:
    predicted = [
        (clip.id, _predicted_path(i, clip.true.motion, clip.predicted))
        for i, clip in enumerate(report.clips)
        if clip.predicted
    ]
    has_gmr = bool(report.scores or report.learning_curve or predicted)
    anchors = [("#summary", "Summary")]
    anchors += [(f"#clip-{i}", clip.id) for i, clip in enumerate(report.clips)]
    anchors += [("#gmr", "GMR")] if has_gmr else []
    scales, curve = None, None
    if any(clip.figures.scale_error_percent is not None for clip in report.clips):
        height_in = 0.75 + 0.38 * len(report.clips)
        scales = svg(lambda plot: plot_scales(plot, report.clips), 7.4, height_in, "scales")
    if points := report.learning_curve:
        curve = svg(lambda plot: plot_learning_curve(plot, points), 7.4, 2.8, "learning-curve")
    return render(
        "report",
        report=report,
        links=[*anchors, ("#making", "How it was made"), ("#meaning", "What the numbers mean")],
        most=report_data.THRESHOLDS,
        n_good=sum(all(report_data.verdicts(clip.figures).values()) for clip in report.clips),
        clip_table=_clip_table(report),
        scales=scales,
        clips=[_clip(i, clip) for i, clip in enumerate(report.clips)],
        colours=css_colours(OVERLAY_BGR),
        has_gmr=has_gmr,
        score_table=_score_table(report.scores),
        predicted=predicted,
        learning_curve=curve,
        seconds={**report.seconds, "All stages": sum(report.seconds.values())},
    )


def _predicted_path(index: int, true: Motion, predicted: Motion) -> Markup:
    def draw(plot: Figure) -> None:
        plots.plot_predicted_view(plot.subplots(), true, predicted)

    return svg(draw, 4.2, 4.0, f"gmr-{index}")


def _clip_table(report: ReportData) -> Table:
    headings = (
        "clip", "camera", Cell("frames with", unit="a camera"), Cell("OME", unit="[°]"),
        Cell("TME", unit="[mm]"), Cell("camera rotation", unit="[°]"), Cell("scale", unit="[%]"),
    )  # fmt: skip
    most = {key: f"≤ {value:g}" for key, value in report_data.THRESHOLDS.items()}
    most["frames_with_camera"] = "all"
    rows: list[tuple[Cell | str, ...]] = []
    for index, clip in enumerate(report.clips):
        texts, met = report_data.figure_texts(clip.figures), report_data.verdicts(clip.figures)
        cells = (Cell(texts[key], met=met.get(key)) for key in FIGURES)
        rows.append((Cell(clip.id, href=f"#clip-{index}"), clip.camera_motion, *cells))
    caption = (
        "Mean errors of the recovered world motion per frame-to-frame motion (OME, TME), of the "
        "camera’s rotation per frame, and of the metric scale."
    )
    foot = ("threshold", "", *(most.get(key, "") for key in FIGURES))
    return Table(headings, rows, caption, foot)


def _score_table(scores: Mapping[str, GmrSummary]) -> Table:
    headings: list[Cell | str] = ["manifest"]
    for name, unit in (("OME", "[°]"), ("TME", "[mm]"), ("VME", "[mm]")):
        headings += [Cell(name, unit=unit), Cell("zero motion", unit=unit)]
    caption = (
        "Mean errors per frame-to-frame motion. In grey, the same for zero motion, that is for a "
        "body that neither turns nor moves: a model that learned something stays below it."
    )
    rows: list[list[Cell | str]] = []
    for name, score in scores.items():
        ours, zero = report_data.score_texts(score), report_data.score_texts(score.zero_motion)
        rows.append([name])
        for metric in ours:
            rows[-1] += [ours[metric], Cell(zero[metric], kind="beside")]
    return Table(headings, rows, caption)


def _clip(index: int, clip: ClipReport) -> dict[str, object]:
    tiles = frames.frame_tiles(clip)
    whole = [_picture(clip, tile, tile.frame(), f"frame {tile.image_number} · ") for tile in tiles]
    paths = svg(lambda plot: plots.plot_top_view(plot.subplots(), clip), 5.2, 5.0, f"paths-{index}")
    return {
        "report": clip,
        "fps_hz": clip.figures_fps_hz or clip.true.motion.fps_hz,  # of the errors
        "figures": _clip_figures(clip),
        "frames": whole,
        "close_ups": [_picture(clip, tile, tile.close_up(*CLOSE_UP_PX)) for tile in tiles],
        "paths": paths,
        "errors": svg(lambda plot: plot_errors(plot, clip), 7.4, 5.0, f"errors-{index}"),
        "record": _record(clip),
    }


def _clip_figures(clip: ClipReport) -> list[tuple[str, Cell]]:
    figures, met = clip.figures, report_data.verdicts(clip.figures)
    units = {"ome_deg": "°", "tme_mm": " mm"}
    units |= {} if figures.camera_rotation_deg is None else {"camera_rotation_deg": "°"}
    units |= {} if figures.scale_error_percent is None else {"scale_error_percent": " %"}
    return [
        (FIGURES[key], Cell(text + units.get(key, ""), met=met.get(key)))
        for key, text in report_data.figure_texts(figures).items()
    ]


def _picture(clip: ClipReport, tile: frames.ClipTile, drawn: np.ndarray, name: str = "") -> Cell:
    name += f"{tile.time_s:.1f} s" + ("" if tile.has_camera else " · no camera")
    return Cell(name, picture=frames.jpeg_image(drawn, f"{clip.id}, {name}"))


def _record(clip: ClipReport) -> list[tuple[str, str]]:
    quality, cameras = clip.quality, clip.cameras
    rows = [("Geometry", GEOMETRY_WORDS[cameras.geometry])]
    if quality.scale is None:
        rows.append(("Metric scale", "does not enter"))
    else:
        text, share = f"{quality.scale:.4g}", quality.scale_share
        if share is not None:
            text += f" ± {quality.scale_sigma:.3g} (±\u00a0{100 * share:.2g}\u00a0%)"
        rows.append(("Metric scale, metres per unit", text))
    rows.append(("Reprojection error", f"{cameras.mean_reprojection_px:.2f} px"))
    inliers = cameras.inliers_per_frame
    rows.append(("Inliers per frame", f"{min(inliers)} to {max(inliers)}"))
    return [*rows, ("Motion", clip.true.motion.source)]


def plot_errors(plot: Figure, clip: ClipReport) -> None:
    """OME, TME, camera rotation and inliers of a clip over time, in four panels."""
    series = error_series(clip.pseudo, clip.true, fps_hz=clip.figures_fps_hz)
    panels = plot.subplots(2, 2, sharex=True)
    times_s = series.motion_times_s
    _plot_error(panels[0, 0], times_s, series.ome_deg, "person", "Orientation motion error [°]")
    _plot_error(panels[0, 1], times_s, series.tme_mm, "person", "Translation motion error [mm]")
    rotation_deg, title = series.camera_rotation_deg, "Camera rotation error [°]"
    _plot_error(panels[1, 0], series.times_s, rotation_deg, "camera", title)
    _plot_inliers(panels[1, 1], clip)
    for axes in panels[1]:
        axes.set_xlabel("time [s]")


def _plot_error(axes: Axes, times_s: np.ndarray, errors: np.ndarray, role: str, title: str) -> None:
    quiet(axes, title)
    known = errors[np.isfinite(errors)]
    if len(known):
        mean, pale = float(known.mean()), COLOURS[role + "-pale"]
        axes.fill_between(times_s, 0, errors, color=pale, alpha=0.45, linewidth=0)
        axes.plot(times_s, errors, color=COLOURS[role], linewidth=1.5)
        plots.limit(axes, mean, "muted")
        axes.set_title(f"mean {mean:.3g}", loc="right", fontsize=9, color=COLOURS["muted"])
        axes.set_ylim(0, 1.15 * float(known.max()) or 1.0)
    else:
        plots.nothing(axes, "no frame with a camera")
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _plot_inliers(axes: Axes, clip: ClipReport) -> None:
    quiet(axes, "Inliers per frame")
    counts, fps_hz = clip.cameras.inliers_per_frame, clip.pseudo.motion.fps_hz
    colours = [COLOURS["camera-pale" if ok else "bad"] for ok in clip.has_camera]
    axes.bar(np.arange(len(counts)) / fps_hz, counts, width=0.72 / fps_hz, color=colours)
    axes.set_ylim(0, 1.1 * max(1, *counts))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def plot_scales(plot: Figure, clips: Sequence[ClipReport]) -> None:
    """Error of each metric scale with its own sigma [%], beside its threshold."""
    axes = plot.subplots()
    most = report_data.THRESHOLDS["scale_error_percent"]
    axes.axvspan(-most, most, color=COLOURS["rule"], alpha=0.5, linewidth=0)
    axes.axvline(0, color=COLOURS["muted"], linewidth=1)
    reach = most
    for row, clip in enumerate(clips):
        error, share = clip.figures.scale_error_percent, clip.quality.scale_share
        if error is None:
            words, colour = report_data.SCALE_NOT_OBSERVABLE, COLOURS["muted"]
            label = axes.annotate(words, (0, row), (8, 0), textcoords="offset points", color=colour)
            label.set_verticalalignment("center")
            continue
        colour = COLOURS["good" if abs(error) <= most else "bad"]
        sigma = None if share is None else 100 * share
        axes.errorbar(
            error, row, xerr=sigma, fmt="o", color=colour, markersize=6, linewidth=2, capsize=4
        )
        reach = max(reach, abs(error) + (sigma or 0.0))
    plots.name_rows(axes, [clip.id for clip in clips])
    axes.set_xlim(-1.15 * reach, 1.15 * reach)
    axes.set_xlabel("error of the metric scale [%], with ± one sigma of its own estimate")


def plot_learning_curve(plot: Figure, points: Sequence[tuple[int, float]]) -> None:
    """Training loss by step: every value pale, their running median on top, on a log scale."""
    steps, losses = (np.array(column, dtype=float) for column in zip(*points, strict=True))
    axes = plot.subplots()
    axes.plot(steps, losses, color=COLOURS["muted"], alpha=0.45, linewidth=0.8)
    axes.plot(steps, _running_median(losses), color=COLOURS["gmr"], linewidth=1.8)
    if (losses > 0).all():
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}" if losses.max() < 12 * losses.min() else "")
    axes.set(xlabel="step", ylabel="training loss")
    quiet(axes)
    axes.tick_params(which="minor", length=0)


def _running_median(values: np.ndarray) -> np.ndarray:
    half = max(1, len(values) // 40)
    parts = (values[max(0, i - half) : i + half + 1] for i in range(len(values)))
    return np.array([np.median(part) for part in parts])


TILE_PX = (340, 255)  # width and height of a frame's part round the person
AROUND = 1.9  # height of that part in heights of the person
DPI = 144


def write_overview(path: Path, report: ReportData) -> Path:
    """Write a row per clip, five frames with overlays and the paths from above, as .png; BadFrames
    where an image or mask can't be read."""
    plot, size_in = overview_plot(report, 5)
    write_bytes(path, picture(plot, *size_in, DPI))
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
        for (strip, paths), clip, sheet in zip(panels, report.clips, sheets, strict=True):
            strip.imshow(cv2.cvtColor(sheet, cv2.COLOR_BGR2RGB), interpolation="lanczos")
            strip.set_axis_off()
            strip.set_anchor("W")
            strip.set_title(f"{clip.camera_motion} camera", fontsize=11, fontweight="bold")
            strip.set_title(_figures(clip), loc="right", fontsize=10, color=COLOURS["muted"])
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
    parts: list[RenderableType] = [_summary_clips(summary)]
    if summary.gmr:
        parts += [Text(), _gmr_table(summary)]
    if summary.seconds:
        stages = " · ".join(f"{name} {value:.0f} s" for name, value in summary.seconds.items())
        total_s = sum(summary.seconds.values())
        parts += [Text(), Text(f"{total_s:.0f} s in all: {stages}", style="dim")]
    return Group(*parts)


_STYLE = {True: "green", False: "bold red", None: ""}


def _summary_clips(summary: Summary) -> terminal.Table:
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


def _gmr_table(summary: Summary) -> terminal.Table:
    table = _table(
        "GMR (in brackets: zero motion)", ("manifest", "OME \\[deg]", "TME \\[mm]", "VME \\[mm]")
    )
    for name, score in summary.gmr.items():
        ours, zero = report_data.score_texts(score), report_data.score_texts(score.zero_motion)
        table.add_row(escape(name), *(f"{ours[key]} ({zero[key]})" for key in ours))
    return table


def _table(title: str, headings: tuple[str, ...]) -> terminal.Table:
    table = terminal.Table(title=title, title_justify="left", box=None)
    table.add_column(headings[0], overflow="fold")
    for heading in headings[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    return table
