"""HTML pages from the templates beside this file.

The templates escape every value; a page carries its style and needs nothing beside it.
"""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape


@dataclass(frozen=True)
class Cell:
    """A value of a table, and how it is shown."""

    text: object
    """What it says."""
    unit: str = ""
    """What stands below it, in a heading."""
    met: bool | None = None
    """Whether it keeps to its threshold; said by a sign and a colour.  None says nothing."""
    href: str = ""
    """Where it leads."""
    kind: str = ""
    """Its class in the style: "beside", "words-cell", ..."""
    sort: object = None
    """What a sortable column goes by, in place of the text."""
    picture: str = ""
    """What stands before the text."""


@dataclass(frozen=True)
class Table:
    """A table whose first column names the row."""

    headings: Sequence[Cell | str]
    """Names of the columns."""
    rows: Iterable[Sequence[Cell | str]]
    """A cell for each heading."""
    caption: str
    """What the values are."""
    foot: Sequence[Cell | str] = ()
    """A last, quieter row."""
    sortable: bool = False
    """Whether a click on a heading sorts by that column."""


def image(data: bytes, kind: str, alt: str, width_px: int, height_px: int) -> Markup:
    """An `<img>` that carries its own bytes; `kind` is "png" or "jpeg"."""
    encoded = base64.b64encode(data).decode("ascii")
    return Markup(
        f'<img src="data:image/{kind};base64,{encoded}" alt="{escape(alt)}"'
        f' width="{width_px}" height="{height_px}">'
    )


def render(template: str, **values: object) -> str:
    """The page of a template, as text."""
    return _environment().get_template(f"{template}.html.j2").render(values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("gmrdata.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["cell"] = lambda given: given if isinstance(given, Cell) else Cell(given)
    return environment
