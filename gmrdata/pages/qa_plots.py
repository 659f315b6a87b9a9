"""Plots of a sequence: its frames over time, the cues of its scale, and its paths from above."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gmrdata.pages import plots
from gmrdata.pages.plots import COLOURS
from gmrdata.pages.qa_data import Aligned, Found, kinds_of
from gmrdata.values.rows import text_runs
from gmrdata.world.recipe import CueEstimate, VerdictConfig

PERSON_IN, PANEL_IN, AXIS_IN = 0.3, 1.5, 0.45
"""Heights of a person's row, of a plot, and of what is under the lowest [inch]."""


def height_in(found: Found) -> float:
    """Height of the figure that `plot_time` wants [inch]."""
    return AXIS_IN + PERSON_IN * len(found.reasons) + PANEL_IN * n_panels(found)


def n_panels(found: Found) -> int:
    """How many plots are below the time line."""
    if found.world_from_cam is None:
        return 0
    return 1 if found.dataset_camera is None else 3


def plot_time(plot: Figure, found: Found, config: VerdictConfig) -> None:
    """The time line over the plots, on one axis of frames."""
    n = n_panels(found)
    heights = [PERSON_IN * len(found.reasons), *[PANEL_IN] * n]
    column = plot.subplots(1 + n, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    _plot_kept(column[0], found)
    if found.world_from_cam is not None:
        _plot_inliers(column[1], found, config.min_inliers)
    if (apart := found.window_differences(config)) is not None:
        span = f"over {config.window_s:g} s from the data set’s own camera"
        _plot_beside(column[2], apart[0], config.max_window_deg, f"Turn: difference {span} [°]")
        _plot_beside(column[3], apart[1], config.max_window_m, f"Way: difference {span} [m]")
    cuts = () if found.cameras is None else found.cameras.cuts_after_frames
    for axes in column:
        for cut in found.frames_of(cuts):
            axes.axvline(cut + 0.5, color=COLOURS["ink"], linewidth=1, linestyle=(0, (2, 2)))
    column[-1].set_xlabel("frame")
    column[-1].set_xlim(-0.5, max(1, found.n_frames) - 0.5)


def _plot_kept(axes: Axes, found: Found) -> None:
    kinds, accepted = kinds_of(found.reasons), [person.accepted for person in found.judged]
    for person, reasons in enumerate(found.reasons):
        for start, stop, reason in text_runs(reasons):
            good = not reason and person < len(accepted) and accepted[person]
            colour = kinds[reason].colour if reason else COLOURS["good" if good else "rule"]
            axes.broken_barh([(start - 0.5, stop - start)], (person - 0.4, 0.8), color=colour)
    axes.set_ylim(len(found.reasons) - 0.5, -0.5)
    axes.set_yticks(range(len(found.reasons)), [f"person {i}" for i in range(len(found.reasons))])
    axes.grid(visible=False)
    axes.spines[["left", "bottom"]].set_visible(False)
    plots.quiet(axes)


def _plot_inliers(axes: Axes, found: Found, fewest: int) -> None:
    counts = np.full(found.n_frames, np.nan)
    if found.cameras is None:
        return
    if found.sfm_rows is not None:
        known = found.sfm_rows >= 0
        counts[known] = np.array(found.cameras.inliers_per_frame)[found.sfm_rows[known]]
    _plot_beside(axes, counts, fewest, "Inliers per frame", at_least=True)
    between = found.frames_of(found.cameras.interpolated)
    axes.plot(between, 0.0 * between, "d", color=COLOURS["bad"], markersize=4, zorder=4)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _plot_beside(
    axes: Axes, values: np.ndarray, threshold: float, title: str, *, at_least: bool = False
) -> None:
    """A figure over the frames with its limit, and dots where it is beyond."""
    plots.quiet(axes, title)
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "not known", transform=axes.transAxes, ha="center", va="center")
        return
    frames = np.arange(len(values))
    axes.plot(frames, values, color=COLOURS["camera"], linewidth=1.2)
    axes.fill_between(frames, 0, values, color=COLOURS["camera-pale"], alpha=0.5, linewidth=0)
    axes.axhline(threshold, color=COLOURS["bad"], linewidth=1, linestyle=(0, (4, 3)))
    beyond = values < threshold if at_least else values > threshold
    axes.plot(frames[beyond], values[beyond], ".", color=COLOURS["bad"], markersize=4)
    axes.set_ylim(0, 1.15 * max(float(np.nanmax(values)), threshold))
    axes.yaxis.set_major_locator(MaxNLocator(4))


