"""Plain English: short sentences and paragraphs, short pages, no turns that readers stumble on."""

from pathlib import Path

import pytest

from tests.docs.page_commands import REPOSITORY
from tests.docs.style import faults, page_words, paragraphs, sentences

DOCS = sorted((REPOSITORY / "docs").glob("*.md"))
README, CHANGELOG = REPOSITORY / "README.md", REPOSITORY / "CHANGELOG.md"
REFERENCE = ("api", "figures", "formats", "metrics")
"""Pages that may be longer than 1,200 words."""


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [README, *DOCS, CHANGELOG], ids=lambda page: page.stem)
def test_a_page_is_plain_english(page: Path) -> None:
    assert faults(read(page)) == []


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_a_page_is_short(page: Path) -> None:
    if page.stem not in REFERENCE:
        assert page_words(read(page)) <= 1200


def test_the_news_of_a_version_are_short() -> None:
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
def test_a_fault_is_seen(text: str, fault: str) -> None:
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
def test_plain_english_has_no_fault(text: str) -> None:
    assert faults(text) == []


def test_text_is_taken_apart_as_a_reader_does() -> None:
    text = "# Head\n\nOne *line*\nand two.\n- An item. It ends.\n- 5. Another\n\n| a | b |\n"
    assert list(paragraphs(text)) == ["One *line* and two.", "An item. It ends.", "5. Another"]
    assert sentences("Run `a. B`, eq. 3. Then [go](x.md).") == ["Run Code, eq 3.", "Then go."]
    assert page_words("# A head\n\nSee `x y` and 5 mm [here](a.md).\n\n```sh\nno\n```\n") == 5
