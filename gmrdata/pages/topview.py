"""Camera and person paths seen from above."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.ticker import MultipleLocator

from gmrdata.pages.curves import usable
from gmrdata.pages.report_data import ClipReport
from gmrdata.pages.style import COLOURS, quiet
from gmrdata.values import transforms
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion

VIEW_TICKS = 12
"""About how many viewing directions are drawn along a camera path."""

TRUE_WIDTH, RECOVERED_WIDTH = 6.0, 1.6
"""Line widths [pt]: the truth is a pale band that the recovered line has to stay on."""


def top_view(axes: Axes, clip: ClipReport) -> float:
    """True (wide, pale) and recovered (thin) paths of camera and person, in the true world [m].

    Returns:
        Spacing of the grid [m].
    """
    true_m = clip.true.motion.pelvis_m
    pelvis_m, world_from_cam = aligned_paths(clip)
    paths_m = [true_m, pelvis_m]
    if clip.true.camera is not None:
        paths_m.append(clip.true.camera.centres_world_m)
    tick_m = 0.09 * extent_m(paths_m)
    if clip.true.camera is not None:
        draw_camera(axes, clip.true.camera.world_from_cam, "camera-pale", TRUE_WIDTH, tick_m)
    draw_path(axes, true_m, "person-pale", TRUE_WIDTH)
    if world_from_cam is not None:
        draw_camera(axes, world_from_cam, "camera", RECOVERED_WIDTH, tick_m)
        mark_start(axes, world_from_cam[:, :3, 3], "camera", "camera", pelvis_m)
    draw_path(axes, pelvis_m, "person", RECOVERED_WIDTH)
    mark_start(axes, pelvis_m, "person", "person", None)
    return finish_view(axes)


def true_top_view(axes: Axes, clip: Clip) -> float:
    """Paths of the camera and the person of one clip alone, in its world [m].

    Returns:
        Spacing of the grid [m].
    """
    pelvis_m = clip.motion.pelvis_m
    if clip.camera is not None:
        poses = clip.camera.world_from_cam
        tick_m = 0.09 * extent_m([pelvis_m, poses[:, :3, 3]])
        draw_camera(axes, poses, "camera", RECOVERED_WIDTH, tick_m)
        mark_start(axes, poses[:, :3, 3], "camera", "camera", pelvis_m)
    draw_path(axes, pelvis_m, "person", RECOVERED_WIDTH)
    mark_start(axes, pelvis_m, "person", "person", None)
    return finish_view(axes)


def motion_top_view(axes: Axes, true: Motion, predicted: Motion) -> float:
    """True (wide, pale) and predicted (thin) person path, both from the true first frame on [m].

    A predicted motion is accumulated from its own first frame (eqs. 3-4), so only what comes after
    can differ.

    Returns:
        Spacing of the grid [m].
    """
    true_from_predicted = transforms.rigid(
        true.root_rotmats[0], true.pelvis_m[0]
    ) @ transforms.invert(transforms.rigid(predicted.root_rotmats[0], predicted.pelvis_m[0]))
    predicted_m = transforms.apply(true_from_predicted, predicted.pelvis_m)
    draw_path(axes, true.pelvis_m, "person-pale", TRUE_WIDTH)
    draw_path(axes, predicted_m, "gmr", RECOVERED_WIDTH)
    axes.plot(*true.pelvis_m[0, :2], "o", color=COLOURS["ink"], markersize=5, zorder=5)
    return finish_view(axes)


def aligned_paths(clip: ClipReport) -> tuple[np.ndarray, np.ndarray | None]:
    """Recovered pelvis (T, 3) and world_from_cam (T, 4, 4) in the true world [m].

    NaN where there is no camera; None for a clip that has none at all.
    """
    good = usable(clip.pseudo)
    pelvis_m = transforms.apply(clip.true_from_pseudo, clip.pseudo.motion.pelvis_m)
    pelvis_m = np.where(good[:, None], pelvis_m, np.nan)
    if clip.pseudo.camera is None:
        return pelvis_m, None
    world_from_cam = clip.true_from_pseudo @ clip.pseudo.camera.world_from_cam
    return pelvis_m, np.where(good[:, None, None], world_from_cam, np.nan)


def extent_m(paths_m: list[np.ndarray]) -> float:
    """The longer side of what holds all paths (T, 2 or 3), seen from above [m]."""
    points_m = np.concatenate(paths_m)[:, :2]
    return float(np.nanmax(np.nanmax(points_m, axis=0) - np.nanmin(points_m, axis=0)))


def draw_path(
    axes: Axes, points_m: np.ndarray, role: str, width_pt: float, style: str = "-"
) -> None:
    """A path (T, 2 or 3) [m]; NaN leaves a gap."""
    axes.plot(
        points_m[:, 0],
        points_m[:, 1],
        color=COLOURS[role],
        linewidth=width_pt,
        linestyle=style,
        zorder=3,
    )


def draw_camera(
    axes: Axes, world_from_cam: np.ndarray, role: str, width_pt: float, tick_m: float
) -> None:
    """A camera's path with strokes along its optical axis, which shrink as it looks up or down."""
    centres_m = world_from_cam[:, :2, 3]
    draw_path(axes, centres_m, role, width_pt)
    known = np.flatnonzero(np.isfinite(centres_m).all(axis=1))
    if not len(known):
        return
    rows = known[np.linspace(0, len(known) - 1, min(VIEW_TICKS, len(known))).round().astype(int)]
    ends_m = centres_m[rows] + tick_m * world_from_cam[rows, :2, 2]
    strokes = np.stack([centres_m[rows], ends_m], axis=1)
    axes.add_collection(
        LineCollection(
            list(strokes),
            colors=COLOURS[role],
            linewidths=0.6 * width_pt,
            capstyle="round",
            zorder=3,
        )
    )


