"""Plots: their look, their bytes as SVG for pages or as pictures, and the view from above."""

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Annotation, Text
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import Bbox

from gmrdata.pages.report_data import ClipReport
from gmrdata.values import transforms
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion

COLOURS = {
    "paper": "#ffffff",
    "ink": "#1d2329",
    "muted": "#68717a",
    "rule": "#e2e4e6",
    "person": "#1565b0",
    "person-pale": "#b4d5f5",
    "camera": "#d9480e",
    "camera-pale": "#ffcba6",
    "gmr": "#7a3fc4",
    "good": "#237a3b",
    "bad": "#c4222e",
}
"""Role -> colour on white.  In the page each one becomes the CSS variable of that name, so that
plots follow the reader's light or dark scheme; no two roles may share a colour."""

EAST_ASIAN = {"Noto Sans CJK JP", "WenQuanYi Micro Hei", "Droid Sans Fallback", "Arial Unicode MS"}
"""Fonts of systems for Chinese, Japanese and Korean, of which DejaVu Sans has boxes alone."""

_RC: Any = {
    "svg.fonttype": "none",
    "text.parse_math": False,  # names of clips and runs may have a $
    "font.size": 9.5,
    "font.sans-serif": ["DejaVu Sans"],
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.linewidth": 0.7,
    "lines.solid_capstyle": "round",
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor"), "none"),
    **dict.fromkeys(("axes.titlecolor", "text.color"), COLOURS["ink"]),
    **dict.fromkeys((f"{of}.labelcolor" for of in ("axes", "xtick", "ytick")), COLOURS["muted"]),
    **dict.fromkeys((f"{of}.color" for of in ("grid", "xtick", "ytick")), COLOURS["rule"]),
    "axes.edgecolor": COLOURS["rule"],
}

_DIGITS = re.compile(r"(\.[0-9]{2})[0-9]+")  # decimals from the third on

Draw = Callable[[Figure], object]  # fills a plot; called inside the style

VIEW_TICKS = 12  # about how many viewing directions are drawn along a camera path
TRUE_WIDTH, RECOVERED_WIDTH = 6.0, 1.6
"""Line widths [pt]: the truth is a pale band that the recovered line has to stay on."""
LABEL_PT = 11.0  # from a point to its label [pt]
_LABEL = "label"


def svg(draw: Draw, width_in: float, height_in: float, name: str) -> Markup:
    """An inline SVG element whose colours are CSS variables, and whose inner ids are made from
    `name`, which is unique on the page; the page scales it to its column."""
    stream = io.StringIO()
    with _style({"svg.hashsalt": name}):
        plot = drawn(draw, width_in, height_in, dpi=72)
        plot.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return Markup(_inline(stream.getvalue(), name))


def picture(draw: Draw, width_in: float, height_in: float, dpi: int = 150) -> bytes:
    """The .png of a plot on white."""
    stream = io.BytesIO()
    with _style({}):
        plot = drawn(draw, width_in, height_in, dpi)
        white = COLOURS["paper"]
        plot.savefig(stream, format="png", facecolor=white, metadata={"Software": None})
    return stream.getvalue()


def drawn(draw: Draw, width_in: float, height_in: float, dpi: int) -> Figure:
    """A plot on a canvas of its own, its labels clear of other text."""
    layout = ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05)
    plot = Figure(figsize=(width_in, height_in), layout=layout, dpi=dpi)
    FigureCanvasAgg(plot)
    draw(plot)
    _place_labels(plot)
    return plot


@contextmanager
def _style(more: Any) -> Iterator[None]:
    """Our look alone, whatever the user's matplotlibrc says; the settings are put back after it."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_RC)
        at_hand = EAST_ASIAN.intersection(fontManager.get_font_names())
        mpl.rcParams.update({"font.family": ["sans-serif", *sorted(at_hand)]} | more)
        yield


def quiet(axes: Axes, title: str = "") -> None:
    """Take the ticks' strokes away; the grid says the same."""
    axes.tick_params(length=0)
    if title:
        axes.set_title(title)


def nothing(axes: Axes, why: str) -> None:
    """Words in place of what is not known."""
    label = axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center")
    label.set_color(COLOURS["muted"])


def limit(axes: Axes, value: float, role: str) -> None:
    """A dashed line across a plot over time."""
    axes.axhline(value, color=COLOURS[role], linewidth=1, linestyle=(0, (4, 3)))


