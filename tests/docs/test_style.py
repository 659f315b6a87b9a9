"""Plain English: short sentences and paragraphs, short pages, no turns that readers stumble on."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import docstring_parser
import pytest

import gmrdata
from tests.docs.page_commands import FUNCTIONS
from tests.docs.style import faults, page_words, paragraphs, sentences
from tests.folders import REPOSITORY

DOCS = sorted((REPOSITORY / "docs").glob("*.md"))
README, CHANGELOG = REPOSITORY / "README.md", REPOSITORY / "CHANGELOG.md"


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [README, *DOCS, CHANGELOG], ids=lambda page: page.stem)
def test_a_page_is_plain_english(page):
    assert faults(read(page)) == []


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_a_page_is_short(page):
    if page.stem != "figures":
        assert page_words(read(page)) <= 1200


def test_the_docs_are_short():
    """`cat README.md docs/*.md | wc -w`."""
    assert sum(page_words(read(page)) for page in (README, *DOCS)) <= 20_000


def test_the_news_of_a_version_are_short():
    versions = read(CHANGELOG).split("\n## ")[1:]
    assert [version[:20] for version in versions if page_words(version) > 1500] == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("Who is last writes the whole.", "begins with who"),
        ("Of cameras alone, lengths have no metric unit.", "begins with of"),
        ("It takes people whom another system saw.", "whom"),
        ("Two run, and who ends last writes.", "who without the person"),
        ("What is left is named.", "begins with what"),
        ("It keeps all but for one.", "an old turn"),
        (" ".join(["word"] * 31) + ".", "sentence of 31 words"),
        (" ".join(["A word of it."] * 25), "paragraph of 100 words"),
    ],
)
def test_a_fault_is_seen(text, fault):
    assert any(fault in one for one in faults(text))


@pytest.mark.parametrize(
    "text",
    [
        "Of 78 files 55 are read.",
        "What do you want to do?",
        "People who walk are seen. See eq. 5 and [the page](a.md).",
        "| Who is last writes the whole |",
        "```sh\nWho is last\n```",
    ],
)
def test_plain_english_has_no_fault(text):
    assert faults(text) == []


def test_text_is_taken_apart_as_a_reader_does():
    text = "# Head\n\nOne *line*\nand two.\n- An item. It ends.\n- 5. Another\n\n| a | b |\n"
    assert list(paragraphs(text)) == ["One *line* and two.", "An item. It ends.", "5. Another"]
    assert sentences("Run `a. B`, eq. 3. Then [go](x.md).") == ["Run Code, eq 3.", "Then go."]
    assert page_words("# A head\n\nSee `x y`, 5 mm.\n\n```sh\nno\n```\n\n| a | b |\n") == 16


def help_texts() -> dict[str, str]:
    """What `--help` says of verbs and flags, and `help` of public names, by its place."""
    texts = {}
    public = {name: getattr(gmrdata, name) for name in gmrdata.__all__}
    for name, documented in (FUNCTIONS | public).items():
        said = docstring_parser.parse(inspect.getdoc(documented) or "")
        texts[name] = f"{said.short_description}\n\n{said.long_description or ''}"
        texts |= {f"{name} {one.arg_name}": one.description or "" for one in said.params}
    for path in sorted((REPOSITORY / "gmrdata" / "cli").glob("*.py")):
        tree = ast.parse(read(path))
        for node in ast.walk(tree):
            if isinstance(node, ast.keyword) and node.arg == "help":
                if isinstance(node.value, ast.Constant):
                    texts[f"{path.name}:{node.value.lineno}"] = str(node.value.value)
            elif isinstance(node, ast.ClassDef):
                values = [one.value for one in node.body if isinstance(one, ast.Expr)]
                for value in values:
                    if isinstance(value, ast.Constant):
                        texts[f"{path.name}:{value.lineno}"] = inspect.cleandoc(str(value.value))
    return texts


@pytest.mark.parametrize(("place", "text"), help_texts().items())
def test_a_help_text_is_plain_english(place, text):
    assert faults(text) == []


def said_in(call: ast.AST) -> Iterator[str]:
    """The texts of an error that is raised, or of a line that is said; values are one word."""
    if isinstance(call, ast.Raise):
        arguments = call.exc.args if isinstance(call.exc, ast.Call) else []
    elif isinstance(call, ast.Call) and getattr(call.func, "id", "") in (
        "remark",
        "answer",
        "fail",
    ):
        arguments = call.args[:1]
    else:
        return
    for argument in arguments:
        parts = argument.values if isinstance(argument, ast.JoinedStr) else [argument]
        yield "".join(str(p.value) if isinstance(p, ast.Constant) else "X" for p in parts)


def test_messages_are_plain_english():
    wrong, count = [], 0
    for path in sorted((REPOSITORY / "gmrdata").rglob("*.py")):
        for node in ast.walk(ast.parse(read(path))):
            for text in said_in(node):
                count += 1
                wrong += [f"{path.name}:{node.lineno}: {fault}" for fault in faults(text)]
    assert wrong == [] and count > 1000