def mark_start(
    axes: Axes, points_m: np.ndarray, role: str, name: str, away_from_m: np.ndarray | None
) -> None:
    """A dot where a path starts, and its name on the side that has room."""
    known = np.flatnonzero(np.isfinite(points_m).all(axis=1))
    if not len(known):
        return
    start = points_m[known[0], :2]
    axes.plot(*start, "o", color=COLOURS[role], markersize=6, zorder=5)
    other = points_m[known].mean(axis=0) if away_from_m is None else np.nanmean(away_from_m, axis=0)
    _label(axes, name, start, role, start - other[:2])


def _label(axes: Axes, text: str, point_m: np.ndarray, role: str, away: np.ndarray) -> None:
    """Text beside a point, on the side that `away` points to."""
    length = float(np.linalg.norm(away))
    side = away / length if length > 0 else np.array([0.0, 1.0])
    axes.annotate(
        text,
        (point_m[0], point_m[1]),
        xytext=(11 * side[0], 11 * side[1]),
        textcoords="offset points",
        color=COLOURS[role],
        ha="left" if side[0] > 0.4 else "right" if side[0] < -0.4 else "center",
        va="bottom" if side[1] > 0.4 else "top" if side[1] < -0.4 else "center",
        zorder=6,
    )


def finish_view(axes: Axes) -> float:
    """Equal axes in metres, with room for the labels, on a square grid; gives its spacing [m]."""
    axes.margins(0.14)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    spacing_m = next((s for s in (0.2, 0.5, 1.0, 2.0) if _span_m(axes) < 10 * s), 5.0)
    axes.xaxis.set_major_locator(MultipleLocator(spacing_m))
    axes.yaxis.set_major_locator(MultipleLocator(spacing_m))
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    quiet(axes)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return spacing_m


def _span_m(axes: Axes) -> float:
    return max(float(np.ptp(axes.get_xlim())), float(np.ptp(axes.get_ylim())))
