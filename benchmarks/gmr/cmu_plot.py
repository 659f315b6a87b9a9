"""The learning curves: errors on held-out subjects by training time, as shares of zero motion's."""

from collections.abc import Sequence
from pathlib import Path

from gmr.cmu_runs import Trained
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from gmrdata.pages.plots import COLOURS, picture, quiet

SHARES = {"ome_deg": 0.75, "tme_mm": 0.45}
"""What must be reached, as shares of zero motion's error."""
TITLES = {"ome_deg": "OME / that of zero motion", "tme_mm": "TME / that of zero motion"}
ROLES = ("gmr", "camera", "person", "good")


def write_curves(runs: Sequence[Trained], path: Path) -> Path:
    """A PNG with a panel for OME and one for TME."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(picture(lambda figure: _draw(figure, runs), 9.0, 3.6))
    return path


def _draw(figure: Figure, runs: Sequence[Trained]) -> None:
    for axes, (metric, bar) in zip(figure.subplots(1, 2), SHARES.items(), strict=True):
        for run, role in zip(runs, ROLES, strict=False):
            points = [line for line in run.curve if f"held_out_{metric}" in line]
            shares = [
                line[f"held_out_{metric}"] / run.held_out[f"zero_{metric}"] for line in points
            ]
            # Runs differ in the cost of a step; what they have in common is the time.
            minutes = [line["step"] / run.steps * run.minutes for line in points]
            axes.plot(minutes, shares, color=COLOURS[role], marker=".", label=run.name)
        axes.axhline(1.0, color=COLOURS["muted"], linewidth=1)
        axes.axhline(bar, color=COLOURS["good"], linewidth=1, linestyle=(0, (4, 3)))
        axes.set_title(TITLES[metric])
        axes.set_xlabel("training time [min]")
        # Errors of the first steps are many times those of the last.
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.legend(frameon=False)
        quiet(axes)
