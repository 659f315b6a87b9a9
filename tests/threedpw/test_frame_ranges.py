"""Arithmetic of frame ranges, with sets of frames as the oracle."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from gmrdata.manifest.current import FrameRange
from gmrdata.paper.table7 import merged, n_frames, n_shared

ranges = st.lists(
    st.builds(
        lambda start, length: FrameRange(start=start, stop=start + length),
        st.integers(0, 40),
        st.integers(1, 15),
    ),
    max_size=6,
)


def frames(parts: list[FrameRange]) -> set[int]:
    return {row for part in parts for row in range(part.start, part.stop)}


@given(a=ranges, b=ranges)
def test_counts_are_those_of_sets_of_frames(a: list[FrameRange], b: list[FrameRange]) -> None:
    assert n_frames(a) == len(frames(a))
    assert n_shared(a, b) == n_shared(b, a) == len(frames(a) & frames(b))


@given(a=ranges)
def test_merged_ranges_hold_the_same_frames_and_do_not_meet(a: list[FrameRange]) -> None:
    parts = merged(a)
    assert {row for start, stop in parts for row in range(start, stop)} == frames(a)
    assert all(stop < later for (_, stop), (later, _) in pairwise(parts))
