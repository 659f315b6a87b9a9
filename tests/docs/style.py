"""Plain English, measured: long sentences and paragraphs, and turns that readers stumble on.

Tables, code, headings and lists of flags are no sentences.  A piece of code in a sentence is one
word, and so is a link's text as it is read.  `python -m tests.docs.style FILE...` prints what is
wrong; without a file it looks at every page.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.folders import REPOSITORY

LONGEST_SENTENCE, LONGEST_PARAGRAPH = 30, 90  # words
_NUMBERS = r"\d|two|three|four|five|six|seven|eight|nine|ten"
INVERTED = {
    r"^(?:Who|Whoever|Whose|Whom)\b(?!.*\?$)": "begins with who: name the person first",
    r"^What(?:ever)?\b(?!.*\?$)": "begins with what: name the thing first",
    rf"^Of (?!course|(?:the |its |their )?(?:{_NUMBERS}))": "begins with of: put the subject first",
    r"\b[Ww]hom\b": "whom",
    r"(?:[;:] |\b(?:and|of|for|to|by|as|than|if) )who(?:ever)?\b": "who without the person",
    r"\b(?:but|save) for\b|\bbe (?:it|they)\b": "an old turn: except for",
    r"\b(?:thereof|therein|whereof|wherein)\b": "an old turn",
}
"""Patterns of sentences, and what is wrong with them."""
_ABBREVIATED = re.compile(r"\b(eqs?|figs?|e\.g|i\.e|vs|approx|no)\. (?=[\d(a-z])", re.IGNORECASE)
_ENDS = re.compile(r"(?<=[.!?])[\"”’)*_]*\s+(?=[\"“(*_\[]*[A-Z0-9`])")
_ITEM = re.compile(r"^\s*(?:[-*]|\d+\.) ")


def paragraphs(markdown: str) -> Iterator[str]:
    """Running text: paragraphs and items of lists, each in one line."""
    text = re.sub(r"^( *)(```+|~~~).*?^\1\2\s*?$", "\n", markdown, flags=re.M | re.S)
    text = re.sub(r"<!--.*?-->", "\n", text, flags=re.S)
    block: list[str] = []
    for line in [*text.splitlines(), ""]:
        apart = not line.strip() or re.match(r"\s*(?:\||#|!\[)", line) or _ITEM.match(line)
        if apart and block:
            yield " ".join(block)
            block = []
        if line.strip() and not re.match(r"\s*(?:\||#|!\[)", line):
            block.append(_ITEM.sub("", line).strip())


def spoken(paragraph: str) -> str:
    """A paragraph as it is read aloud: links by their texts, a piece of code as one word."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", paragraph)
    text = re.sub(r"`+[^`]+`+", "Code", text)
    return re.sub(r"[*]{1,2}", "", text)


def sentences(paragraph: str) -> list[str]:
    text = _ABBREVIATED.sub(lambda found: f"{found[1]} ", spoken(paragraph))
    return [one for one in _ENDS.split(text) if one]


def n_words(text: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def faults(markdown: str) -> list[str]:
    """What is wrong with a page's sentences and paragraphs, each with its beginning."""
    found = []
    for paragraph in paragraphs(markdown):
        if (words := n_words(spoken(paragraph))) > LONGEST_PARAGRAPH:
            found.append(f"paragraph of {words} words: {paragraph[:70]}")
        for sentence in sentences(paragraph):
            if (words := n_words(sentence)) > LONGEST_SENTENCE:
                found.append(f"sentence of {words} words: {sentence[:110]}")
            said = sentence.lstrip('"“(')
            found += [
                f"{why}: {sentence[:110]}" for p, why in INVERTED.items() if re.search(p, said)
            ]
    return found


def page_words(markdown: str) -> int:
    """As `wc -w` counts: tables, code and numbers too."""
    return len(markdown.split())


if __name__ == "__main__":
    docs, total = sorted((REPOSITORY / "docs").glob("*.md")), 0
    every = [REPOSITORY / "README.md", *docs, REPOSITORY / "CHANGELOG.md"]
    for page in [Path(name) for name in sys.argv[1:]] or every:
        text = page.read_text(encoding="utf-8")
        wrong, words = faults(text), page_words(text)
        total += words if page.name != "CHANGELOG.md" else 0
        sys.stdout.write(f"{page.name}: {words} words, {len(wrong)} faults\n")
        sys.stdout.writelines(f"    {fault}\n" for fault in wrong if sys.argv[1:])
    sys.stdout.write(f"{total} words\n")
