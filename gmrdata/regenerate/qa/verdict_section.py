"""The sections of a page on what was decided: the verdict, and the camera's class."""

from typing import Any

from gmrdata.regenerate.qa.figures import class_rows, frame_rows, verdict_rows
from gmrdata.regenerate.qa.gather import Found
from gmrdata.regenerate.qa.style import figure_table
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.report.markup import text


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
            "<code>gmrdata.geometry.motion_class</code>.",
        )
        + "</section>"
    )
