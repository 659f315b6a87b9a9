"""The frame of an HTML page that needs nothing beside it: its head, its style, its parts."""

from collections.abc import Sequence
from importlib import resources

from gmrdata.report.markup import text


def document(title: str, header: str, sections: Sequence[str], more_style: str = "") -> str:
    """A whole page.

    Args:
        title: The page's title, as plain text.
        header: What stands in its header, as HTML.
        sections: What stands below, as HTML.
        more_style: CSS beside that of all pages.
    """
    style = resources.files("gmrdata.report").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title>\n<style>\n{style}{more_style}</style></head>\n<body>\n"
        f"<header>{header}</header>\n<main>\n" + "\n".join(sections) + "\n</main>\n</body></html>\n"
    )
