"""Keyframes of a long video that show only what others show: they are placed against the map.

Where a place is seen again and again, each keyframe that sees it makes the adjustment denser, and
its time grows with the third power of their number.  So a keyframe is not mapped at all whose view
is that of much earlier ones: a camera that comes back is placed in the map that it has made, as
ORB-SLAM does (Mur-Artal et al. 2015, V-E).  Of what is mapped as many stay in the adjustment as
hold each point several times (its culling, VI-E).
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import binary_closing, binary_opening
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from gmrdata.cameras.colmap import add_bare_image, observations_of, pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.models import MIN_PNP_INLIERS
from gmrdata.cameras.match.matches import Matches, PairMatches, matched_points
from gmrdata.cameras.recipe import MappingConfig

FEW_BETWEEN = 5  # keyframes, each a small step from the next, show what those around them show


def without_seen_again(matches: Matches, config: MappingConfig) -> np.ndarray:
    """Rows (N,) of the keyframes that are to be mapped: not those of a long stretch whose matches
    nearly all go to features of much earlier ones that are mapped, or show what those show."""
    n_matched = matched_points(matches)
    if not config.in_parts(len(n_matched)):
        return np.arange(len(n_matched))
    far, mapped = _far_before(matches, config), np.ones(len(n_matched), dtype=bool)
    # Features that show what is mapped; of one that is placed in the map but some.
    known = [np.ones(len(points_px), dtype=bool) for points_px in matches.keypoints_px]
    for row, pairs in far.items():
        seen = np.zeros(len(known[row]), dtype=bool)
        for pair in pairs:
            seen[pair.features[known[pair.first][pair.features[:, 0]], 1]] = True
        mapped[row] = seen.sum() < config.cover_share * n_matched[row]
        known[row] = known[row] if mapped[row] else seen
    # The closing alone would open the ends.
    again = ~mapped | binary_closing(~mapped, np.ones(FEW_BETWEEN + 1))
    stretches = binary_opening(again, np.ones(config.part_overlap))
    return np.flatnonzero(_linked(~stretches, far, config))


def _linked(
    mapped: np.ndarray, far: dict[int, list[PairMatches]], config: MappingConfig
) -> np.ndarray:
    """The same rows (T,) bool, and those through which what comes after a stretch that is left out
    matches what is mapped."""
    linked = mapped.copy()
    starts = np.flatnonzero(mapped[1:] & ~mapped[:-1]) + 1
    after = {row for start in starts.tolist() for row in range(start, start + config.part_overlap)}
    for row in sorted(after.intersection(np.flatnonzero(mapped).tolist())):
        while (pairs := far.get(row)) and not any(linked[pair.first] for pair in pairs):
            row = max(pairs, key=lambda pair: len(pair.features)).first
            linked[row] = True
    return linked


def _far_before(matches: Matches, config: MappingConfig) -> dict[int, list[PairMatches]]:
    """By row, in order, its pairs with rows that are further before it than what it is matched with
    for being near."""
    before = defaultdict[int, list[PairMatches]](list)
    for pair in matches.pairs:
        if pair.second - pair.first > 2 ** (config.near_overlap - 1):
            before[pair.second].append(pair)
    return dict(sorted(before.items()))


@dataclass(frozen=True, eq=False)
class Core:
    """A model of the keyframes that are needed, and what the others saw of it."""

    model: Any
    covered: dict[int, np.ndarray]
    """By row of a keyframe that was left out: (N, 2) its features and the ids of their points."""


def core_of(model: Any, frames: Frames, matches: Matches, config: MappingConfig) -> Core:
    """A model without keyframes that others cover, or that match none of those that stay."""
    images = dict(frames.rows_of(model))
    seen = {row: _seen(image) for row, image in sorted(images.items())}
    points_of = {row: table[:, 1] for row, table in seen.items()}
    covered = covered_rows(points_of, config)
    covered |= alone(set(seen) - covered, matches)
    covered -= links_among(covered, points_of)
    keep = {images[row].image_id for row in seen if row not in covered}
    core, id_in_core = _reduced(model, keep)
    tables = {}
    for row in sorted(covered):
        features, points = seen[row].T
        ids = np.array([id_in_core.get(point, -1) for point in points.tolist()], np.int64)
        tables[row] = np.stack([features, ids], axis=1)[ids >= 0]
    return Core(core, tables)


def covered_rows(points_of: dict[int, np.ndarray], config: MappingConfig) -> set[int]:
    """Rows whose points (N,) enough of the rows that stay see as well; the ends stay.

    Every second row goes first, then every fourth and so on, so that what stays is evenly spread
    and has the partners of its matches, which are 1, 2, 4, ... further on.
    """
    most = max((int(points.max(initial=-1)) for points in points_of.values()), default=-1)
    count = np.zeros(most + 1, np.int64)
    for points in points_of.values():
        count[points] += 1
    covered, inner = set[int](), sorted(points_of)[1:-1]
    for row in sorted(inner, key=lambda row: (row & -row or len(points_of), row)):
        points = points_of[row]
        others = count[points] - 1
        if len(points) and (others >= config.cover_times).mean() >= config.cover_share:
            count[points] -= 1
            covered.add(row)
    return covered


def alone(rows: set[int], matches: Matches) -> set[int]:
    """Those of some rows that match none of the others: they see their points through rows that
    were left out."""
    pairs = [{pair.first, pair.second} for pair in matches.pairs]
    return rows.difference(*(pair for pair in pairs if pair <= rows))


def links_among(covered: set[int], points_of: dict[int, np.ndarray]) -> set[int]:
    """Those of covered rows that must stay: without them, some rows that hold each other, all
    through all, would do so no more.  Two do that see as many points as place a frame.

    A camera that dwells, turns away by its field of view and dwells again sees each point of the
    turn often enough from both sides; but without the turn nothing says how large one side is
    beside the other.
    """
    rows, links = np.array(sorted(points_of)), set[int]()
    common = _common_points(rows, points_of) >= MIN_PNP_INLIERS
    whole = connected_components(common, directed=False)[1]
    for together in (np.flatnonzero(whole == one) for one in np.unique(whole)):
        while True:
            stays = np.array(
                [row not in covered or row in links for row in rows[together].tolist()]
            )
            stay = together[stays]
            parts = connected_components(common[stay][:, stay], directed=False)[1]
            apart = stay[parts != parts[0]] if len(stay) else stay
            if not len(apart):
                break
            order, before = breadth_first_order(common, stay[0], directed=False)
            at = order[np.isin(order, apart)][0]  # the nearest of another part
            while at != stay[0]:
                links |= covered & {int(rows[at])}
                at = before[at]
    return links


def _common_points(rows: np.ndarray, points_of: dict[int, np.ndarray]) -> Any:
    """(N, N) sparse: how many points two rows (N,) both see."""
    points = np.concatenate([np.zeros(0, np.int64), *(points_of[row] for row in rows.tolist())])
    of = np.repeat(np.arange(len(rows)), [len(points_of[row]) for row in rows.tolist()])
    shape = (len(rows), int(points.max(initial=-1)) + 1)
    sees = coo_array((np.ones(len(of), np.int32), (of, points)), shape=shape).tocsr()
    return sees @ sees.T


def _seen(image: Any) -> np.ndarray:
    """(N, 2) features of an image that show points, and the ids of these; each point once."""
    table = observations_of(image)
    return table[np.unique(table[:, 1], return_index=True)[1]]


def _reduced(model: Any, keep: set[int]) -> tuple[Any, dict[int, int]]:
    """A copy of a model with some of its images, and the points that two of them see; the ids of
    these there, by those of the model."""
    core, id_in_core = pycolmap.Reconstruction(), dict[int, int]()
    for camera in model.cameras.values():
        core.add_camera_with_trivial_rig(camera)
    for image_id in sorted(keep):
        add_bare_image(core, model.image(image_id))
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        track = [(e.image_id, e.point2D_idx) for e in point.track.elements if e.image_id in keep]
        if len({image_id for image_id, _ in track}) >= 2:
            elements = [pycolmap.TrackElement(*at) for at in track]
            id_in_core[point_id] = core.add_point3D(point.xyz, pycolmap.Track(elements))
    return core, id_in_core