def name_rows(axes: Axes, names: Sequence[str]) -> None:
    """A row of the plot for each name, from the top down, without lines across."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", labelcolor=COLOURS["ink"])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    quiet(axes)


def _inline(document: str, name: str) -> str:
    """The `<svg>` element of an SVG document, without what only a file of its own needs."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r'(<g\b[^>]*?) id="[^"]*"', r"\1", element)
    # matplotlib makes ids from coordinates whose last bit the layout's solver leaves to chance.
    for number, id in enumerate(dict.fromkeys(re.findall(r' id="([^"]*)"', element))):
        element = element.replace(f'id="{id}"', f'id="{name}-{number}"')
        element = element.replace(f"#{id})", f"#{name}-{number})")
        element = element.replace(f'href="#{id}"', f'href="#{name}-{number}"')
    # A hundredth of a point is finer than any screen, and long curves are mostly digits.
    element = re.sub(r"<[^>]*>", lambda tag: _DIGITS.sub(r"\1", tag[0]), element)
    # The size is the viewBox's; the page's column gives the width.
    for size in ("width", "height"):
        element = re.sub(rf'(<svg[^>]*?) {size}="[^"]*"', r"\1", element, count=1)
    for role, colour in COLOURS.items():
        element = element.replace(colour, f"var(--{role})")
    return element.strip()


def plot_top_view(axes: Axes, clip: ClipReport) -> float:
    """True (wide, pale) and recovered (thin) paths in the true world; gives the grid's step [m]."""
    true_m, camera = clip.true.motion.pelvis_m, clip.true.camera
    pelvis_m, world_from_cam = aligned_paths(clip)
    centres_m = [] if camera is None else [camera.centres_world_m]
    tick_m = tick_length_m([true_m, pelvis_m, *centres_m])
    if camera is not None:
        plot_camera(axes, camera.world_from_cam, "camera-pale", TRUE_WIDTH, tick_m)
    plot_path(axes, true_m, "person-pale", TRUE_WIDTH)
    return _plot_found(axes, pelvis_m, world_from_cam, tick_m)


def plot_clip_view(axes: Axes, clip: Clip) -> float:
    """Paths of the camera and the person of one clip alone, in its world [m]; see above."""
    pelvis_m = clip.motion.pelvis_m
    if clip.camera is None:
        return _plot_found(axes, pelvis_m, None, 0.0)
    tick_m = tick_length_m([pelvis_m, clip.camera.centres_world_m])
    return _plot_found(axes, pelvis_m, clip.camera.world_from_cam, tick_m)


def _plot_found(
    axes: Axes, pelvis_m: np.ndarray, world_from_cam: np.ndarray | None, tick_m: float
) -> float:
    if world_from_cam is not None:
        plot_camera(axes, world_from_cam, "camera", RECOVERED_WIDTH, tick_m)
        mark_start(axes, world_from_cam[:, :3, 3], "camera", "camera", pelvis_m)
    plot_path(axes, pelvis_m, "person", RECOVERED_WIDTH)
    mark_start(axes, pelvis_m, "person", "person", None)
    return finish_view(axes)


def plot_predicted_view(axes: Axes, true: Motion, predicted: Motion) -> float:
    """True (wide, pale) and predicted (thin) person path [m], both from the true first frame on,
    since a predicted motion is accumulated from its own first frame (eqs. 3-4)."""
    true_from_predicted = transforms.rigid(
        true.root_rotmats[0], true.pelvis_m[0]
    ) @ transforms.invert(transforms.rigid(predicted.root_rotmats[0], predicted.pelvis_m[0]))
    predicted_m = transforms.apply(true_from_predicted, predicted.pelvis_m)
    plot_path(axes, true.pelvis_m, "person-pale", TRUE_WIDTH)
    plot_path(axes, predicted_m, "gmr", RECOVERED_WIDTH)
    axes.plot(*true.pelvis_m[0, :2], "o", color=COLOURS["ink"], markersize=5, zorder=5)
    return finish_view(axes)


def aligned_paths(clip: ClipReport) -> tuple[np.ndarray, np.ndarray | None]:
    """Recovered pelvis (T, 3) and world_from_cam (T, 4, 4) in the true world [m], NaN where there
    is no camera; None for a clip that has none at all."""
    good = clip.has_camera
    pelvis_m = transforms.apply(clip.true_from_pseudo, clip.pseudo.motion.pelvis_m)
    pelvis_m = np.where(good[:, None], pelvis_m, np.nan)
    if clip.pseudo.camera is None:
        return pelvis_m, None
    world_from_cam = clip.true_from_pseudo @ clip.pseudo.camera.world_from_cam
    return pelvis_m, np.where(good[:, None, None], world_from_cam, np.nan)


def tick_length_m(paths_m: list[np.ndarray]) -> float:
    """Length of a viewing direction [m], by the longer side of what holds all paths from above."""
    points_m = np.concatenate(paths_m)[:, :2]
    return 0.09 * float(np.nanmax(np.nanmax(points_m, axis=0) - np.nanmin(points_m, axis=0)))


def plot_path(axes: Axes, path_m: np.ndarray, role: str, width_pt: float, dash: str = "-") -> None:
    """A path (T, 2 or 3) [m]; NaN leaves a gap."""
    axes.plot(*path_m.T[:2], dash, color=COLOURS[role], linewidth=width_pt, zorder=3)


def plot_camera(
    axes: Axes, world_from_cam: np.ndarray, role: str, width_pt: float, tick_m: float
) -> None:
    """A camera's path with strokes along its optical axis, which shrink as it looks up or down."""
    centres_m = world_from_cam[:, :2, 3]
    plot_path(axes, centres_m, role, width_pt)
    known = np.flatnonzero(np.isfinite(centres_m).all(axis=1))
    if not len(known):
        return
    rows = known[np.linspace(0, len(known) - 1, min(VIEW_TICKS, len(known))).round().astype(int)]
    ends_m = centres_m[rows] + tick_m * world_from_cam[rows, :2, 2]
    strokes = np.stack([centres_m[rows], ends_m], axis=1)
    look = {"colors": COLOURS[role], "linewidths": 0.6 * width_pt, "capstyle": "round"}
    axes.add_collection(LineCollection(list(strokes), zorder=3, **look))


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
    away = start - other[:2]
    label = axes.annotate(name, (start[0], start[1]), (0, 0), textcoords="offset points")
    label.set(color=COLOURS[role], gid=_LABEL, zorder=6)
    # Where it stands must not move the axes: it is chosen by them.
    label.set_in_layout(False)
    _put(label, float(np.arctan2(away[1], away[0])) if away.any() else np.pi / 2)


def _put(label: Annotation, angle_rad: float) -> None:
    x, y = np.cos(angle_rad), np.sin(angle_rad)
    label.xyann = (LABEL_PT * x, LABEL_PT * y)
    label.set_horizontalalignment("left" if x > 0.4 else "right" if x < -0.4 else "center")
    label.set_verticalalignment("bottom" if y > 0.4 else "top" if y < -0.4 else "center")


def _place_labels(plot: Figure) -> None:
    """Turn each label round its point to where it covers no text and as little as can be."""
    texts = [text for text in plot.findobj(Text) if text.get_visible() and text.get_text().strip()]
    labels = [text for text in texts if isinstance(text, Annotation) and text.get_gid() == _LABEL]
    if not labels:
        return
    plot.draw_without_rendering()
    taken = [text.get_window_extent() for text in texts if text not in labels]
    points = {id(axes): _points_of(axes) for axes in plot.axes}
    for label in labels:
        of_paths = points[id(label.axes)]
        first = float(np.arctan2(label.xyann[1], label.xyann[0]))
        sides = [first + turn * np.pi / 4 for turn in (0, 1, -1, 2, -2, 3, -3, 4)]
        _put(label, min(sides, key=lambda side: _covered(label, side, taken, of_paths)))
        taken.append(label.get_window_extent())


def _points_of(axes: Axes) -> np.ndarray:
    """(N, 2) where the points of all paths are in the picture, as far as they are known."""
    paths = [np.zeros((0, 2)), *(np.asarray(line.get_xydata()) for line in axes.get_lines())]
    paths += [np.asarray(path.vertices) for c in axes.collections for path in c.get_paths()]
    points = axes.transData.transform(np.concatenate(paths))
    return points[np.isfinite(points).all(axis=1)]


def _covered(
    label: Annotation, angle_rad: float, taken: Sequence[Bbox], points: np.ndarray
) -> tuple[int, bool, int]:
    """Texts that a label covers on a side, whether it leaves its axes, and points of paths."""
    _put(label, angle_rad)
    axes, box = label.axes, label.get_window_extent()
    assert axes is not None
    room = axes.get_window_extent()
    leaves = not (room.contains(box.x0, box.y0) and room.contains(box.x1, box.y1))
    inside = ((points >= box.min) & (points <= box.max)).all(axis=1)
    return box.count_overlaps(list(taken)), leaves, int(inside.sum())


def finish_view(axes: Axes, unit: str = "m", names: tuple[str, str] = ("x", "y")) -> float:
    """Equal axes in metres, with room for the labels, on a square grid; gives its spacing [m]."""
    axes.margins(0.2)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    span_m = max(float(np.ptp(axes.get_xlim())), float(np.ptp(axes.get_ylim())))
    spacing_m = grid_spacing(span_m)
    axes.xaxis.set_major_locator(MultipleLocator(spacing_m))
    axes.yaxis.set_major_locator(MultipleLocator(spacing_m))
    axes.set(xlabel=f"{names[0]} [{unit}]", ylabel=f"{names[1]} [{unit}]")
    quiet(axes)
    axes.spines[:].set_visible(False)
    return spacing_m


def grid_spacing(span: float) -> float:
    """The least of 1, 2 and 5 times a power of ten that a span holds less than ten times."""
    power = 10.0 ** np.floor(np.log10(max(span, 1e-6) / 10))
    return next((m * power for m in (1.0, 2.0, 5.0) if span < 10 * m * power), 10 * power)
