"""Runs of rows that share a text, and back."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from gmrdata.values.clip import text_runs, texts_of


@given(st.lists(st.sampled_from(["", "a", "b"]), max_size=30))
def test_runs_tile_the_rows_and_give_the_texts_back(texts):
    runs = text_runs(texts)
    assert [start for start, _, _ in runs] == [0, *[stop for _, stop, _ in runs]][: len(runs)]
    assert all(a[2] != b[2] for a, b in pairwise(runs))
    assert texts_of(runs, len(texts)) == texts
    assert texts_of((run for run in runs if run[2]), len(texts)) == texts
