"""Scores as an HTML page that needs nothing beside it."""

from typing import Any

from gmrdata.evaluate.over_time_figure import SIZE_IN, curve_of, over_time
from gmrdata.evaluate.table import Table, protocol_rows, score_rows
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
    made = _html_table(score_rows(scores), "Means over motions, and 95 % intervals over clips.")
    protocol = protocol_rows(scores)
    if protocol is not None:
        name = text(scores["protocol"]["name"])
        made += f"<h3>Protocol {name}</h3>" + _html_table(
            protocol, f"As {name} measures, and 95 % intervals over clips."
        )
    statements = "".join(f"<li>{text(line)}</li>" for line in scores.get("statements", ()))
    below = f"<ul>{statements}</ul>" if statements else ""
    return f'<section id="scores"><h2>Scores</h2>{made}{below}</section>'


def _html_table(rows: Table, caption: str) -> str:
    headings, cells = rows
    return table(
        [text(cell) for cell in headings], [[text(cell) for cell in row] for row in cells], caption
    )


def _over_time(scores: dict[str, Any]) -> str:
    curves = [curve_of(scores["name"], scores)]
    zero = curve_of("zero motion", scores, "zero")
    n_clips = len(scores["over_time"]["clips"])
    drawn = svg(lambda fig: over_time(fig, curves, zero), *SIZE_IN, "over-time")
    caption = (
        "Mean distance of the body’s vertices from the true ones, while motions are accumulated "
        f"from the true first pose without any later correction (the paper’s Fig. 5): "
        f"{key('gmr')} predicted, {key('muted', thin=True)} zero motion. The band is the 95 % "
        f"interval over clips. It is of {n_clips} clips, the half that lasts longest, "
        "from the first frame of the longest stretch without a gap."
    )
    return (
        '<section id="over-time"><h2>Vertex error over time</h2>'
        f"{figure(drawn, caption, 'narrow')}</section>"
    )


def _meaning(scores: dict[str, Any]) -> str:
    lines = "".join(f"<li>{text(line)}</li>" for line in explanations(scores))
    return f'<section id="meaning"><h2>How to read this</h2><ul>{lines}</ul></section>'
