"""Figures over time: a clip's errors and inliers, the scales, and the training loss."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gmrdata.report.bars import BARS, SCALE_NOT_OBSERVABLE
from gmrdata.report.data import ClipReport
from gmrdata.report.series import error_series, usable
from gmrdata.report.style import COLOURS, quiet


def error_panels(figure: Figure, clip: ClipReport) -> None:
    """OME, TME, camera rotation and inliers of a clip over time, in four panels."""
    series = error_series(clip.true, clip.pseudo, clip.figures_fps_hz)
    between_s = series.motion_times_s
    panels = figure.subplots(2, 2, sharex=True)
    _error(panels[0, 0], between_s, series.ome_deg, "person", "Orientation motion error [°]")
    _error(panels[0, 1], between_s, series.tme_mm, "person", "Translation motion error [mm]")
    _error(
        panels[1, 0], series.times_s, series.camera_rotation_deg, "camera",
        "Camera rotation error [°]",
    )  # fmt: skip
    _inliers(panels[1, 1], clip)
    for axes in panels[1]:
        axes.set_xlabel("time [s]")


def _error(axes: Axes, times_s: np.ndarray, errors: np.ndarray, role: str, title: str) -> None:
    axes.set_title(title)
    quiet(axes)
    known = np.isfinite(errors)
    if known.any():
        mean = float(errors[known].mean())
        axes.fill_between(
            times_s, 0, errors, color=COLOURS[role + "-pale"], alpha=0.45, linewidth=0
        )
        axes.plot(times_s, errors, color=COLOURS[role], linewidth=1.5)
        axes.axhline(mean, color=COLOURS["muted"], linewidth=1, linestyle=(0, (4, 3)))
        axes.set_title(f"mean {mean:.3g}", loc="right", fontsize=9, color=COLOURS["muted"])
        axes.set_ylim(0, 1.15 * float(errors[known].max()) or 1.0)
    else:
        _nothing(axes, "no frame with a camera")
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _inliers(axes: Axes, clip: ClipReport) -> None:
    axes.set_title("Inliers per frame")
    quiet(axes)
    counts = clip.quality.inliers
    if counts is None or not len(counts):
        _nothing(axes, "not recorded")
        return
    times_s = np.arange(len(counts)) / clip.pseudo.motion.fps_hz
    good = usable(clip.pseudo)
    roles = ["camera-pale" if ok else "bad" for ok in good]
    axes.bar(
        times_s, counts, width=0.72 / clip.pseudo.motion.fps_hz, color=[COLOURS[r] for r in roles]
    )
    axes.set_ylim(0, 1.1 * max(1.0, float(np.max(counts))))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _nothing(axes: Axes, why: str) -> None:
    axes.text(
        0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=COLOURS["muted"]
    )


def scale_panel(figure: Figure, clips: Sequence[ClipReport]) -> None:
    """Error of each metric scale with its own sigma [%], beside the bar that it has to meet."""
    axes = figure.subplots()
    bar = BARS["scale_error_percent"]
    axes.axvspan(-bar, bar, color=COLOURS["rule"], alpha=0.5, linewidth=0)
    axes.axvline(0, color=COLOURS["muted"], linewidth=1)
    reach = bar
    for row, clip in enumerate(clips):
        error, sigma = clip.figures.scale_error_percent, relative_sigma_percent(clip)
        if error is None:
            axes.annotate(
                SCALE_NOT_OBSERVABLE, (0, row), xytext=(8, 0), textcoords="offset points",
                va="center", color=COLOURS["muted"],
            )  # fmt: skip
            continue
        role = "good" if abs(error) <= bar else "bad"
        axes.errorbar(
            error,
            row,
            xerr=sigma,
            fmt="o",
            color=COLOURS[role],
            markersize=6,
            linewidth=2,
            capsize=4,
        )
        reach = max(reach, abs(error) + (sigma or 0.0))
    axes.set_yticks(range(len(clips)), [clip.id for clip in clips])
    axes.tick_params(axis="y", labelcolor=COLOURS["ink"])
    axes.set_ylim(len(clips) - 0.4, -0.6)
    axes.set_xlim(-1.15 * reach, 1.15 * reach)
    axes.set_xlabel("error of the metric scale [%], with ± one sigma of its own estimate")
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    quiet(axes)


def relative_sigma_percent(clip: ClipReport) -> float | None:
    """The scale's own standard deviation [%]; None where there is no scale or no sigma."""
    quality = clip.quality
    if quality.scale is None or quality.scale_sigma is None or quality.scale == 0:
        return None
    return 100 * quality.scale_sigma / abs(quality.scale)


def learning_curve(figure: Figure, points: Sequence[tuple[int, float]]) -> None:
    """Training loss by step: every value pale, their running median on top, on a log scale."""
    steps, losses = (np.array(column, dtype=float) for column in zip(*points, strict=True))
    axes = figure.subplots()
    axes.plot(steps, losses, color=COLOURS["muted"], alpha=0.45, linewidth=0.8)
    axes.plot(steps, _running_median(losses), color=COLOURS["gmr"], linewidth=1.8)
    if (losses > 0).all():
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}" if losses.max() < 12 * losses.min() else "")
    axes.set_xlabel("step")
    axes.set_ylabel("training loss")
    quiet(axes)
    axes.tick_params(which="minor", length=0)


def _running_median(values: np.ndarray) -> np.ndarray:
    half = max(1, len(values) // 40)
    return np.array(
        [np.median(values[max(0, i - half) : i + half + 1]) for i in range(len(values))]
    )
