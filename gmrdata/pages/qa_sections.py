"""The sections of a page that hold plots: time, paths from above, scale.

What the QA pages look like beside the report's style, and pieces that several sections use.

The sections of a page on what was decided: the verdict, and the camera's class.

The section of a page that shows frames: some of all, and one for each reason to drop any.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from gmrdata.pages.document import figure, image, key, mark, pairs, table, text
from gmrdata.pages.qa_data import Found, align_tracked
from gmrdata.pages.qa_figures import Row, class_rows, frame_rows, verdict_rows
from gmrdata.pages.qa_frames import (
    N_TILES,
    Kind,
    Tile,
    counts_of,
    example_frames,
    image_numbers,
    jpeg,
    kinds_of,
    read_tile,
    spaced,
)
from gmrdata.pages.qa_plots import (
    PERSON_ROLES,
    cue_words,
    draw_paths,
    draw_scale,
    draw_time,
    height_in,
)
from gmrdata.pages.style import svg
from gmrdata.threedpw.recipe import ThreedpwRecipe

QA_STYLE = resources.files("gmrdata.pages").joinpath("qa.css").read_text(encoding="utf-8")


def small(rows: Iterable[tuple[str, str]]) -> str:
    """Names and values, both plain text, in small print."""
    listed = pairs((text(name), text(value)) for name, value in rows)
    return listed.replace("<dl>", '<dl class="small">', 1)


def figure_table(rows: Iterable[Row], limit_name: str, caption: str) -> str:
    """Figures beside their thresholds.

    Args:
        rows: The figures.
        limit_name: Heading of the thresholds.
        caption: What the figures are, as HTML.
    """
    cells = [(text(row.name), mark(text(row.value), row.met), text(row.limit)) for row in rows]
    return table(("figure", "value", limit_name), cells, caption)


def swatch(colour: str) -> str:
    """A square of a colour that CSS knows, for legends."""
    return f'<span class="swatch" style="background:{text(colour)}"></span>'


def verdict_section(found: Found, recipe: ThreedpwRecipe) -> str:
    """HTML: accepted or rejected, why, and the figures against their thresholds."""
    judged = found.record.get("people", ())
    parts = [_person(number, person) for number, person in enumerate(judged)]
    if not parts:
        parts = [_said(False, "Rejected", list(found.row["reasons"]))]
    if len(found.message.splitlines()) > 1:
        parts.append(
            f"<details><summary>The whole message</summary><pre>{text(found.message)}</pre>"
            "</details>"
        )
    problems = "".join(f"<li>{text(problem)}</li>" for problem in found.people.get("problems", ()))
    if problems:
        parts.append(f"<h3>What the data set’s files lack</h3><ul>{problems}</ul>")
    if found.is_solved:
        config = recipe.of_sequence(found.name).pseudo_gt.verdict
        parts += [
            "<h3>The figures behind it</h3>",
            figure_table(
                verdict_rows(found, recipe),
                "threshold",
                "What the sequence as a whole was judged by.",
            ),
            figure_table(
                frame_rows(found, config),
                "threshold",
                "The worst of all frames or steps between them; those beyond a threshold are "
                "dropped.",
            ),
        ]
    return f"<section><h2>Verdict</h2>{''.join(parts)}</section>"


def _person(number: int, judged: dict[str, Any]) -> str:
    verdict = "accepted" if judged["accepted"] else "rejected"
    headline = (
        f"Person {number}: {verdict}, {judged['kept_frames']} of {judged['frames']} frames "
        f"({judged['kept_share']:.1%}) within the thresholds"
    )
    return _said(judged["accepted"], headline, judged["reasons"])


def _said(accepted: bool, headline: str, reasons: list[str]) -> str:
    name, sign = ("good", "✓") if accepted else ("bad", "✗")
    why = "".join(f"<br>{text(reason)}" for reason in reasons)
    return (
        f'<p class="verdict {name}"><span class="{name}">{sign}</span>'
        f"<span><strong>{text(headline)}</strong>{why}</span></p>"
    )


def class_section(found: Found, recipe: ThreedpwRecipe) -> str:
    """HTML: the camera's class and what it was decided on."""
    config = recipe.of_sequence(found.name).pseudo_gt.motion_class
    figures = found.record.get("camera_motion_figures", {})
    name = str(found.record["camera_motion"]).replace("_", " + ")
    return (
        f"<section><h2>Camera: {text(name)}</h2>"
        + figure_table(
            class_rows(figures, config),
            "borders of the classes",
            "Of the recovered camera in the frames that have one and a body; see "
            "<code>gmrdata.values.camera_motion</code>.",
        )
        + "</section>"
    )


@dataclass(frozen=True, eq=False)
class Frames:
    """What is shown of a sequence."""

    tiles: tuple[Tile, ...]
    """Evenly spaced frames."""
    dropped: tuple[tuple[Kind, Tile], ...]
    """A frame for each kind of reason, as far as there is room."""


def read_frames(found: Found, masks_dir: Path) -> Frames:
    """Read some frames of a sequence; of one that could not be read, the images that are there."""
    files = found.files
    if files is None or not files.image_dir.is_dir():
        return Frames((), ())
    chosen = spaced(range(found.n_frames) or image_numbers(files))
    examples = example_frames(found.reasons, kinds_of(found.reasons)) if found.is_solved else {}
    return Frames(
        tuple(read_tile(files, masks_dir, number) for number in chosen),
        tuple(
            (kind, read_tile(files, masks_dir, number))
            for kind, number in list(examples.items())[:N_TILES]
        ),
    )


def frames_section(frames: Frames) -> str:
    """HTML: the strips of frames with their masks."""
    if not frames.tiles:
        return "<section><h2>Frames</h2><p>There are no images to show.</p></section>"
    dropped = ""
    if frames.dropped:
        shown = "".join(
            _tile(tile, f"<p>{swatch(kind.colour)} {text(kind.words)}</p>")
            for kind, tile in frames.dropped
        )
        dropped = (
            f'<h3>Dropped frames, one for each reason</h3><div class="tiles six">{shown}</div>'
        )
    return (
        f'<section><h2>Frames</h2><div class="tiles six">{"".join(map(_tile, frames.tiles))}</div>'
        '<p class="caption">Evenly spaced frames; what is masked is tinted and outlined: no '
        f"background point is sought there.</p>{dropped}</section>"
    )


def _tile(tile: Tile, note: str = "") -> str:
    name = f"frame {tile.image_number}"
    problem = f'<p class="bad">{text(tile.problem)}</p>' if tile.problem else ""
    if tile.picture is None:
        return f"<div><p>{name}</p>{note}{problem}</div>"
    height_px, width_px = tile.picture.shape[:2]
    picture = image(jpeg(tile.picture), "jpeg", name, width_px, height_px)
    return f"<div>{picture}<span>{name}</span>{note}{problem}</div>"


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
