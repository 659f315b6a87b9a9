"""Whether one scale holds throughout: how firmly the frames before each step hold those after it.

A mapper may join pieces of a sequence that share too little: each is right in itself, at well under
a pixel, but they differ in size.  At every step the cameras on one side may therefore move, turn
and grow as one piece against those on the other: seven unknowns, of which the points that both
sides see are the only evidence.  Where the image points of one side hold a point with the
information P, and those of the other with Q, it holds the two together with (P^-1 + Q^-1)^-1.
What is left open of the cameras' places is said as a share of their way.  As the sides may differ
in size, lengths of each are measured by its own distance to what it sees.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gmrdata.cameras.files import WeakestStep
from gmrdata.cameras.map.smoothing import linearized, noise_px
from gmrdata.cameras.map.solution import Solution
from gmrdata.cameras.match.matches import Matches
from gmrdata.values.transforms import invert

POSSIBLE = np.array([1, 1, 1, 10, 10, 10, np.log(10)])
"""Standard deviations where nothing is known: of the turn [rad], of the shift [median distances],
and of the scale's logarithm: ten times as large."""

LEAST_WAY = 0.2
"""Way over the distance of what is seen, below which a camera hardly travels and errors count as
if it were this."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """M image points of K cameras, and the N points behind them."""

    centres: np.ndarray  # (K, 3) places of the cameras, in order
    points: np.ndarray  # (N, 3)
    camera: np.ndarray  # (M,) which camera, ascending
    point: np.ndarray  # (M,) which point
    information: np.ndarray  # (M, 3, 3) what the image point says of the point's place

    @property
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

    Of K keyframes with six degrees of freedom, `key_rows` (K,) among all frames, and their matches;
    image points that the model explains no better than `most_px` don't count.
    """
    placed = np.array([row for row in sorted(mapped.seen) if mapped.seen[row]], dtype=np.int64)
    if len(placed) < 2:
        return None
    seen = _gather(mapped, matches, placed, intrinsics_px, most_px)
    shares = np.array(list(_loose_shares(seen)))
    worst = int(shares.argmax())
    after, before = key_rows[placed[worst : worst + 2]].tolist()
    moving = _moving_share(mapped.world_from_cam, matches, intrinsics_px, most_px)
    of_each = np.split(seen.distances, np.flatnonzero(np.diff(seen.camera)) + 1)
    ratios = np.abs(np.diff(np.log([np.median(distances) for distances in of_each])))
    return WeakestStep(after, before, float(shares[worst]), moving, float(np.exp(ratios.max())))


def _moving_share(
    cameras: np.ndarray, matches: Matches, intrinsics_px: np.ndarray, most_px: float
) -> float:
    """Share of the matches further than `most_px` from where cameras (K, 4, 4) say that they may
    be (Sampson 1982), in a pair of frames that nine tenths of the pairs fit better."""
    to_rays = np.linalg.inv(intrinsics_px).T
    rays = [np.c_[px, np.ones(len(px))] @ to_rays for px in matches.keypoints_px]
    shares = []
    for pair in matches.pairs:
        move = invert(cameras[pair.second]) @ cameras[pair.first]
        if np.isfinite(move).all():
            essential = np.cross(move[:3, 3], move[:3, :3], axisb=0, axisc=0)
            features, same = pair.features.T
            first, second = rays[pair.first][features], rays[pair.second][same]
            lines, back = first @ essential.T, second @ essential
            slope = np.linalg.norm(np.c_[lines[:, :2], back[:, :2]], axis=1)
            off_px = np.abs((second * lines).sum(axis=1)) * intrinsics_px[0, 0]
            shares.append(np.mean(off_px > most_px * slope))
    return float(np.percentile(shares, 90)) if shares else 0.0


def _gather(
    mapped: Solution,
    matches: Matches,
    placed: np.ndarray,
    intrinsics_px: np.ndarray,
    most_px: float,
) -> _Seen:
    """What the frames `placed` (K,) see, with the noise that it shows."""
    numbers: dict[bytes, int] = {}
    point, residuals_px, slopes = [], [], []
    for row in placed.tolist():
        cam, points = mapped.world_from_cam[row], np.array(list(mapped.seen[row].values()))
        seen_px = matches.keypoints_px[row][list(mapped.seen[row])]
        residual_px, slope = linearized(cam, seen_px, points, intrinsics_px)
        # A point is the same in two frames if it is in the same place.
        point.append([numbers.setdefault(place.tobytes(), len(numbers)) for place in points])
        residuals_px.append(residual_px)
        slopes.append(slope[:, :, 3:])
    residual_px, slope = np.concatenate(residuals_px), np.concatenate(slopes)
    fits = np.linalg.norm(residual_px, axis=1) < most_px
    information = np.swapaxes(slope, 1, 2) @ slope / noise_px(residual_px[fits]) ** 2
    return _Seen(
        centres=mapped.world_from_cam[placed, :3, 3],
        points=np.array([np.frombuffer(place) for place in numbers]),
        camera=np.repeat(np.arange(len(placed)), [len(own) for own in point]),
        point=np.concatenate(point).astype(np.int64),
        information=information * fits[:, None, None],
    )


def _loose_shares(seen: _Seen) -> Iterator[float]:
    """What each of the K - 1 steps leaves open of the cameras' places, over the way of them all."""
    left, total = np.zeros((2, len(seen.points), 3, 3))
    np.add.at(total, seen.point, seen.information)
    last = np.full(len(seen.points), -1)
    np.maximum.at(last, seen.point, seen.camera)
    distances, unit = seen.distances, float(np.median(seen.distances))
    for step in range(len(seen.centres) - 1):
        here = seen.camera == step
        np.add.at(left, seen.point[here], seen.information[here])
        both = np.trace(left, axis1=1, axis2=2).astype(bool) & (last > step)
        moves = _moves((seen.points[both] - seen.centres[step]) / unit)
        held = _held(left[both], total[both]) * unit**2
        covariance = _left_open(np.einsum("nki,nkl,nlj->ij", moves, held, moves))
        before = seen.camera <= step
        moves = _moves((seen.centres - seen.centres[step]) / unit)
        variances = np.einsum("nki,ij,nkj->n", moves, covariance, moves)
        open_, way = np.zeros(2), np.zeros(2)
        sides = (slice(0, step + 1), before), (slice(step + 1, None), ~before)
        for side, (cameras, of_side) in enumerate(sides):
            distance = np.median(distances[of_side]) / unit
            open_[side] = np.sqrt(variances[cameras].sum() / len(variances)) / distance
            way[side] = np.linalg.norm(np.ptp(seen.centres[cameras], axis=0)) / unit / distance
        yield float(open_.min() / max(way.sum(), LEAST_WAY))


def _held(left: np.ndarray, total: np.ndarray) -> np.ndarray:
    """(N, 3, 3) information by which points hold two sides together, by that of one and of both."""
    # Hardly anything, so that a point without a depth can be inverted.
    damping = 1e-9 * np.trace(total, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.asarray(left @ np.linalg.solve(total + damping, total - left))


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
