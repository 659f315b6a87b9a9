"""All frames refined together, with a prior on the camera's acceleration.

Each camera is held by what its image says (`camera_information`), and the second differences of
place and orientation are taken to be normally distributed about zero.  Their standard deviation is
that of the recipe or the acceleration that the path itself keeps to, whichever is larger.  So the
prior doesn't bend a path that shakes: a shake that is A wide, where the noise of a camera is s,
makes up the standard deviation itself and loses a share of (s/A)^2, at whatever frequency.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, kron
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import LEAST_NOISE_PX
from gmrdata.cameras.files import NOT_SMOOTHED, Smoothing, SmoothPlace, SmoothTurn
from gmrdata.cameras.frames import Timeline
from gmrdata.cameras.recipe import SfmConfig

NEAREST_DEPTH = 1e-6
ITERATIONS = 3  # corrections are small, so the first step is nearly all of it
OFTEN = 0.95
"""The path's own acceleration is the size that it keeps to so often: a single jump lies outside and
is no way that the camera went, a burst of shake in a twentieth of the frames counts."""
STRIDE = 3
"""Frames over which the path's own acceleration is looked at: noise is a ninth of what it is from
frame to frame, while a shake of 3 Hz at 30 frames/s loses a quarter."""
NOISE_SAMPLES = 50  # second differences whose noise is worked out; its median counts


def camera_information(
    world_from_cam: np.ndarray,
    sights: Iterable[tuple[int, np.ndarray, np.ndarray]],
    intrinsics_px: np.ndarray,
    loss_px: float,
) -> tuple[csr_array, np.ndarray]:
    """(6T, 6T) block-diagonal J^T W J and (6T,) slope J^T W r of cameras, zero where there is none.

    The unknowns of a camera are a small turn w [rad] and a step d, both in the world's axes:
    R <- exp(w) R, c <- c + d.  Observations are weighted as by the Cauchy loss of the bundle
    adjustment, of that scale, and by the noise that the residuals show.  Sights are rows of frames
    with a camera, with their image points (N, 2) and the points (N, 3) seen there, which are held
    fixed, so the errors that frames share through them are not in here.
    """
    n = len(world_from_cam)
    blocks, slopes = np.zeros((n, 6, 6)), np.zeros((n, 6))
    residuals_px = [np.zeros((0, 2))]
    for row, seen_px, points in sights:
        residual_px, jacobian = linearized(world_from_cam[row], seen_px, points, intrinsics_px)
        weight = 1.0 / (1.0 + (residual_px**2).sum(axis=1) / loss_px**2)
        blocks[row] = np.einsum("nki,n,nkj->ij", jacobian, weight, jacobian)
        slopes[row] = np.einsum("nki,n,nk->i", jacobian, weight, residual_px)
        residuals_px.append(residual_px)
    variance_px2 = noise_px(np.concatenate(residuals_px)) ** 2
    return block_diagonal(blocks) / variance_px2, slopes.ravel() / variance_px2


def block_diagonal(blocks: np.ndarray) -> csr_array:
    """Sparse (NK, NK) of blocks (N, K, K)."""
    places = np.arange(len(blocks) + 1, dtype=np.int32)
    return bsr_array((blocks, places[:-1], places)).tocsr()


def noise_px(residuals_px: np.ndarray) -> float:
    """Standard deviation per axis of residuals (N, 2), from their median size [px]."""
    if not len(residuals_px):
        return LEAST_NOISE_PX
    # Median of a Rayleigh distribution: 1.1774 standard deviations.
    median_px = float(np.median(np.linalg.norm(residuals_px, axis=1)))
    return max(LEAST_NOISE_PX, median_px / 1.1774)


def linearized(
    world_from_cam: np.ndarray, image_px: np.ndarray, points: np.ndarray, intrinsics_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (N, 2) [px] and their derivatives (N, 2, 6) by turn and step."""
    rotmat, arms = world_from_cam[:3, :3], points - world_from_cam[:3, 3]
    points_cam = np.einsum("ji,nj->ni", rotmat, arms)
    depth = np.maximum(points_cam[:, 2], NEAREST_DEPTH)
    focal_px = intrinsics_px[[0, 1], [0, 1]]
    rays = points_cam[:, :2] / depth[:, None]
    by_cam = np.zeros((len(points), 2, 3))
    by_cam[:, [0, 1], [0, 1]] = focal_px / depth[:, None]
    by_cam[:, :, 2] = -focal_px * rays / depth[:, None]
    by_world = np.einsum("nki,ji->nkj", by_cam, rotmat)
    # A turn of the camera by w moves a point by v x w in the camera's sight, a step d by -d.
    jacobian = np.concatenate([np.cross(by_world, arms[:, None]), -by_world], axis=2)
    return focal_px * rays + intrinsics_px[:2, 2] - image_px, jacobian


