"""A page as a browser takes it in: which elements it has, what it says, where it points."""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Reads a page and refuses elements that are not closed in order."""

    def __init__(self, path: Path, html: str | None = None) -> None:
        super().__init__()
        self.path = path
        self.open: list[str] = []
        self.tags: list[str] = []
        self.values: list[tuple[str, str, str]] = []  # tag, attribute, value
        self.sections: dict[str, str] = {}  # words by the id of their section
        self.section = "header"
        self.words = ""
        self.feed(path.read_text(encoding="utf-8") if html is None else html)
        self.close()
        assert self.open == [], f"{path}: not closed: {self.open}"

    def of(self, *names: str) -> list[str]:
        """Values of some attributes, in the order of the page."""
        return [value for _, name, value in self.values if name in names]

    @property
    def attributes(self) -> set[str]:
        return {name for _, name, _ in self.values}

    @property
    def links(self) -> list[str]:
        return [value for value in self.of("href", "src", "poster") if value]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs).get("id") or ""

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.values += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("style", "script"):
            self.words += data
            self.sections[self.section] = self.sections.get(self.section, "") + data

    @property
    def files(self) -> list[Path]:
        """The files that the page points to; pictures that it carries itself are none."""
        outside = [link for link in self.links if not link.startswith(("data:", "#"))]
        return [
            (self.path.parent / unquote(link, errors="surrogateescape")).resolve()
            for link in outside
        ]
