"""The frames between keyframes: matches by following the keyframes' features into them.

A feature is followed from frame to frame, and its place in each frame is then sought once more
against the keyframe itself, so that errors don't add up along the way.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from gmrdata.cameras.keyframes import follow, is_free, read_frame
from gmrdata.cameras.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig

FOLLOWED = "FOLLOWED"
"""Configuration of a pair whose matches were followed, not verified by COLMAP."""

_Frame = tuple[np.ndarray, np.ndarray]


def with_frames_between(
    key_matches: Matches,
    key_rows: np.ndarray,
    images: Sequence[Path],
    masks_dir: Path | None,
    size_px: tuple[int, int],
    config: SfmConfig,
) -> Matches:
    """Matches of all T frames, from those of the K keyframes.

    Args:
        key_matches: Verified matches of the keyframes.
        key_rows: (K,) their rows in order.
        images: T frames.
        masks_dir: Masks (255 = dynamic), or None.
        size_px: (width, height) of the frames.
        config: The recipe.

    Raises:
        BadFrames: a frame or a mask is missing or of another size.
    """
    keypoints_px = [np.zeros((0, 2))] * len(images)
    for row, points_px in zip(key_rows, key_matches.keypoints_px, strict=True):
        keypoints_px[row] = points_px
    pairs = [
        replace(pair, first=int(key_rows[pair.first]), second=int(key_rows[pair.second]))
        for pair in key_matches.pairs
    ]
    chosen = _most_matched(key_matches, config.followed_points)
    for key, (first, last) in enumerate(pairwise(key_rows)):
        if last - first < 2:
            continue
        frames = [read_frame(image, masks_dir, size_px) for image in images[first : last + 1]]
        from_first = _follow_into(frames, keypoints_px[first], chosen[key])
        from_last = _follow_into(frames[::-1], keypoints_px[last], chosen[key + 1])[::-1]
        for row, ahead, behind in zip(range(first + 1, last), from_first, from_last, strict=True):
            keypoints_px[row] = np.concatenate([ahead[1], behind[1]])
            n = len(ahead[0])
            mine = np.arange(len(keypoints_px[row]))
            pairs.append(PairMatches(first, row, np.c_[ahead[0], mine[:n]], FOLLOWED))
            pairs.append(PairMatches(row, last, np.c_[mine[n:], behind[0]], FOLLOWED))
    linked = [pair for pair in pairs if len(pair.features)]
    return Matches(keypoints_px, sorted(linked, key=lambda pair: (pair.first, pair.second)))


def _most_matched(matches: Matches, most: int) -> list[np.ndarray]:
    """For each keyframe, features that most other keyframes show as well."""
    counts = [np.zeros(len(points_px), dtype=np.int64) for points_px in matches.keypoints_px]
    for pair in matches.pairs:
        np.add.at(counts[pair.first], pair.features[:, 0], 1)
        np.add.at(counts[pair.second], pair.features[:, 1], 1)
    best = [np.argsort(-count, kind="stable")[:most] for count in counts]
    return [np.sort(at[count[at] > 0]) for at, count in zip(best, counts, strict=True)]


def _follow_into(
    frames: Sequence[_Frame], keypoints_px: np.ndarray, chosen: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Features (N,) of the first frame and their places (N, 2) in each of the inner frames."""
    start, _ = frames[0]
    features, home_px = chosen, keypoints_px[chosen]
    now_px = home_px
    result = []
    for (before, _), (image, free) in pairwise(frames[:-1]):
        now_px, found = follow(before, image, now_px)
        found &= is_free(now_px, free)
        features, home_px, now_px = features[found], home_px[found], now_px[found]
        exact_px, sure = follow(start, image, home_px, now_px)
        sure &= is_free(exact_px, free)
        result.append((features[sure], exact_px[sure]))
    return result
