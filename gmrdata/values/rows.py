"""Rows that share a text, as ranges: reasons of dropped frames, kept stretches."""

from collections.abc import Iterable
from itertools import groupby


def text_runs(texts: Iterable[str]) -> list[tuple[int, int, str]]:
    """All runs of neighbouring rows with one text: (start, one past the last row, text)."""
    runs, start = [], 0
    for text, group in groupby(texts):
        stop = start + len(list(group))
        runs.append((start, stop, text))
        start = stop
    return runs


def texts_of(runs: Iterable[tuple[int, int, str]], n_rows: int) -> list[str]:
    """(n_rows,) the text of each row; empty outside the runs."""
    texts = [""] * n_rows
    for start, stop, text in runs:
        texts[start:stop] = [text] * (stop - start)
    return texts


def first_reasons(reasons: Iterable[str], tests: Iterable[tuple[Iterable[bool], str]]) -> list[str]:
    """(N,) why each row can't be used: its own reason, or that of the first test (N,) it fails."""
    found = list(reasons)
    for passed, reason in tests:
        found = [old or ("" if good else reason) for old, good in zip(found, passed, strict=True)]
    return found
