"""Words of messages."""

import pytest

from gmrdata.values.errors import some


@pytest.mark.parametrize(
    ("items", "most", "words"),
    [
        ([], 3, ""),
        ([4, 5, 6], 3, "4, 5, 6"),
        ([4, 5, 6, 7, 8], 3, "4, 5, 6 and 2 more"),
        (("a", "b", "c"), 2, "a, b and 1 more"),
    ],
)
def test_the_first_of_many_are_named(items, most, words):
    assert some(items, most) == words
