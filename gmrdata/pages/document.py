"""Small pieces of HTML.  Every value from outside goes through `text`.

The frame of an HTML page that needs nothing beside it: its head, its style, its parts.
"""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources


def document(title: str, header: str, sections: Sequence[str], more_style: str = "") -> str:
    """A whole page.

    Args:
        title: The page's title, as plain text.
        header: What stands in its header, as HTML.
        sections: What stands below, as HTML.
        more_style: CSS beside that of all pages.
    """
    style = resources.files("gmrdata.pages").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title>\n<style>\n{style}{more_style}</style></head>\n<body>\n"
        f"<header>{header}</header>\n<main>\n" + "\n".join(sections) + "\n</main>\n</body></html>\n"
    )


def text(value: object) -> str:
    """A value as HTML text or attribute value."""
    return escape(str(value), quote=True)


def table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], caption: str, foot: Sequence[str] = ()
) -> str:
    """A table whose first column names the row and whose other columns hold figures.

    Args:
        headings: Column names with units, as HTML.
        rows: Cells, as HTML.
        caption: What the figures are, as HTML.
        foot: Cells of a last, quieter row, as HTML.
    """
    head = "".join(f'<th scope="col">{cell}</th>' for cell in headings)
    body = "".join(_row(cells) for cells in rows)
    last = f"<tfoot>{_row(foot)}</tfoot>" if foot else ""
    return (
        f'<div class="scroll"><table><caption>{caption}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>{last}</table></div>"
    )


def _row(cells: Sequence[str]) -> str:
    first, *others = cells
    return (
        f'<tr><th scope="row">{first}</th>'
        + "".join(f"<td>{cell}</td>" for cell in others)
        + "</tr>"
    )


def pairs(rows: Iterable[tuple[str, str]]) -> str:
    """A list of names and values, both HTML."""
    return (
        "<dl>"
        + "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in rows)
        + "</dl>"
    )


def figure(picture: str, caption: str, css_class: str = "") -> str:
    """A picture (HTML) over its caption (HTML)."""
    return f'<figure class="{css_class}">{picture}<figcaption>{caption}</figcaption></figure>'


def image(data: bytes, kind: str, alt: str, width_px: int, height_px: int) -> str:
    """An `<img>` that carries its own bytes; `kind` is "png" or "jpeg"."""
    encoded = base64.b64encode(data).decode("ascii")
    return (
        f'<img src="data:image/{kind};base64,{encoded}" alt="{text(alt)}"'
        f' width="{width_px}" height="{height_px}">'
    )


def key(role: str, *, thin: bool = False) -> str:
    """A stroke in the colour of a role, for captions."""
    return f'<span class="key{" thin" if thin else ""}" style="background:var(--{role})"></span>'


def mark(cell: str, met: bool | None) -> str:
    """A figure with its verdict: a sign and a colour, so that it also reads without colour."""
    if met is None:
        return cell
    sign, name = ("✓", "good") if met else ("✗", "bad")
    word = "meets its bar" if met else "misses its bar"
    return f'<span class="{name}">{cell} <span role="img" aria-label="{word}">{sign}</span></span>'
