"""A comparison of runs as Markdown and as an HTML page that needs nothing beside it.

The paper's Fig. 5: vertex error over time.

Scores as an HTML page that needs nothing beside it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from gmrdata.pages.document import document, figure, key, table, text
from gmrdata.pages.style import COLOURS, picture, quiet, svg
from gmrdata.score.compare import HEADINGS, comparison_explanations, comparison_lead, table_rows
from gmrdata.score.files import read_scores
from gmrdata.score.table import Table, explanations, lead, protocol_rows, score_rows
from gmrdata.values.files import atomic_path, read_json, remove_orphans, write_text

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


def write_scores_page(scores_path: Path) -> Path:
    """Write `scores.html` and `over_time.png` beside a `scores.json`; the path of the page."""
    remove_orphans(scores_path.parent)
    scores = read_scores(scores_path)
    page = scores_path.with_name("scores.html")
    write_text(page, scores_page(scores))
    curves = [curve_of(scores["name"], scores)]
    zero = curve_of("zero motion", scores, "zero")
    with atomic_path(scores_path.with_name("over_time.png")) as temporary:
        temporary.write_bytes(picture(lambda figure: over_time(figure, curves, zero), *SIZE_IN))
    return page


def write_scores_pages(folder: Path) -> None:
    """Write the page of each `<folder>/*/scores.json`."""
    for scores_path in sorted(folder.glob("*/scores.json")):
        write_scores_page(scores_path)


def write_comparison_page(comparison_path: Path, scores_paths: Sequence[Path]) -> Path:
    """Write `comparison.html` beside a `comparison.json`; the path of the page.

    Args:
        comparison_path: The comparison.
        scores_paths: `scores.json` of its runs, in their order.
    """
    remove_orphans(comparison_path.parent)
    records = [read_scores(path) for path in scores_paths]
    page = comparison_path.with_name("comparison.html")
    write_text(page, comparison_page(read_json(comparison_path), records))
    return page


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


def comparison_page(comparison: dict[str, Any], records: Sequence[dict[str, Any]]) -> str:
    """The comparison as a page; the same scores give the same bytes."""
    header = f'<h1>Comparison of runs</h1><p class="lead">{text(comparison_lead(comparison))}</p>'
    sections = [
        _comparison_table(comparison),
        _comparison_over_time(comparison, records),
        _comparison_meaning(comparison),
    ]
    return document("Comparison of runs", header, sections)


def _comparison_table(comparison: dict[str, Any]) -> str:
    made = table(
        [text(cell) for cell in HEADINGS],
        [[text(cell) for cell in row] for row in table_rows(comparison)],
        "Differences to the first run, clip by clip.",
    )
    return f'<section id="runs"><h2>Runs</h2>{made}</section>'


def _comparison_over_time(comparison: dict[str, Any], records: Sequence[dict[str, Any]]) -> str:
    pairs = zip(comparison["runs"], records, strict=True)
    curves = [curve_of(name, record) for name, record in pairs]
    zero = curve_of("zero motion", records[0], "zero")
    drawn = svg(lambda fig: over_time(fig, curves, zero), *SIZE_IN, "over-time")
    caption = (
        "Mean distance of the body’s vertices from the true ones, while motions are accumulated "
        "from the true first pose (the paper’s Fig. 5), of the half of each run’s clips "
        "that lasts longest."
    )
    return (
        '<section id="over-time"><h2>Vertex error over time</h2>'
        f"{figure(drawn, caption, 'narrow')}</section>"
    )


def _comparison_meaning(comparison: dict[str, Any]) -> str:
    lines = "".join(f"<li>{text(line)}</li>" for line in comparison_explanations(comparison))
    return f'<section id="meaning"><h2>How to read this</h2><ul>{lines}</ul></section>'
