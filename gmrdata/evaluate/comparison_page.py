"""A comparison of runs as Markdown and as an HTML page that needs nothing beside it."""

from collections.abc import Sequence
from typing import Any

from gmrdata.evaluate.comparison_table import HEADINGS, table_rows
from gmrdata.evaluate.metric_words import METRIC_WORDS
from gmrdata.evaluate.over_time_figure import SIZE_IN, curve_of, over_time
from gmrdata.evaluate.text_files import markdown_table
from gmrdata.report.document import document
from gmrdata.report.markup import figure, table, text
from gmrdata.report.style import svg


def comparison_markdown(comparison: dict[str, Any]) -> str:
    """The comparison as Markdown."""
    parts = ["# Comparison of runs\n", lead(comparison) + "\n"]
    parts.append(markdown_table(HEADINGS, table_rows(comparison)))
    return "\n".join([*parts, *(f"- {line}" for line in explanations(comparison))]) + "\n"


def comparison_page(comparison: dict[str, Any], records: Sequence[dict[str, Any]]) -> str:
    """The comparison as a page; the same scores give the same bytes."""
    header = f'<h1>Comparison of runs</h1><p class="lead">{text(lead(comparison))}</p>'
    sections = [_table(comparison), _over_time(comparison, records), _meaning(comparison)]
    return document("Comparison of runs", header, sections)


def lead(comparison: dict[str, Any]) -> str:
    """What was compared, in a sentence."""
    first, *others = comparison["runs"]
    return (
        f"{', '.join(others)} against {first}, on {len(comparison['clips'])} clips that all runs "
        f"have, at {comparison['fps_hz']:g} fps."
    )


def explanations(comparison: dict[str, Any]) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    lines = [
        "Figures are means of the clips' means: each clip counts once. A difference below 0 is a "
        "smaller error than the first run's.",
        f"Intervals: 95 %, by bootstrap: {comparison['resamples']} times clips were drawn with "
        "replacement.",
        "p: two-sided paired permutation test over clips. Values are not corrected for the number "
        "of metrics and runs.",
    ]
    lines += [
        f"{METRIC_WORDS[metric].title}: {METRIC_WORDS[metric].meaning}"
        for metric in METRIC_WORDS
        if metric in comparison["metrics"]
    ]
    return lines + [
        f"Only in some runs, and left out of {name}: {', '.join(ids)}."
        for name, ids in comparison["left_out"].items()
        if ids
    ]


def _table(comparison: dict[str, Any]) -> str:
    made = table(
        [text(cell) for cell in HEADINGS],
        [[text(cell) for cell in row] for row in table_rows(comparison)],
        "Differences to the first run, clip by clip.",
    )
    return f'<section id="runs"><h2>Runs</h2>{made}</section>'


def _over_time(comparison: dict[str, Any], records: Sequence[dict[str, Any]]) -> str:
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


def _meaning(comparison: dict[str, Any]) -> str:
    lines = "".join(f"<li>{text(line)}</li>" for line in explanations(comparison))
    return f'<section id="meaning"><h2>How to read this</h2><ul>{lines}</ul></section>'
