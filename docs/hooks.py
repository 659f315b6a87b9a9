"""MkDocs: the site has the pages of docs/, and what they link to elsewhere in the repository.

The pages link to files as a reader of the repository finds them, `../manifests/FORMAT.md`.  In the
site docs/ is the root, and everything else keeps its path: another page is a page, a folder is a
list of its files, and any other text is shown on a page.
"""

import json
import re
from pathlib import Path
from posixpath import dirname, join, normpath, relpath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).resolve().parents[1]
PROJECT = ("CHANGELOG.md", "CONTRIBUTING.md")
"""Pages of the navigation that no other page need link to."""
LINK = re.compile(r"(?<=\]\()(?!https?:)[^)#\s]+")
"""Where a link leads to, without its anchor."""
NAME = re.compile(r"^- `(\w+)(?:\([^`]*\))?`", re.MULTILINE)
"""How the list of public names begins a line."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the pages link to, and what that links to in turn."""
    todo = list(PROJECT)
    for file in files.documentation_pages():
        todo += _linked(f"docs/{file.src_uri}", file.content_string)
    done: set[str] = set()
    while todo:
        path = todo.pop()
        if path in done or path.startswith("docs/") or not (REPOSITORY / path).exists():
            continue  # MkDocs itself says which link leads nowhere
        done.add(path)
        text = _shown(path)
        where = InclusionLevel.UNDEFINED if path in PROJECT else InclusionLevel.NOT_IN_NAV
        files.append(File.generated(config, _in_site(path), content=text, inclusion=where))
        todo += _linked(path, text)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Make links those of the site, and put the docstrings under the list of public names."""
    here = page.file.src_uri
    source = here if page.file.generated_by else f"docs/{here}"
    if source == "docs/api.md":
        markdown = _with_docstrings(markdown)
    if source == "docs/command_line.md":
        markdown += _all_flags()
    if not _has_links(source.removesuffix(".md")) and not _has_links(source):
        return markdown
    return LINK.sub(
        lambda link: relpath(_in_site(_in_repository(source, link[0])), dirname(here) or "."),
        markdown,
    )


def _linked(source: str, markdown: str) -> list[str]:
    """Paths in the repository that a page links to."""
    if not _has_links(source):
        return []
    return [_in_repository(source, link) for link in LINK.findall(markdown)]


def _has_links(path: str) -> bool:
    return path.endswith(".md") or (REPOSITORY / path).is_dir()


def _in_repository(source: str, link: str) -> str:
    return normpath(join(dirname(source), link))


def _in_site(path: str) -> str:
    """The place in the site of a path in the repository."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return path if path.endswith(".md") else f"{path}.md"


def _shown(path: str) -> str:
    """A file or folder outside of docs/ as a page."""
    file = REPOSITORY / path
    if path.endswith(".md"):
        return file.read_text(encoding="utf-8")
    if file.is_dir():
        names = [child.name for child in sorted(file.iterdir()) if child.is_file()]
        lines = [f"- [{name}]({file.name}/{name})" for name in names]
        return "\n".join([f"# {path}", "", *lines, ""])
    if path.endswith(".ipynb"):
        return _cells(json.loads(file.read_text(encoding="utf-8")))
    language = {".py": "python"}.get(file.suffix, file.suffix.removeprefix("."))
    return f"# {path}\n\n````{language}\n{file.read_text(encoding='utf-8')}````\n"


def _cells(notebook: Any) -> str:
    """The cells of a notebook, whose links are left out: they are of its own folder."""
    texts = {"markdown": "{}", "code": "````python\n{}\n````"}
    cells = [(texts[cell["cell_type"]], "".join(cell["source"])) for cell in notebook["cells"]]
    return "\n\n".join(form.format(re.sub(r"\]\([^)]*\)", "]", text)) for form, text in cells)


def _all_flags() -> str:
    """What `--help` says of each verb, from the code."""
    from gmrdata.cli import VERBS, help_of

    text, verbs = "\n## All flags\n", list(VERBS)
    for verb in verbs:
        said = help_of(verb.split())
        text += f"\n### {verb}\n\n````text\n{said.strip()}\n````\n"
        if below := re.match(r"usage: gmrdata \w+ \[-h\] \{([\w,-]+)\}", said):
            verbs += [f"{verb} {name}" for name in below[1].split(",")]
    return text


def _with_docstrings(markdown: str) -> str:
    """The list, whose names lead to the docstrings below it."""
    names = NAME.findall(markdown)
    linked = NAME.sub(lambda line: f"- [{line[0][2:]}](#gmrdata.{line[1]})", markdown)
    entries = "\n\n".join(f"::: gmrdata.{name}" for name in names)
    return f"{linked}\n\n## Docstrings\n\n{entries}\n"
