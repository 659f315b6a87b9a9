"""A dissolve: the picture goes over from one place into another, and shows both for a while.

Its frames tie two places to one another that have nothing in common, and no step from one frame to
the next looks like a cut.  But of the points that are seen before it, and that must lie in the
picture after it by the cameras, hardly one is seen again, nor the other way round.  Elsewhere most
of them are, over as many keyframes.  Where the cameras of the two places look past one another,
this shows nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gmrdata.cameras.match.keyframes import unit_rays
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.match.tracks import Tracks
from gmrdata.cameras.recipe import DissolveConfig
from gmrdata.values.camera import project


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """N points of a solution, and which of K keyframes see them first and last."""

    points: np.ndarray  # (N, 3); of cameras that only turn, directions from the origin
    first: np.ndarray  # (N,)
    last: np.ndarray  # (N,)


def points_of_tracks(tracks: Tracks, points: np.ndarray, key_rows: np.ndarray) -> SeenPoints:
    """Those of a model (N, 3) that its keyframes see, by their rows (K,) among all frames."""
    keys = np.searchsorted(key_rows, tracks.rows).clip(max=len(key_rows) - 1)
    on_key = key_rows[keys] == tracks.rows
    return _seen(points, tracks.points[on_key], keys[on_key])


def points_of_matches(
    matches: Matches, world_from_cam: np.ndarray, intrinsics_px: np.ndarray
) -> SeenPoints:
    """Directions of what the matches of K keyframes show, whose cameras (K, 4, 4) only turn."""
    starts, n_keys = matches.starts, len(matches.keypoints_px)
    ends = [p.features + starts[[p.first, p.second]] for p in matches.pairs]
    first, second = np.concatenate([np.zeros((0, 2), dtype=np.int64), *ends]).T
    links = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(starts[-1],) * 2)
    point = connected_components(links, directed=False)[1]
    row = np.repeat(np.arange(n_keys), np.diff(starts))
    rays = unit_rays(np.concatenate(matches.keypoints_px), intrinsics_px)
    directions = (world_from_cam[row, :3, :3] @ rays[..., None])[..., 0]
    known = np.isfinite(directions[:, 0])
    points = np.zeros((len(point), 3))
    points[point[known]] = directions[known]
    return _seen(points, point[known], row[known])


def _seen(points: np.ndarray, point: np.ndarray, key: np.ndarray) -> SeenPoints:
    first, last = np.full(len(points), np.iinfo(np.int64).max), np.full(len(points), -1)
    np.minimum.at(first, point, key)
    np.maximum.at(last, point, key)
    several = first < last
    return SeenPoints(points[several], first[several], last[several])


def dissolve_after(
    seen: SeenPoints,
    world_from_cam: np.ndarray,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    config: DissolveConfig,
) -> int | None:
    """The keyframe of K, with cameras (K, 4, 4), in the middle of the first dissolve; None where
    there is none."""
    for apart in config.keyframes_apart:
        pairs = [(key, key + 2 * apart - 1) for key in range(len(world_from_cam) - 2 * apart + 1)]
        again = np.array([
            _seen_again(seen, world_from_cam, intrinsics_px, size_px, pair, config)
            for pair in pairs
        ])  # fmt: skip
        known = again[np.isfinite(again)]
        if not len(known) or np.median(known) < config.usually_again:
            continue
        if known.min() < config.none_again:
            lowest = np.flatnonzero(again == known.min())
            return int(lowest[len(lowest) // 2]) + apart - 1
    return None


def _seen_again(
    seen: SeenPoints,
    world_from_cam: np.ndarray,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    keys: tuple[int, int],
    config: DissolveConfig,
) -> float:
    """The share of points that one of two keyframes sees and that lie in the other's picture, that
    a keyframe from there on sees: the larger share of both ways; NaN where too few lie in it."""
    shares = []
    for here, there in (keys, keys[::-1]):
        now = (seen.first <= here) & (seen.last >= here)
        image_px = project(world_from_cam[there], seen.points[now], intrinsics_px)
        inside = _is_inside(image_px, size_px, config.margin)
        if inside.sum() < config.fewest_points or inside.mean() < config.least_in_picture:
            return float("nan")
        ahead = seen.last[now] >= there if here < there else seen.first[now] <= there
        shares.append(float(ahead[inside].mean()))
    return max(shares)


def _is_inside(image_px: np.ndarray, size_px: tuple[int, int], margin: float) -> np.ndarray:
    """(N,) whether points (N, 2) lie well inside a picture; NaN, as of a camera that is not known
    or behind it, does not."""
    edge_px = margin * min(size_px)
    inside = (image_px > edge_px) & (image_px < np.subtract(size_px, edge_px))
    return np.asarray(inside.all(axis=1))
