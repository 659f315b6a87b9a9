"""Models of one sequence: joined where they share frames, and given the frames that they lack.

COLMAP's incremental mapper starts a new model where it can't go on, and lets it grow back into
frames that it has already.  What both models see there fixes the similarity between them.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import (
    LOSS_PX,
    add_bare_image,
    camera_of,
    matrix_of,
    project_into,
    pycolmap,
    seen_by,
)
from gmrdata.cameras.files import ModelRecord, WeakestStep
from gmrdata.cameras.map.smoothing import linearized, noise_px
from gmrdata.cameras.map.solution import Placed, SeenPoints, Solution
from gmrdata.cameras.match.features import pinhole_params
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import MappingConfig, SfmConfig
from gmrdata.values import transforms

MIN_PNP_INLIERS = 20  # points that a frame must agree with to be placed by them


def place_frames(
    rows: Iterable[int],
    placed: Placed,
    matches: Matches,
    intrinsics_px: np.ndarray,
    known: SeenPoints | None = None,
) -> int:
    """Place frames by the points that their matched neighbours see, and by those that they are
    known to see; how many it could."""
    width_px, height_px = (round(2 * middle_px) for middle_px in intrinsics_px[:2, 2])
    params = pinhole_params(intrinsics_px)
    camera = pycolmap.Camera(model="PINHOLE", width=width_px, height=height_px, params=params)
    count = 0
    for row, features, of in _points_of(set(rows), placed.seen, matches, known or {}):
        if len(features) < MIN_PNP_INLIERS:
            continue
        answer = pycolmap.estimate_and_refine_absolute_pose(
            matches.keypoints_px[row][features], placed.points[of], camera
        )
        if answer is None:
            continue
        seen = np.stack([features, of], axis=1)[answer["inlier_mask"]]
        # Followed from two keyframes, a point is there twice, and holds the frame once.
        seen = seen[np.sort(np.unique(seen[:, 1], return_index=True)[1])]
        if len(seen) >= MIN_PNP_INLIERS:
            placed.world_from_cam[row] = transforms.invert(matrix_of(answer["cam_from_world"]))
            placed.inliers[row] = len(seen)
            placed.seen[row] = seen
            count += 1
    return count


def _points_of(
    rows: set[int], seen: SeenPoints, matches: Matches, known: SeenPoints
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Rows in order, with their features and the points behind these: known, or through matches
    with frames that see them."""
    # A point by the feature that shows it; -1 where none does.
    point_of = {row: np.full(len(matches.keypoints_px[row]), -1, np.int32) for row in seen}
    for row, table in seen.items():
        point_of[row][table[:, 0]] = table[:, 1]
    through: dict[int, list[tuple[int, np.ndarray]]] = {row: [] for row in sorted(rows)}
    for pair in matches.pairs:
        for mine, other, column in ((pair.first, pair.second, 0), (pair.second, pair.first, 1)):
            if mine in rows and other in point_of:
                through[mine].append((other, pair.features[:, [column, 1 - column]]))
    for row, tables in through.items():
        behind: dict[int, int] = {}
        for other, table in tables:
            of = point_of[other][table[:, 1]]
            behind.update(zip(table[of >= 0, 0].tolist(), of[of >= 0].tolist(), strict=True))
        if row in known:
            behind.update(known[row].tolist())
        yield row, np.array(list(behind), np.int32), np.array(list(behind.values()), np.int32)


