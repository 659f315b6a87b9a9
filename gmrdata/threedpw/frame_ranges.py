"""Counting frames in ranges."""

from collections.abc import Iterable

from gmrdata.manifest.current import FrameRange


def merged(ranges: Iterable[FrameRange]) -> list[tuple[int, int]]:
    """The same frames as (start, stop) that neither meet nor overlap, in ascending order."""
    result: list[tuple[int, int]] = []
    for start, stop in sorted((part.start, part.stop) for part in ranges):
        if result and start <= result[-1][1]:
            result[-1] = (result[-1][0], max(stop, result[-1][1]))
        else:
            result.append((start, stop))
    return result


def n_frames(ranges: Iterable[FrameRange]) -> int:
    """Number of frames in any of the ranges."""
    return sum(stop - start for start, stop in merged(ranges))


def n_shared(a: Iterable[FrameRange], b: Iterable[FrameRange]) -> int:
    """Number of frames that are in a range of both."""
    others = merged(b)
    return sum(
        max(0, min(stop, other_stop) - max(start, other_start))
        for start, stop in merged(a)
        for other_start, other_stop in others
    )
