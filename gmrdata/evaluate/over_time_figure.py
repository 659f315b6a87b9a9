"""The paper's Fig. 5: vertex error over time."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from gmrdata.report.style import COLOURS, quiet

ROLES = ("gmr", "person", "camera", "good", "bad")
"""Colours of the curves, in their order; then again, dashed."""
SIZE_IN = (7.4, 3.4)
"""Width and height of the figure [inch]."""


class Curve(NamedTuple):
    """One run's mean vertex error over time."""

    name: str
    """Whose it is."""
    times_s: Sequence[float]
    """Time after the first frame [s]."""
    vertex_mm: Sequence[float]
    """Mean over clips and vertices [mm]."""
    interval95_mm: Sequence[Sequence[float]] | None
    """Lower and upper ends [mm]; None for a single clip."""


def curve_of(name: str, scores: dict[str, Any], method: str = "predicted") -> Curve:
    """A curve of a `scores.json`."""
    found = scores["over_time"]
    return Curve(name, found["times_s"], found[method]["vertex_mm"], found[method]["interval95_mm"])


def over_time(figure: Figure, curves: Sequence[Curve], zero: Curve | None = None) -> None:
    """Draw curves with their intervals; zero motion's in grey.

    Args:
        figure: What to draw on.
        curves: What was predicted.
        zero: Zero motion.
    """
    axes = figure.subplots()
    if zero is not None:
        axes.plot(
            zero.times_s,
            zero.vertex_mm,
            color=COLOURS["muted"],
            linewidth=1.2,
            linestyle=(0, (4, 3)),
            label=zero.name,
        )
    for number, curve in enumerate(curves):
        colour = COLOURS[ROLES[number % len(ROLES)]]
        if curve.interval95_mm is not None:
            low, high = curve.interval95_mm
            axes.fill_between(curve.times_s, low, high, color=colour, alpha=0.16, linewidth=0)
        axes.plot(
            curve.times_s,
            curve.vertex_mm,
            color=colour,
            linewidth=1.6,
            linestyle="-" if number < len(ROLES) else "--",
            label=curve.name,
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("vertex error [mm]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, loc="upper left")
    quiet(axes)
