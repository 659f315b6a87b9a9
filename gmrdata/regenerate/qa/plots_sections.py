"""The sections of a page that hold plots: time, paths from above, scale."""

from itertools import groupby
from typing import Any

from matplotlib.figure import Figure

from gmrdata.regenerate.qa.aligned import align_tracked
from gmrdata.regenerate.qa.gather import Found
from gmrdata.regenerate.qa.kinds import Kind, counts_of, kinds_of
from gmrdata.regenerate.qa.paths_plot import PERSON_ROLES, draw_paths
from gmrdata.regenerate.qa.scale_plot import cue_words, draw_scale
from gmrdata.regenerate.qa.style import swatch
from gmrdata.regenerate.qa.time_plots import draw_time, height_in
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.report.markup import figure, key, table, text
from gmrdata.report.style import svg

OPEN_RANGES = 12
"""A longer list of dropped ranges is folded."""


def time_section(found: Found, recipe: ThreedpwRecipe) -> str:
    """HTML: kept and dropped frames over time, with the figures that decided."""
    config = recipe.of_sequence(found.name).pseudo_gt.verdict
    kinds = kinds_of(found.reasons)

    def draw(fig: Figure) -> None:
        draw_time(fig, found, kinds, config)

    picture = svg(draw, 11.0, height_in(found), "time")
    caption = f"Frames by what became of them. {_legend(found, kinds)}"
    if found.world_from_cam is not None:
        caption += (
            "<br>Dashed red: the threshold, with a dot where it is passed; a figure over some time "
            "stands at the frame where that time begins. Dashed black: a cut. "
            "Diamonds: frames whose camera is interpolated."
        )
    return f"<section><h2>Frames over time</h2>{figure(picture, caption)}{_ranges(found)}</section>"


def _legend(found: Found, kinds: dict[str, Kind]) -> str:
    parts = []
    accepted = [person["accepted"] for person in found.record.get("people", ())]
    with_kept = [i for i, reasons in enumerate(found.reasons) if "" in reasons]
    if not found.is_solved and with_kept:
        parts.append(f"{swatch('var(--rule)')} the data set vouches for it")
    if any(accepted[i] for i in with_kept if found.is_solved):
        parts.append(f"{swatch('var(--good)')} kept")
    if any(not accepted[i] for i in with_kept if found.is_solved):
        parts.append(f"{swatch('var(--rule)')} within the thresholds, but rejected")
    for kind, n in counts_of(found.reasons, kinds).items():
        parts.append(f"{swatch(kind.colour)} {text(kind.words)} ({n})")
    return " &emsp;".join(parts)


def _ranges(found: Found) -> str:
    rows = []
    for person, reasons in enumerate(found.reasons):
        stop = 0
        for reason, group in groupby(reasons):
            start, stop = stop, stop + len(list(group))
            if reason:
                span = f"{start} to {stop - 1}" if stop - start > 1 else f"{start}"
                rows.append((f"person {person}", span, str(stop - start), _wrapped(reason)))
    if not rows:
        return "<p>No frame is dropped.</p>"
    listed = table(("person", "frames", "number", "reason"), rows, "Dropped ranges, as counted "
                   "from 0 in the sequence.")  # fmt: skip
    opened = " open" if len(rows) <= OPEN_RANGES else ""
    counted = "One dropped range" if len(rows) == 1 else f"{len(rows)} dropped ranges"
    return f"<details{opened}><summary>{counted}</summary>{listed}</details>"


def _wrapped(words: str) -> str:
    return f'<span class="words-cell">{text(words)}</span>'


def paths_section(found: Found) -> str:
    """HTML: the camera's and the people's paths from above, beside the data set's own camera."""
    world_from_cam = found.world_from_cam
    if world_from_cam is None:
        return (
            "<section><h2>Paths from above</h2><p class='bad'>The world motions can’t be read."
            "</p></section>"
        )
    aligned = None
    if found.tracked is not None:
        aligned = align_tracked(world_from_cam, found.tracked, found.kept)

    def draw(fig: Figure) -> None:
        draw_paths(fig.subplots(), found, aligned)

    people = ", ".join(
        f"{key(PERSON_ROLES[number % len(PERSON_ROLES)], thin=True)} person {number}"
        for number in found.clips
    )
    caption = (
        "From above, in the levelled world [m], z up. "
        f"{key('camera', thin=True)} the recovered camera with its viewing directions, {people}: "
        "solid where kept, dotted where dropped. Dots: where they start. Crosses: cuts; diamonds: "
        "interpolated cameras; a gap: frames without one."
    )
    if aligned is None:
        caption += " The data set’s own camera is known in no kept frame, and isn’t drawn."
    else:
        caption += (
            f" {key('camera-pale')} the data set’s own camera path, moved rigidly onto ours and "
            f"never scaled: turned by the mean difference in orientation over the "
            f"{aligned.n_frames} kept frames, then laid middle on middle. What is left is "
            f"{aligned.rms_m:.3f} m and {aligned.rms_deg:.2f}° (root mean square); 3DPW’s world "
            "drifts, so the two need not agree over long times."
        )
    picture = svg(draw, 7.4, 6.2, "paths")
    drawn = figure(picture, caption, "narrow")
    return f"<section><h2>Paths from above</h2>{drawn}</section>"


def scale_section(record: dict[str, Any]) -> str:
    """HTML: the cues of the metric scale and the fused one."""
    scale, sigma, cues = record.get("scale"), record.get("scale_sigma"), record.get("scale_cues")
    if scale is None or sigma is None or not cues:
        return (
            "<section><h2>Metric scale</h2><p>Scale does not enter: the camera stays in place, or "
            "travels less than can be told.</p>"
            "</section>"
        )
    picture = svg(lambda fig: draw_scale(fig, record), 7.4, 1.0 + 0.32 * (len(cues) + 1), "scale")
    drawn = figure(
        picture,
        "Each cue with one and, paler, two of its standard errors; grey: those of the fused scale, "
        "widened where the cues scatter more than their errors allow.",
        "narrow",
    )
    rows = [
        (text(cue_words(cue)), f"{cue['scale']:.5g}", f"{100 * cue['sigma'] / cue['scale']:.2f}",
         f"{100 * (cue['scale'] / scale - 1):+.2f}", str(cue["support"]),
         f"{1000 * cue['residual_m']:.1f}")
        for cue in cues
    ]  # fmt: skip
    foot = ("fused", f"{scale:.5g}", f"{100 * sigma / scale:.2f}", "", "", "")
    headings = (
        "cue", "scale [m per unit]", "standard error [%]", "from the fused [%]",
        "stances, points or windows", "residual [mm]",
    )  # fmt: skip
    listed = table(headings, rows, "The metric scale, cue by cue.", foot)
    return f"<section><h2>Metric scale</h2>{drawn}{listed}</section>"