@dataclass(frozen=True, eq=False)
class Differences:
    """Second differences over the frames of a path, where three are close enough."""

    rows: np.ndarray  # (M, 3) rows of frames with a camera, one after the other
    spans: np.ndarray  # (M, 2) steps from the first to the second and on to the third [frames]

    @property
    def units(self) -> np.ndarray:
        """(M, 1) standard deviations, for a random acceleration of 1 per frame^2."""
        return np.asarray(np.sqrt(self.spans.mean(axis=1, keepdims=True)))

    def matrix(self, n_frames: int) -> csr_array:
        """(M, T): the change of velocity at the middle frame, in units of its own."""
        behind, ahead = 1.0 / self.spans.T
        weights = np.stack([behind, -behind - ahead, ahead], axis=1) / self.units
        at = np.repeat(np.arange(len(self.rows)), 3)
        entries = (weights.ravel(), (at, self.rows.ravel()))
        return csr_array(coo_array(entries, shape=(len(self.rows), n_frames)))

    def of(self, world_from_cam: np.ndarray) -> np.ndarray:
        """(M, 6) those of orientation [rad] and of place, in the world's axes."""
        rotations = Rotation.from_matrix(world_from_cam[self.rows, :3, :3].reshape(-1, 3, 3))
        first, middle, last = (rotations[i::3] for i in range(3))
        turns = (middle * first.inv()).as_rotvec(), (last * middle.inv()).as_rotvec()
        steps = np.diff(world_from_cam[self.rows, :3, 3], axis=1)
        before, after = (
            np.concatenate([turns[i], steps[:, i]], axis=1) / self.spans[:, i : i + 1]
            for i in range(2)
        )
        return np.asarray((after - before) / self.units)


def second_differences(
    has_camera: np.ndarray, timeline: Timeline, max_gap_frames: int, stride: int = 1
) -> Differences:
    """The threes of frames, `stride` placed ones apart, without a long gap or a cut between."""
    placed = np.flatnonzero(has_camera)
    near, reach = timeline.near(placed, max_gap_frames), 2 * stride
    starts = [i for i in range(len(placed) - reach) if near[i : i + reach].all()]
    threes = [placed[i : i + reach + 1 : stride] for i in starts]
    rows = np.array(threes, dtype=np.int64).reshape(-1, 3)
    return Differences(rows, np.diff(timeline.image_numbers[rows], axis=1).astype(np.float64))


