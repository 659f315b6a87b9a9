"""Each reason that a verdict can give stands in the page that says what to do about it."""

import ast
import re

import pytest

from tests.folders import REPOSITORY

PAGE = REPOSITORY / "docs" / "rejected.md"
FILES = ("world/judge.py", "solve/verdict.py", "cameras/check/verdict.py")
GIVES_REASONS = re.compile(r"(_reasons|_tests|_doubts|_cause|_frames|_runs|judge_cameras|_steps)$")
SHORTEST = 12  # letters of a piece that tell a reason from others


def pieces(file: str) -> set[str]:
    """The longest constant piece of each text in the functions that give reasons."""
    found, text = set(), (REPOSITORY / "gmrdata" / file).read_text(encoding="utf-8")
    for function in ast.walk(ast.parse(text)):
        if not isinstance(function, ast.FunctionDef) or not GIVES_REASONS.search(function.name):
            continue
        documented = ast.get_docstring(function, clean=False)
        for node in ast.walk(function):
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            texts = [p.value for p in parts if isinstance(p, ast.Constant)]
            told = (t for t in texts if isinstance(t, str) and t != documented)
            words = [piece for text in told for piece in text.split("{}")]
            longest = max(words, key=len, default="").strip(" ,;:.")
            if len(longest) >= SHORTEST and " " in longest:
                found.add(longest)
    return found


@pytest.mark.parametrize("file", FILES)
def test_each_reason_is_explained(file):
    page = PAGE.read_text(encoding="utf-8")
    reasons = pieces(file)
    assert len(reasons) >= 5
    assert [reason for reason in sorted(reasons) if reason not in page] == []
