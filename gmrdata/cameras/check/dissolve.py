"""A dissolve: the picture goes over from one place into another, and shows both for a while.

Its frames tie two places to one another that have nothing in common, and no step from one frame to
the next looks like a cut.  But hardly a track crosses it: what is seen before it is not seen after
it, though the picture has not moved that far.  Elsewhere many tracks go on over as many keyframes.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import DissolveConfig


def dissolve_after(
    matches: Matches, size_px: tuple[int, int], config: DissolveConfig
) -> int | None:
    """The keyframe of K in the middle of the first dissolve, by their matches; None where there is
    none."""
    lives, steps = _lives(matches), _steps(matches, size_px)
    at = _lasting(lives, 0, len(steps) + 1)
    for span in (one for one in config.spans if one <= len(steps)):
        fewer = np.minimum(at[:-span], at[span:])
        crossing = _lasting(lives, span, len(at))[:-span] / np.maximum(fewer, 1)
        usual = np.median(crossing)
        near = sliding_window_view(steps, span).sum(axis=1) <= config.most_moved
        telling = near & (usual * fewer >= config.fewest_usually)
        apart = np.flatnonzero(telling & (crossing < config.few_cross * usual))
        if len(apart):
            lowest = apart[crossing[apart] == crossing[apart].min()]
            return int(lowest[len(lowest) // 2]) + (span - 1) // 2
    return None


def _lives(matches: Matches) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the first keyframe of each track, and its last."""
    starts = matches.starts
    ends = [p.features + starts[[p.first, p.second]] for p in matches.pairs]
    one, other = np.concatenate([np.zeros((0, 2), dtype=np.int64), *ends]).T
    links = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(starts[-1],) * 2)
    n_tracks, track = connected_components(links, directed=False)
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    first, last = np.full(n_tracks, len(starts)), np.full(n_tracks, -1)
    np.minimum.at(first, track, row)
    np.maximum.at(last, track, row)
    several = first < last
    return first[several], last[several]


def _lasting(lives: tuple[np.ndarray, np.ndarray], span: int, n_keys: int) -> np.ndarray:
    """(K,) how many tracks go on from each keyframe to the one so many later."""
    first, last = lives
    long = last - first >= span
    begin = np.bincount(first[long], minlength=n_keys + 1)
    end = np.bincount(last[long] - span + 1, minlength=n_keys + 1)
    return np.cumsum(begin - end)[:n_keys]


def _steps(matches: Matches, size_px: tuple[int, int]) -> np.ndarray:
    """(K-1,) how far the picture moves from each keyframe to the next, in its shorter sides;
    infinite where the two have no matches."""
    steps = np.full(len(matches.keypoints_px) - 1, np.inf)
    for pair in matches.pairs:
        if pair.second == pair.first + 1:
            first_px, second_px = matches.ends_px(pair)
            steps[pair.first] = np.median(np.linalg.norm(second_px - first_px, axis=1))
    return steps / min(size_px)