def cue_words(cue: CueEstimate) -> str:
    """A cue's name, with the person whose feet it is about."""
    name = cue.name.replace("_", " ").replace("ground contact", "feet on the ground")
    return name if cue.person is None else f"{name}, person {cue.person}"


def plot_scale_cues(
    plot: Figure, scale: float, sigma: float, cues: tuple[CueEstimate, ...]
) -> None:
    """Each cue's difference from the fused scale [%], with one and two standard errors."""
    axes = plot.subplots()
    share, plot_bar = 100 * sigma / scale, partial(axes.errorbar, linewidth=2)
    for reach, alpha in ((2 * share, 0.45), (share, 0.9)):
        axes.axvspan(-reach, reach, color=COLOURS["rule"], alpha=alpha, linewidth=0)
    axes.axvline(0, color=COLOURS["muted"], linewidth=1)
    for row, cue in enumerate(cues):
        off, error = 100 * (cue.scale / scale - 1), 100 * cue.sigma / scale
        plot_bar(off, row, xerr=2 * error, color=COLOURS["person-pale"])
        plot_bar(off, row, xerr=error, fmt="o", color=COLOURS["person"], markersize=5, capsize=3)
    plot_bar(0, len(cues), xerr=share, fmt="D", color=COLOURS["ink"], markersize=5, capsize=3)
    plots.name_rows(axes, [*map(cue_words, cues), "fused"])
    axes.set_xlabel("difference from the fused scale [%]")


def person_role(person: int) -> str:
    """The colour of a person: some in turn."""
    return ("person", "gmr", "good", "ink")[person % 4]


def plot_paths(plot: Figure, found: Found, aligned: Aligned | None) -> None:
    """Paths in the levelled world [m], z up: the data set's camera as a pale band under ours."""
    axes, world_from_cam = plot.subplots(), found.world_from_cam
    if world_from_cam is None or found.cameras is None:
        return
    paths_m = [world_from_cam[:, :3, 3], *(c.motion.pelvis_m for c in found.clips.values())]
    tick_m = plots.tick_length_m(paths_m)
    if aligned is not None:
        plots.plot_camera(axes, aligned.world_from_cam, "camera-pale", plots.TRUE_WIDTH, tick_m)
    plots.plot_camera(axes, world_from_cam, "camera", plots.RECOVERED_WIDTH, tick_m)
    people_m = np.nanmean([clip.motion.pelvis_m for clip in found.clips.values()], axis=0)
    plots.mark_start(axes, world_from_cam[:, :3, 3], "camera", "camera", people_m)
    for person, clip in found.clips.items():
        role = person_role(person)
        kept = np.array([not reason for reason in found.reasons[person]])[:, None]
        pelvis_m = clip.motion.pelvis_m
        plots.plot_path(axes, pelvis_m, role, 1.0, ":")
        plots.plot_path(axes, np.where(kept, pelvis_m, np.nan), role, plots.RECOVERED_WIDTH)
        plots.mark_start(axes, pelvis_m, role, f"person {person}", None)
    for marker, role, sfm_rows in (
        ("X", "ink", found.cameras.cuts_after_frames),
        ("d", "bad", found.cameras.interpolated),
    ):
        places_m = world_from_cam[found.frames_of(sfm_rows), :2, 3]
        axes.plot(*places_m.T, marker, color=COLOURS[role], markersize=5, zorder=6)
    plots.finish_view(axes)
