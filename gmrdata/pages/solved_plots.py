"""Plots of a sequence: its frames over time, the cues of its scale, its paths from two sides."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gmrdata.pages import plots
from gmrdata.pages.plots import COLOURS
from gmrdata.pages.solved import Aligned, SolvedSequence, kinds_of
from gmrdata.values import transforms
from gmrdata.values.clip import text_runs
from gmrdata.world.recipe import CueEstimate

PERSON_IN, PANEL_IN, AXIS_IN = 0.3, 1.5, 0.45
"""Heights of a person's row, of a plot, and of what is under the lowest [inch]."""


def height_in(solved: SolvedSequence) -> float:
    """Height of the figure that `plot_time` wants [inch]."""
    return AXIS_IN + PERSON_IN * len(solved.reasons) + PANEL_IN * len(_panels(solved))


def _panels(found: SolvedSequence) -> list[Callable[[Axes], None]]:
    """What draws each of the plots below the time line."""
    config, solved = found.config.verdict, found.reconstruction
    if found.world_from_cam is None:
        return []
    panels = [lambda axes: _plot_inliers(axes, found, config.min_inliers)]
    if solved is not None and np.isfinite(errors_px := found.per_frame(solved.errors_px)).any():
        # The threshold is that of the sequence's mean: a frame beyond it is marked, not dropped.
        most_px, of_frames = config.max_reprojection_px, "Mean reprojection error per frame [px]"
        panels.append(lambda axes: _plot_beside(axes, errors_px, most_px, of_frames))
    if (apart := found.window_differences()) is not None:
        span = f"over {config.window_s:g} s from the data set’s own camera"
        turn, way = f"Turn: difference {span} [°]", f"Way: difference {span} [m]"
        panels.append(lambda axes: _plot_beside(axes, apart[0], config.max_window_deg, turn))
        panels.append(lambda axes: _plot_beside(axes, apart[1], config.max_window_m, way))
    return panels


def plot_time(plot: Figure, solved: SolvedSequence) -> None:
    """The time line over the plots, on one axis of frames."""
    panels = _panels(solved)
    heights = [PERSON_IN * len(solved.reasons), *[PANEL_IN] * len(panels)]
    grid = plot.subplots(len(heights), sharex=True, height_ratios=heights, squeeze=False)
    column = list(grid[:, 0])
    _plot_kept(column[0], solved)
    for axes, draw in zip(column[1:], panels, strict=True):
        draw(axes)
    cuts = () if solved.cameras is None else solved.cameras.cuts_after_frames
    for axes in column:
        for cut in solved.frames_of(cuts):
            axes.axvline(cut + 0.5, color=COLOURS["ink"], linewidth=1, linestyle=(0, (2, 2)))
    column[-1].set_xlabel("frame")
    column[-1].set_xlim(-0.5, max(1, solved.n_frames) - 0.5)


def _plot_kept(axes: Axes, solved: SolvedSequence) -> None:
    kinds, accepted = kinds_of(solved.reasons), solved.accepted
    for person, reasons in enumerate(solved.reasons):
        for start, stop, reason in text_runs(reasons):
            kept = COLOURS["good" if accepted[person] else "rule"]
            colour = kinds[reason].colour if reason else kept
            axes.broken_barh([(start - 0.5, stop - start)], (person - 0.4, 0.8), color=colour)
    axes.set_ylim(len(solved.reasons) - 0.5, -0.5)
    axes.set_yticks(range(len(solved.reasons)), solved.row_names)
    axes.grid(visible=False)
    axes.spines[["left", "bottom"]].set_visible(False)
    plots.quiet(axes)


def _plot_inliers(axes: Axes, solved: SolvedSequence, fewest: int) -> None:
    if solved.cameras is None:
        return
    counts = solved.per_frame(solved.cameras.inliers_per_frame)
    _plot_beside(axes, counts, fewest, "Inliers per frame", at_least=True)
    between = solved.frames_of(solved.cameras.interpolated)
    axes.plot(between, 0.0 * between, "d", color=COLOURS["bad"], markersize=4, zorder=4)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _plot_beside(
    axes: Axes, values: np.ndarray, threshold: float, title: str, *, at_least: bool = False
) -> None:
    """A figure over the frames with its limit, and dots where it is beyond."""
    plots.quiet(axes, title)
    if not np.isfinite(values).any():
        plots.nothing(axes, "not known")
        return
    frames = np.arange(len(values))
    axes.plot(frames, values, color=COLOURS["camera"], linewidth=1.2)
    axes.fill_between(frames, 0, values, color=COLOURS["camera-pale"], alpha=0.5, linewidth=0)
    plots.limit(axes, threshold, "bad")
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


FROM_ABOVE = np.eye(4)


