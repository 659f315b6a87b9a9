"""What the QA pages look like beside the report's style, and pieces that several sections use."""

from collections.abc import Iterable
from importlib import resources

from gmrdata.regenerate.qa.figures import Row
from gmrdata.report.markup import mark, pairs, table, text

QA_STYLE = resources.files("gmrdata.regenerate.qa").joinpath("qa.css").read_text(encoding="utf-8")


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
