"""HTML pages that need nothing beside them, from templates that escape every value."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from gmrdata.values.files import write_text


@dataclass(frozen=True)
class Cell:
    """A value of a table, and how it is shown."""

    text: object
    unit: str = ""  # what stands below it, in a heading
    met: bool | None = None
    """Whether it keeps to its threshold; said by a sign and a colour.  None says nothing."""
    href: str = ""
    kind: str = ""  # its class in the style: "beside", "words-cell", ...
    sort: object = None  # what a sortable column goes by, in place of the text
    picture: str = ""  # before the text


@dataclass(frozen=True)
class Table:
    """A table whose first column names the row."""

    headings: Sequence[Cell | str]
    rows: Sequence[Sequence[Cell | str]]
    caption: str
    foot: Sequence[Cell | str] = ()  # a last, quieter row
    sortable: bool = False  # by the column whose heading is clicked


def render(template: str, **values: object) -> str:
    """The page of a template, as text."""
    return _environment().get_template(f"{template}.html.j2").render(values)


def css_colours(colours_bgr: Mapping[str, tuple[int, int, int]]) -> dict[str, str]:
    """Colours by name, as OpenCV has them, in CSS."""
    return {name: "rgb({2} {1} {0})".format(*bgr) for name, bgr in colours_bgr.items()}


def text_of(text: str) -> str:
    """Bytes of file names that are no text stand in it as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def write_page(path: Path, page: str) -> Path:
    """Write a page, as a whole or not at all; gives its path."""
    write_text(path, text_of(page))
    return path


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
