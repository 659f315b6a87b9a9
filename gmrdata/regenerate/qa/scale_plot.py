"""The cues of the metric scale with their error bars, beside the scale that they were fused to."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from gmrdata.report.style import COLOURS, quiet

CUE_WORDS = {
    "planted_feet": "planted feet",
    "ground_contact": "feet on the ground",
    "short_windows": "short windows",
}


def cue_words(cue: Mapping[str, Any]) -> str:
    """A cue's name, with the person whose feet it is about."""
    name = CUE_WORDS.get(cue["name"], str(cue["name"]).replace("_", " "))
    return name if cue["person"] is None else f"{name}, person {cue['person']}"


def draw_scale(figure: Figure, record: Mapping[str, Any]) -> None:
    """Each cue's difference from the fused scale [%], with one and two standard errors."""
    axes = figure.subplots()
    scale, sigma, cues = record["scale"], record["scale_sigma"], record["scale_cues"]
    share = 100 * sigma / scale
    for sigmas, alpha in ((2, 0.45), (1, 0.9)):
        axes.axvspan(
            -sigmas * share, sigmas * share, color=COLOURS["rule"], alpha=alpha, linewidth=0
        )
    axes.axvline(0, color=COLOURS["muted"], linewidth=1)
    for row, cue in enumerate(cues):
        off, error = 100 * (cue["scale"] / scale - 1), 100 * cue["sigma"] / scale
        axes.errorbar(off, row, xerr=2 * error, color=COLOURS["person-pale"], linewidth=2)
        axes.errorbar(
            off, row, xerr=error, fmt="o", color=COLOURS["person"], markersize=5, linewidth=2,
            capsize=3,
        )  # fmt: skip
    axes.errorbar(
        0, len(cues), xerr=share, fmt="D", color=COLOURS["ink"], markersize=5, linewidth=2,
        capsize=3,
    )  # fmt: skip
    axes.set_yticks(range(len(cues) + 1), [*map(cue_words, cues), "fused"])
    axes.tick_params(axis="y", labelcolor=COLOURS["ink"])
    axes.set_ylim(len(cues) + 0.6, -0.6)
    axes.set_xlabel("difference from the fused scale [%]")
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    quiet(axes)