def smooth_cameras(
    world_from_cam: np.ndarray,
    information: csr_array,
    slope: np.ndarray,
    timeline: Timeline,
    place_unit: float,
    config: SfmConfig,
) -> tuple[np.ndarray, Smoothing]:
    """The most probable path, given what holds each camera and the prior on its acceleration.

    Minimizes x^T H x / 2 + g^T x + sum |e(x)|^2 / (2 sigma^2) over the corrections x of all frames,
    with e their second differences of turn and of place: one sparse system of normal equations.
    The information (kT, kT) is H: k = 6 by turn and step in the world's axes as
    `camera_information` has them, or k = 3 by turn alone; the slope (kT,) is g; the place's unit is
    the background's median distance.
    """
    n, k = len(world_from_cam), information.shape[0] // len(world_from_cam)
    has_camera = np.isfinite(world_from_cam[:, 0, 0])
    differences = second_differences(has_camera, timeline, config.max_gap_frames)
    wide = second_differences(has_camera, timeline, config.max_gap_frames, STRIDE)
    if not len(wide.rows):
        return world_from_cam, NOT_SMOOTHED
    unknown = (k * np.flatnonzero(has_camera)[:, None] + np.arange(k)).ravel()
    differ = csr_array(kron(differences.matrix(n), np.eye(k), format="csr")[:, unknown])
    held = csc_array(information[unknown][:, unknown])
    units = np.array([np.pi / 180, place_unit])[: k // 3]
    floors = units * np.array([config.acceleration_deg, config.acceleration_share])[: k // 3]
    sigmas = np.maximum(floors, _own_acceleration(world_from_cam, wide)[: k // 3])
    stiffness = np.tile(np.repeat(sigmas**-2, 3), len(differences.rows))
    pulled = csr_array(differ.T * stiffness)
    system = csc_array(held + pulled @ differ)
    factors, correction, result = splu(system), np.zeros(len(unknown)), world_from_cam
    for _ in range(ITERATIONS):
        pull = pulled @ differences.of(result)[:, :k].ravel()
        correction -= factors.solve(held @ correction + slope[unknown] + pull)
        result = _corrected(world_from_cam, correction.reshape(-1, k))
    largest = np.linalg.norm(correction.reshape(len(result[has_camera]), -1, 3), axis=2).max(axis=0)
    return result, _figures(sigmas / units, _noise(held, differ, k) / units, largest / units)


def _own_acceleration(world_from_cam: np.ndarray, wide: Differences) -> np.ndarray:
    """(2,) size per axis that the path keeps to [rad/frame^2, unit/frame^2]."""
    sizes = (np.abs(wide.of(world_from_cam)) / wide.units).reshape(-1, 2, 3)
    return np.asarray(np.quantile(sizes, OFTEN, axis=(0, 2)))


def _corrected(world_from_cam: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """The cameras after the turns and steps (P, k) of those that there are."""
    result = world_from_cam.copy()
    placed = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
    turn = Rotation.from_rotvec(correction[:, :3]).as_matrix()
    result[placed, :3, :3] = np.einsum("tij,tjk->tik", turn, result[placed, :3, :3])
    if correction.shape[1] == 6:
        result[placed, :3, 3] += correction[:, 3:]
    return result


def _noise(held: csc_array, differ: csr_array, k: int) -> np.ndarray:
    """(k / 3,) what the images leave open of a camera, per axis, from its second differences."""
    n = differ.shape[0] // k
    sample = np.unique(np.linspace(0, n - 1, min(n, NOISE_SAMPLES)).round().astype(np.int64))
    chosen = differ[(k * sample[:, None] + np.arange(k)).ravel()]
    # One by one: a solver of many right sides waits for BLAS threads longer than it works.
    factors = splu(held)
    rows = (chosen[[row]].toarray()[0] for row in range(chosen.shape[0]))
    spread = np.array([(one * factors.solve(one)).sum() for one in rows])
    variance = np.median(spread.reshape(-1, k // 3, 3).mean(axis=2), axis=0)
    # A second difference has the variance of 1 + 4 + 1 frames.
    return np.asarray(np.sqrt(variance / 6))


def _figures(sigmas: np.ndarray, noise: np.ndarray, largest: np.ndarray) -> Smoothing:
    """What was assumed and what came of it, of the turn and, for six degrees of freedom, place.

    The prior passes a share of 1 / (1 + (noise / sigma)^2 (2 sin(pi f))^4) at the frequency f;
    it is half at the cut-off, 0.5 cycles/frame where all is passed.
    """
    cutoff = np.arcsin(np.minimum(1.0, np.sqrt(sigmas / noise) / 2)) / np.pi
    turn, *place = np.stack([sigmas, noise, largest, cutoff], axis=1).tolist()
    return Smoothing(SmoothTurn(*turn), SmoothPlace(*place[0]) if place else None)