def plot_side_view(plot: Figure, solved: SolvedSequence) -> None:
    """The same from the side, across the longest horizontal way of all paths, with the floor."""
    if solved.world_from_cam is None:
        return
    along = _longest_way(np.concatenate([path_m[:, :2] for path_m in _paths_m(solved)]))
    axes_in_world = np.array([[*along, 0.0], [0.0, 0.0, 1.0], [along[1], -along[0], 0.0]])
    plot_paths(plot, solved, None, transforms.rigid(axes_in_world, np.zeros(3)))


def _longest_way(places_m: np.ndarray) -> np.ndarray:
    """The direction (2,) in which places (N, 2) spread most; x where they don't spread."""
    known = places_m[np.isfinite(places_m).all(axis=1)]
    if len(known) < 2 or not np.ptp(known, axis=0).any():
        return np.array([1.0, 0.0])
    along = np.linalg.svd(known - known.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(along if along[np.abs(along).argmax()] > 0 else -along)


def _paths_m(solved: SolvedSequence) -> list[np.ndarray]:
    """The paths (T, 3) of the camera and of everybody."""
    assert solved.world_from_cam is not None
    return [solved.world_from_cam[:, :3, 3], *(c.motion.pelvis_m for c in solved.clips.values())]


def plot_paths(
    plot: Figure,
    solved: SolvedSequence,
    aligned: Aligned | None,
    view_from_world: np.ndarray = FROM_ABOVE,
) -> None:
    """Paths in the levelled world, z up: the data set's camera as a pale band under ours.  The
    first two axes of `view_from_world` (4, 4) are those of the plot."""
    axes, world_from_cam = plot.subplots(), solved.world_from_cam
    if world_from_cam is None or solved.cameras is None:
        return
    view_from_cam = view_from_world @ world_from_cam
    paths_m = [transforms.apply(view_from_world, path_m) for path_m in _paths_m(solved)]
    tick_m = plots.tick_length_m(paths_m)
    if aligned is not None:
        theirs = view_from_world @ aligned.world_from_cam
        plots.plot_camera(axes, theirs, "camera-pale", plots.TRUE_WIDTH, tick_m)
    plots.plot_camera(axes, view_from_cam, "camera", plots.RECOVERED_WIDTH, tick_m)
    away_m = np.concatenate(paths_m[1:] or [paths_m[0]])
    if not np.isfinite(away_m).all(axis=1).any():
        away_m = paths_m[0]
    plots.mark_start(axes, paths_m[0], "camera", "camera", away_m)
    _plot_error_bar(axes, paths_m[0], paths_m[0], solved.scale_share, "camera")
    for person, pelvis_m in zip(solved.clips, paths_m[1:], strict=True):
        role = person_role(person)
        kept = np.array([not reason for reason in solved.reasons[person]])[:, None]
        plots.plot_path(axes, pelvis_m, role, 1.0, ":")
        plots.plot_path(axes, np.where(kept, pelvis_m, np.nan), role, plots.RECOVERED_WIDTH)
        plots.mark_start(axes, pelvis_m, role, f"person {person}", None)
        _plot_error_bar(axes, pelvis_m, paths_m[0], solved.scale_share, role)
    for marker, role, sfm_rows in (
        ("X", "ink", solved.cameras.cuts_after_frames),
        ("d", "bad", solved.cameras.interpolated),
    ):
        places_m = paths_m[0][solved.frames_of(sfm_rows), :2]
        axes.plot(*places_m.T, marker, color=COLOURS[role], markersize=5, zorder=6)
    if view_from_world is FROM_ABOVE:
        plots.finish_view(axes, solved.unit)
    else:
        if solved.clips:
            axes.axhline(0.0, color=COLOURS["muted"], linewidth=1)
        plots.finish_view(axes, solved.unit, ("along", "height"))


def _plot_error_bar(
    axes: Axes, path_m: np.ndarray, centres_m: np.ndarray, share: float | None, role: str
) -> None:
    """Two standard errors of the scale either way, where a path has got furthest by the camera's
    own way: what the scale moves is the camera, and with it whoever it films."""
    both = np.isfinite(path_m).all(axis=1) & np.isfinite(centres_m).all(axis=1)
    if share is None or not both.any():
        return
    ways_m = centres_m - centres_m[both.argmax()]
    furthest = int(np.nanargmax(np.where(both, np.linalg.norm(ways_m[:, :2], axis=1), -1.0)))
    reach_m = 2 * share * ways_m[furthest, :2]
    ends_m = path_m[furthest, :2] + np.array([[-1.0], [1.0]]) * reach_m
    axes.plot(*ends_m.T, color=COLOURS[role], linewidth=1.2, marker="o", markersize=2.5, zorder=5)