def parts_of(n_frames: int, config: MappingConfig) -> list[tuple[int, int]]:
    """First rows and ends of the parts in which so many keyframes are mapped; neighbours overlap by
    the recipe's number at least."""
    overlap = config.part_overlap
    n_parts = max(1, -(-(n_frames - overlap) // (config.part_frames - overlap)))
    size = min(n_frames, -(-(n_frames + (n_parts - 1) * overlap) // n_parts))
    starts = np.linspace(0, n_frames - size, n_parts).astype(np.int64).tolist()
    return [(start, start + size) for start in starts]


@dataclass(frozen=True, eq=False)
class Part:
    """Keyframes that are mapped at once."""

    name: str  # by how many are mapped in all, and where among these it begins
    own: np.ndarray  # (N,) rows, in order
    rows: np.ndarray  # (M,) rows: its own, and what links them with each other


def parts_among(rows: np.ndarray, matches: Matches, config: MappingConfig) -> list[Part]:
    """The parts in which some rows (N,) of keyframes are mapped."""
    bounds, count = parts_of(len(rows), config), matches.n_of_pair
    parts = []
    for start, stop in bounds:
        own = rows[start:stop]
        linked = with_anchors(own, count, config) if len(bounds) > 1 else own
        parts.append(Part(f"of_{len(rows)}_from_{start}", own, linked))
    return parts


def with_anchors(
    part: np.ndarray, n_of_pair: Mapping[tuple[int, int], int], config: MappingConfig
) -> np.ndarray:
    """Rows (N,) of a part, and those that its frames match where one does not match the one before
    it: frames between them that showed nothing new were left out.

    What comes then would share no frame with any other part.
    """
    steps = zip(part[:-1].tolist(), part[1:].tolist(), strict=True)
    breaks = [at for at, step in enumerate(steps, 1) if step not in n_of_pair]
    if not breaks:
        return part
    after = {row for at in breaks for row in part[at : at + config.part_overlap].tolist()}
    inside, votes = set(part.tolist()), Counter[int]()
    for (first, second), n_matches in n_of_pair.items():
        for row, other in ((first, second), (second, first)):
            if row in after and other not in inside:
                votes[other] += n_matches
    anchors = [row for row, _ in votes.most_common(config.part_overlap * len(breaks))]
    return np.union1d(part, np.array(anchors, np.int64))


def join_models(models: list[Any], config: SfmConfig) -> tuple[Any, tuple[ModelRecord, ...]]:
    """The largest model with all that share enough with it; what became of each, largest first."""
    ranked = sorted(models, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))
    whole, waiting = pycolmap.Reconstruction(ranked[0]), dict(enumerate(ranked[1:], start=1))
    records = {0: ModelRecord(whole.num_reg_images(), True, "the largest")}
    grown = True
    # A model may share frames only with one that is joined later.
    while waiting and grown:
        grown = False
        for i, model in list(waiting.items()):
            whole_from_model, said = _similarity(whole, model, config)
            records[i] = ModelRecord(model.num_reg_images(), whole_from_model is not None, said)
            if whole_from_model is not None:
                moved = pycolmap.Reconstruction(model)
                moved.transform(whole_from_model)
                _take_over(whole, moved)
                del waiting[i]
                grown = True
    return whole, tuple(records[i] for i in range(len(ranked)))


def _similarity(whole: Any, model: Any, config: SfmConfig) -> tuple[Any | None, str]:
    """whole_from_model, or None; and the reason in words."""
    joining = config.joining
    shared = _shared_images(whole, model)
    if not shared:
        return None, "shares no frame with the largest"
    frames = f"{len(shared)} frame{'s' if len(shared) > 1 else ''}"
    theirs, ours = _shared_points(whole, model, joining.min_common_observations)
    if len(ours) < (least := joining.min_shared_points):
        few = f"only {len(ours)} points with the largest (threshold {least})"
        return None, f"shares {frames} but {few}"
    options = pycolmap.RANSACOptions()
    options.random_seed = config.seed
    images = [whole.image(i) for i in shared]
    arms = [seen_by(whole, image)[2] - image.projection_center() for image in images]
    distance = float(np.median(np.linalg.norm(np.concatenate(arms), axis=1)))
    options.max_error = joining.point_error_share * distance
    # Points, not centres: those of a camera that goes straight leave a turn about its way open.
    fit: Any = pycolmap.estimate_sim3d_robust(theirs, ours, options)
    if fit is None or fit["num_inliers"] < joining.min_inlier_share * len(ours):
        return None, f"no similarity fits the {len(ours)} points that it shares with the largest"
    # Points that are far away bend the fit; cameras alone may not tell the scale.
    fits = [fit["tgt_from_src"], *_by_cameras(whole, model, shared)]
    errors_px = [_shared_error_px(whole, model, one, shared) for one in fits]
    best = int(np.argmin(errors_px))
    whole_from_model, error_px = fits[best], errors_px[best]
    in_parts = len(shared) >= config.mapping.part_overlap
    most_px = joining.max_part_error_px if in_parts else joining.max_shared_error_px
    if not error_px <= most_px:
        return None, (
            f"its cameras of the {frames} shared with the largest are {error_px:.1f} px off "
            f"(threshold {most_px:g} px)"
        )
    return whole_from_model, f"joined by {frames} and {len(ours)} points, {error_px:.2f} px off"


def _shared_images(whole: Any, model: Any) -> list[int]:
    return sorted(set(whole.reg_image_ids()) & set(model.reg_image_ids()))


def _by_cameras(whole: Any, model: Any, shared: list[int]) -> list[Any]:
    """The similarity that the shared cameras' turns and places ask for; none where these are one
    place."""
    ours, theirs = (np.array([camera_of(of.image(i)) for i in shared]) for of in (whole, model))
    rotation, scale, _, _ = aligned(ours, theirs)
    if not scale:
        return []
    middle, other = (of[:, :3, 3].mean(axis=0) for of in (ours, theirs))
    turn = pycolmap.Rotation3d(rotation.as_matrix())
    return [pycolmap.Sim3d(scale, turn, middle - scale * rotation.apply(other))]


def aligned(ours: np.ndarray, theirs: np.ndarray) -> tuple[Rotation, float, np.ndarray, np.ndarray]:
    """The best similarity between two worlds of the same cameras (T, 4, 4): the turn, by their
    orientations, since places along a line leave a turn open; the scale, 0 where no place tells it
    or the paths run against each other, as with a mirror; and both paths (T, 3) from their middles,
    turned alike."""
    turn = Rotation.from_matrix(ours[:, :3, :3] @ np.swapaxes(theirs[:, :3, :3], 1, 2)).mean()
    way = ours[:, :3, 3] - ours[:, :3, 3].mean(axis=0)
    other = turn.apply(theirs[:, :3, 3] - theirs[:, :3, 3].mean(axis=0))
    power = float((other**2).sum())
    scale = max(0.0, float((way * other).sum()) / power) if power > 0 else 0.0
    return turn, scale, way, other


def _owners(model: Any, images: Iterable[int]) -> dict[tuple[int, int], int]:
    """The point behind each image point of some images, by image and number."""
    return {
        (image_id, number): spot.point3D_id
        for image_id in images
        for number, spot in enumerate(model.image(image_id).points2D)
        if spot.has_point3D()
    }


def _image_points(point: Any) -> list[tuple[int, int]]:
    return [(element.image_id, element.point2D_idx) for element in point.track.elements]


def _shared_points(whole: Any, model: Any, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a model and those of the whole that the same image points, at `least` so
    many, belong to."""
    owners, theirs, ours = _owners(whole, _shared_images(whole, model)), [], []
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        votes = Counter(owners[at] for at in _image_points(point) if at in owners)
        owner, common = votes.most_common(1)[0] if votes else (0, 0)
        if common >= least:
            theirs.append(point.xyz)
            ours.append(whole.point3D(owner).xyz)
    return np.array(theirs).reshape(-1, 3), np.array(ours).reshape(-1, 3)


def _shared_error_px(whole: Any, model: Any, whole_from_model: Any, shared: list[int]) -> float:
    """Median distance at which the whole's points appear in the model's cameras and in its own."""
    back = whole_from_model.inverse()
    errors = []
    for image_id in shared:
        _, _, points = seen_by(whole, whole.image(image_id))
        moved = points @ (back.scale * back.rotation.matrix()).T + back.translation
        own_px = project_into(whole.image(image_id), points)
        errors.append(np.linalg.norm(project_into(model.image(image_id), moved) - own_px, axis=1))
    return float(np.median(np.concatenate(errors)))


def _take_over(whole: Any, model: Any) -> None:
    """Add frames and points of a model that is in the same world."""
    shared = _shared_images(whole, model)
    for image_id in sorted(set(model.reg_image_ids()).difference(shared)):
        add_bare_image(whole, model.image(image_id))
    owners = _owners(whole, shared)
    # Of a point's frames these and the new ones alone: it may have thousands.
    there: defaultdict[int, set[int]] = defaultdict(set)
    for (image_id, _), owner in owners.items():
        there[owner].add(image_id)
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        seen = _image_points(point)
        known = sorted({owners[at] for at in seen if at in owners})
        free = [pycolmap.TrackElement(*at) for at in seen if at not in owners]
        if known:
            for element in free:
                if element.image_id not in there[known[0]]:
                    there[known[0]].add(element.image_id)
                    whole.add_observation(known[0], element)
        elif len(free) >= 2:
            whole.add_point3D(point.xyz, pycolmap.Track(free))


POSSIBLE = np.array([1, 1, 1, 10, 10, 10, np.log(10)])
"""Standard deviations where nothing is known: of the turn [rad], of the shift [median distances],
and of the scale's logarithm: ten times as large."""

LEAST_WAY = 0.2
"""Way over the distance of what is seen, below which a camera hardly travels and errors count as
if it were this."""


@dataclass(frozen=True, eq=False)
class _SeenPoints:
    """M image points of K cameras, and the N points behind them."""

    centres: np.ndarray  # (K, 3) places of the cameras, in order
    points: np.ndarray  # (N, 3)
    camera: np.ndarray  # (M,) which camera, ascending
    point: np.ndarray  # (M,) which point
    information: np.ndarray  # (M, 3, 3) what the image point says of the point's place

    @cached_property
    def total(self) -> np.ndarray:
        """(N, 3, 3) what all image points of a point say of its place."""
        total = np.zeros((len(self.points), 3, 3))
        np.add.at(total, self.point, self.information)
        return total

    @cached_property
    def distances(self) -> np.ndarray:
        """(M,) from the camera to the point."""
        return np.asarray(
            np.linalg.norm(self.points[self.point] - self.centres[self.camera], axis=1)
        )


def weakest_step(
    mapped: Solution,
    matches: Matches,
    key_rows: np.ndarray,
    intrinsics_px: np.ndarray,
    most_px: float,
) -> WeakestStep | None:
    """The step over which the cameras hold together least; None where no two of them see a point.

    A mapper may join pieces that share too little: each is right in itself, but they differ in
    size.  So at every step the cameras on one side may move, turn and grow as one piece against
    those on the other: seven unknowns, of which the points that both sides see are the only
    evidence.  Where one side's image points hold a point with the information P, and the other's
    with Q, it holds the two together with (P^-1 + Q^-1)^-1.  Lengths of each side are measured by
    its own distance to what it sees.

    Of K keyframes with six degrees of freedom, `key_rows` (K,) among all frames, and their matches;
    image points that the model explains no better than `most_px` don't count.
    """
    placed = np.array([row for row in sorted(mapped.seen) if len(mapped.seen[row])], np.int64)
    if len(placed) < 2:
        return None
    seen = _gather(mapped, matches, placed, intrinsics_px, most_px)
    shares = np.array(list(_loose_shares(seen)))
    worst = int(shares.argmax())
    after, before = key_rows[placed[worst : worst + 2]].tolist()
    moving = _moving_share(mapped.world_from_cam, matches, intrinsics_px, most_px)
    ratios = np.abs(np.diff(np.log(_distances_of_each(seen)), axis=0)).min(axis=1)
    return WeakestStep(after, before, float(shares[worst]), moving, float(np.exp(ratios.max())))


def _distances_of_each(seen: _SeenPoints) -> np.ndarray:
    """(K, 3) how far away is what each camera sees: the near tenth, the median, and the geometric
    mean by how well each is known.  The view through a window is far away, and may fill nearly the
    whole picture, but the little beside it is known much better."""
    rays = (seen.points[seen.point] - seen.centres[seen.camera]) / seen.distances[:, None]
    variance = (
        (np.linalg.inv(_damped(seen.total))[seen.point] @ rays[..., None])[..., 0] * rays
    ).sum(1)
    known = seen.distances**2 / variance  # of the distance's logarithm
    ends = np.flatnonzero(np.diff(seen.camera)) + 1
    of_each = zip(np.split(seen.distances, ends), np.split(known, ends), strict=True)
    return np.array([
        [*np.percentile(away, [10, 50]), np.exp(np.average(np.log(away), weights=weights))]
        for away, weights in of_each
    ])  # fmt: skip


def _moving_share(
    cameras: np.ndarray, matches: Matches, intrinsics_px: np.ndarray, most_px: float
) -> float:
    """Share of the matches further than `most_px` from where cameras (K, 4, 4) say that they may
    be (Sampson 1982), in a pair of frames that nine tenths of the pairs fit better."""
    to_rays = np.linalg.inv(intrinsics_px).T
    rays = [np.c_[px, np.ones(len(px))] @ to_rays for px in matches.keypoints_px]
    shares = []
    for pair in matches.pairs:
        move = transforms.invert(cameras[pair.second]) @ cameras[pair.first]
        if np.isfinite(move).all():
            essential = np.cross(move[:3, 3], move[:3, :3], axisb=0, axisc=0)
            features, same = pair.features.T
            first, second = rays[pair.first][features], rays[pair.second][same]
            lines, back = first @ essential.T, second @ essential
            slope = np.linalg.norm(np.c_[lines[:, :2], back[:, :2]], axis=1)
            off_px = np.abs((second * lines).sum(axis=1)) * intrinsics_px[0, 0]
            shares.append(np.mean(off_px > most_px * slope))
    return float(np.percentile(shares, 90)) if shares else 0.0


FEWEST_TELLING = 6  # keyframes that must tell their focal length
KNOWN_LOG_FOCAL = 0.0015  # standard error of its logarithm in one that tells, as before no wall


def zoom_spread(mapped: Solution, matches: Matches, intrinsics_px: np.ndarray) -> float:
    """How far apart the focal lengths are that single keyframes of a model ask for: the difference
    of their logarithms' 10th and 90th percentile; 0 where few tell.  Of a zoom a tenth is left at
    most, as cameras stand too near or too far instead."""
    logs = []
    for row in np.flatnonzero(mapped.adjusted).tolist():
        features, of = mapped.seen[row].T
        seen_px, points = matches.keypoints_px[row][features], mapped.points[of]
        off_px, slopes = linearized(mapped.world_from_cam[row], seen_px, points, intrinsics_px)
        zoomed_px = off_px + seen_px - intrinsics_px[:2, 2]
        slopes = np.concatenate([slopes, zoomed_px[..., None]], axis=2)
        weights = 1.0 / (1.0 + (off_px**2).sum(axis=1) / LOSS_PX**2)
        told = np.einsum("nki,n,nkj->ij", slopes, weights, slopes)
        covariance = np.linalg.inv(told + 1e-12 * np.trace(told) * np.eye(7))
        step = -covariance @ np.einsum("nki,n,nk->i", slopes, weights, off_px)
        if noise_px(off_px + slopes @ step) * np.sqrt(covariance[6, 6]) < KNOWN_LOG_FOCAL:
            logs.append(step[6])
    return float(np.ptp(np.percentile(logs, [10, 90]))) if len(logs) >= FEWEST_TELLING else 0.0


def _gather(
    mapped: Solution,
    matches: Matches,
    placed: np.ndarray,
    intrinsics_px: np.ndarray,
    most_px: float,
) -> _SeenPoints:
    """What the frames `placed` (K,) see, with the noise that it shows."""
    point, residuals_px, told = [], [], []
    for row in placed.tolist():
        features, of = mapped.seen[row].T
        seen_px, points = matches.keypoints_px[row][features], mapped.points[of]
        residual_px, slope = linearized(mapped.world_from_cam[row], seen_px, points, intrinsics_px)
        point.append(of)
        residuals_px.append(residual_px)
        told.append(np.swapaxes(slope[:, :, 3:], 1, 2) @ slope[:, :, 3:])
    residual_px = np.concatenate(residuals_px)
    fits = np.linalg.norm(residual_px, axis=1) < most_px
    information = np.concatenate(told) / noise_px(residual_px[fits]) ** 2
    return _SeenPoints(
        centres=mapped.world_from_cam[placed, :3, 3],
        points=mapped.points,
        camera=np.repeat(np.arange(len(placed)), [len(own) for own in point]),
        point=np.concatenate(point).astype(np.int64),
        information=information * fits[:, None, None],
    )


def _loose_shares(seen: _SeenPoints) -> Iterator[float]:
    """What each of the K - 1 steps leaves open of the cameras' places, over the way of them all."""
    left, total = np.zeros((len(seen.points), 3, 3)), seen.total
    last = np.full(len(seen.points), -1)
    np.maximum.at(last, seen.point, seen.camera)
    unit = float(np.median(seen.distances))
    starts = np.searchsorted(seen.camera, np.arange(len(seen.centres) + 1))
    before = _running_medians(seen.distances, starts) / unit
    after = _running_medians(seen.distances[::-1], (starts[-1] - starts)[::-1])[::-1] / unit
    both = np.zeros(0, np.int64)
    for step in range(len(seen.centres) - 1):
        here = slice(*starts[step : step + 2])
        np.add.at(left, seen.point[here], seen.information[here])
        # Only points of both sides are looked at, so that a step costs the same on any long way.
        both = np.union1d(both, seen.point[here])
        both = both[np.trace(left[both], axis1=1, axis2=2).astype(bool) & (last[both] > step)]
        moves = _moves((seen.points[both] - seen.centres[step]) / unit)
        held = _held(left[both], total[both]) * unit**2
        covariance = _left_open(np.tensordot(moves, held @ moves, axes=([0, 1], [0, 1])))
        moves = _moves((seen.centres - seen.centres[step]) / unit)
        variances = ((moves @ covariance) * moves).sum(axis=(1, 2))
        open_, way = np.zeros(2), np.zeros(2)
        sides = (slice(0, step + 1), before[step]), (slice(step + 1, None), after[step + 1])
        for side, (cameras, distance) in enumerate(sides):
            open_[side] = np.sqrt(variances[cameras].sum() / len(variances)) / distance
            way[side] = np.linalg.norm(np.ptp(seen.centres[cameras], axis=0)) / unit / distance
        yield float(open_.min() / max(way.sum(), LEAST_WAY))


def _running_medians(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """(K,) the median of values (M,) up to the end of each of K groups, which begin at `starts`
    (K + 1,).

    By how many of them are in each of about sqrt(M) runs of ranks, so that it takes O(K sqrt(M)).
    """
    order, size = np.argsort(values, kind="stable"), max(1, int(np.sqrt(len(values))))
    rank, there = np.argsort(order, kind="stable"), np.zeros(len(values), dtype=bool)
    counts, medians = np.zeros(len(values) // size + 1, np.int64), np.zeros(len(starts) - 1)
    for group, stop in enumerate(starts[1:].tolist()):
        mine = rank[starts[group] : stop]
        there[mine] = True
        np.add.at(counts, mine // size, 1)
        upto, middle = np.cumsum(counts), []
        for n in ((stop - 1) // 2, stop // 2):
            run = int(np.searchsorted(upto, n, side="right"))
            inside = np.flatnonzero(there[run * size : (run + 1) * size])
            middle.append(order[run * size + inside[n - upto[run] + counts[run]]])
        medians[group] = values[middle].mean()
    return medians


def _held(left: np.ndarray, total: np.ndarray) -> np.ndarray:
    """(N, 3, 3) information by which points hold two sides together, by that of one and of both."""
    return np.asarray(left @ np.linalg.solve(_damped(total), total - left))


def _damped(information: np.ndarray) -> np.ndarray:
    """(N, 3, 3) with hardly anything more, so that that of a point without a depth has an inverse;
    and for one that no image explains."""
    more = np.maximum(1e-9 * np.trace(information, axis1=1, axis2=2), 1e-12)
    return np.asarray(information + more[:, None, None] * np.eye(3))


def _left_open(known: np.ndarray) -> np.ndarray:
    """(7, 7) covariance of a move of which so much is known, beside what is possible at all."""
    values, vectors = np.linalg.eigh((known + known.T) / 2 * np.outer(POSSIBLE, POSSIBLE))
    # Nothing is known less than not at all, but by rounding.
    spread = POSSIBLE[:, None] * vectors / np.sqrt(1.0 + np.maximum(values, 0.0))
    return np.asarray(spread @ spread.T)


def _moves(arms: np.ndarray) -> np.ndarray:
    """(N, 3, 7) how places (N, 3) follow a small turn, a shift and a growth about the origin."""
    turns = np.swapaxes(np.cross(np.eye(3), arms[:, None]), 1, 2)
    shifts = np.broadcast_to(np.eye(3), turns.shape)
    return np.concatenate([turns, shifts, arms[:, :, None]], axis=2)
