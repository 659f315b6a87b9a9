"""Scores as an HTML page that needs nothing beside it."""

from typing import Any

from gmrdata.evaluate.over_time_figure import SIZE_IN, curve_of, over_time
from gmrdata.evaluate.table import score_rows
from gmrdata.evaluate.words import explanations, lead
from gmrdata.report.document import document
from gmrdata.report.markup import figure, key, table, text
from gmrdata.report.style import svg


def scores_page(scores: dict[str, Any]) -> str:
    """The page of a `scores.json`; the same scores give the same bytes."""
    title = f"Scores of {scores['name']}"
    header = f'<h1>{text(title)}</h1><p class="lead">{text(lead(scores))}</p>'
    return document(title, header, [_table(scores), _over_time(scores), _meaning(scores)])


def _table(scores: dict[str, Any]) -> str:
    headings, rows = score_rows(scores)
    made = table(
        [text(cell) for cell in headings],
        [[text(cell) for cell in row] for row in rows],
        "Means over motions, with 95 % bootstrap intervals over clips.",
    )
    statements = "".join(f"<li>{text(line)}</li>" for line in scores.get("statements", ()))
    below = f"<ul>{statements}</ul>" if statements else ""
    return f'<section id="scores"><h2>Scores</h2>{made}{below}</section>'


def _over_time(scores: dict[str, Any]) -> str:
    curves = [curve_of(scores["name"], scores)]
    zero = curve_of("zero motion", scores, "zero")
    drawn = svg(lambda fig: over_time(fig, curves, zero), *SIZE_IN, "over-time")
    caption = (
        "Mean distance of the body’s vertices from the true ones, while motions are accumulated "
        f"from the true first pose without any later correction (the paper’s Fig. 5): "
        f"{key('gmr')} predicted, {key('muted', thin=True)} zero motion. The band is the 95 % "
        "interval over clips. The curve ends where fewer than half of the clips go on."
    )
    return (
        '<section id="over-time"><h2>Vertex error over time</h2>'
        f"{figure(drawn, caption, 'narrow')}</section>"
    )


def _meaning(scores: dict[str, Any]) -> str:
    lines = "".join(f"<li>{text(line)}</li>" for line in explanations(scores))
    return f'<section id="meaning"><h2>How to read this</h2><ul>{lines}</ul></section>'
