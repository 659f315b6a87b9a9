"""A camera that only turns: rotations from matched rays, without any depth.

Pairwise rotations come from a robust orthogonal Procrustes fit (Kabsch 1976), a spanning tree of
the best pairs chains them, and Gauss-Newton with Cauchy weights refines all of them on all matches.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, eye_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.sparse.linalg import cg, spsolve
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import LOSS_PX
from gmrdata.cameras.files import Evidence, Smoothing
from gmrdata.cameras.frames import Frames, Timeline
from gmrdata.cameras.map.smoothing import block_diagonal, noise_px, smooth_cameras
from gmrdata.cameras.match.keyframes import relative_rotation, unit_rays
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.records import compared, figure

MATCHES_PER_PAIR, FEWEST_PER_PAIR, MOST_MATCHES = 200, 30, 500_000
MAX_ITERATIONS = 30
FEW_ITERATIONS, FAR_PX = 6, 2.0
"""Steps of many frames that tell whether their camera only turns; a median residual that further
steps don't bring to any threshold: they take a tenth of it."""
AT_ONCE = 20_000  # matches whose slopes are held
PANORAMIC = ("PANORAMIC", "PLANAR_OR_PANORAMIC")


@dataclass(frozen=True, eq=False)
class RotationOnly:
    """Rotations of a camera with a fixed centre, and how well they explain the matches."""

    world_from_cam_rotmats: np.ndarray
    """(T, 3, 3); identity where `has_camera` is False.  The tree's first frame is the world."""
    has_camera: np.ndarray  # (T,) bool: frames that matches link to the largest group
    residuals_px: np.ndarray  # (M,) reprojection error of the sampled matches in that group [px]
    pair_of_residual: np.ndarray  # (M,) index into the P pairs that were used, ascending
    pairs_rows: np.ndarray  # (P, 2) their first and second frame
    information: csr_array
    """(3T, 3T) of small turns in the world's axes, R <- exp(w) R, at the noise that the residuals
    show [1/rad^2]; the world is fixed at its first frame, and frames without a camera are zero."""

    @property
    def world_from_cam(self) -> np.ndarray:
        """(T, 4, 4) cameras at the origin; NaN where there is none."""
        cameras = transforms.rigid(self.world_from_cam_rotmats, np.zeros(3))
        cameras[~self.has_camera] = np.nan
        return cameras

    @property
    def pair_medians_px(self) -> np.ndarray:
        """(P,) median residual of each pair [px]."""
        starts = np.searchsorted(self.pair_of_residual, np.arange(1, len(self.pairs_rows)))
        return np.array([np.median(group) for group in np.split(self.residuals_px, starts)])


class _Rays(NamedTuple):
    """Sampled matches of the linked pairs, pair after pair."""

    rows: np.ndarray  # (M, 2) first and second frame
    first: np.ndarray  # (M, 3) unit rays in the first frame
    second_px: np.ndarray  # (M, 2) image points in the second frame [px]
    pair: np.ndarray  # (M,) index of the pair


def solve_rotation_only(
    matches: Matches, intrinsics_px: np.ndarray, inlier_px: float, rng: np.random.Generator
) -> RotationOnly:
    """Fit pure rotations to all verified matches; up to `inlier_px` one supports its pair's."""
    threshold_rad = inlier_px / float(intrinsics_px[0, 0])
    most = most_per_pair(len(matches.pairs), MATCHES_PER_PAIR)
    sampled = [_sample(pair, most, rng) for pair in matches.pairs]
    rays = [unit_rays(points, intrinsics_px) for points in matches.keypoints_px]
    second_from_first, inliers = [], []
    for pair, features in zip(matches.pairs, sampled, strict=True):
        rotation, agree = relative_rotation(
            rays[pair.first][features[:, 0]], rays[pair.second][features[:, 1]], threshold_rad, rng
        )
        second_from_first.append(rotation)
        inliers.append(int(agree.sum()))
    rotmats, linked = _chain(matches, np.array(second_from_first), np.array(inliers))
    used = [i for i, pair in enumerate(matches.pairs) if linked[pair.first] and linked[pair.second]]
    rows = np.array([(matches.pairs[i].first, matches.pairs[i].second) for i in used])
    data = _gather(matches, rays, [sampled[i] for i in used], rows)
    rotmats = _refine(rotmats, linked, data, intrinsics_px, is_long=most < MATCHES_PER_PAIR)
    residuals = _residuals_px(rotmats, data, intrinsics_px)
    information = _information(rotmats, linked, data, intrinsics_px)
    return RotationOnly(rotmats, linked, residuals, data.pair, rows, information)


def most_per_pair(n_pairs: int, usual: int) -> int:
    """How many matches of each of so many pairs a fit takes: fewer than usual of a long video's."""
    return min(usual, max(FEWEST_PER_PAIR, MOST_MATCHES // max(1, n_pairs)))


def refine_turning(
    turning: RotationOnly, timeline: Timeline, config: SfmConfig
) -> tuple[RotationOnly, Smoothing]:
    """Cameras that only turn, smoothed as far as their matches let them be."""
    cameras = turning.world_from_cam
    # The rotations are at their matches' optimum, so the slope is zero.
    slope = np.zeros(3 * len(cameras))
    refined, smoothing = smooth_cameras(cameras, turning.information, slope, timeline, 1.0, config)
    refined[~turning.has_camera] = np.eye(4)
    return replace(turning, world_from_cam_rotmats=refined[:, :3, :3]), smoothing


def weigh(turning: RotationOnly, matches: Matches, config: SfmConfig) -> Evidence:
    """Judge a pure rotation by its residuals."""
    medians_px = turning.pair_medians_px
    median_px = figure(np.median(turning.residuals_px))
    wide_px = figure(np.percentile(medians_px, 90))
    near_px = figure(np.percentile(medians_px, 10))
    share = figure(np.mean(turning.residuals_px < config.rotation_only_inlier_px))
    fits = (
        median_px <= config.rotation_only_median_px
        and wide_px <= config.rotation_only_wide_median_px
        and share >= config.rotation_only_share
    )
    panoramic = [pair.configuration in PANORAMIC for pair in matches.pairs]
    parallax = wide_px > max(config.choice.parallax_px, config.choice.parallax_growth * near_px)
    said, doubt = f"a pure rotation {'explains' if fits else 'does not explain'}", ""
    if fits and parallax:
        doubt = f", but residuals grow with the baseline (from {near_px} px), which may be parallax"
    return Evidence(
        verdict="full" if not fits else "either" if parallax else "rotation_only",
        reason=(
            f"{said} the matches: median residual {median_px} px "
            f"(threshold {config.rotation_only_median_px}), in the worst tenth of the pairs "
            f"{wide_px} px (threshold {config.rotation_only_wide_median_px}), "
            f"{100 * share:.0f} % of the matches within {config.rotation_only_inlier_px} px "
            f"(threshold {100 * config.rotation_only_share:.0f} %){doubt}"
        ),
        rotation_only_median_px=median_px,
        rotation_only_wide_median_px=wide_px,
        rotation_only_near_median_px=near_px,
        rotation_only_share=share,
        panoramic_pairs_share=float(np.mean(panoramic)),
        pairs=len(matches.pairs),
        features_per_frame=float(np.median(matches.n_free)),
    )


def _sample(pair: PairMatches, most: int, rng: np.random.Generator) -> np.ndarray:
    if (n := len(pair.features)) <= most:
        return pair.features
    return pair.features[np.sort(rng.choice(n, most, replace=False))]


def _chain(
    matches: Matches, second_from_first: np.ndarray, inliers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """World rotations along the tree of the pairs with most inliers, from the best linked frame."""
    # Where the camera goes far from frame to frame, no turn may fit two matches of any pair.
    n, strong = len(matches.keypoints_px), inliers >= min(2, inliers.max())
    first, second = np.array([(pair.first, pair.second) for pair in matches.pairs]).T
    weights = 1.0 / np.maximum(inliers[strong], 1)
    graph = coo_array((weights, (first[strong], second[strong])), shape=(n, n))
    tree = minimum_spanning_tree(graph.tocsr())
    strength = np.bincount(np.concatenate([first, second]), np.tile(inliers, 2), minlength=n)
    strength[np.setdiff1d(np.arange(n), [first[strong], second[strong]])] = -1
    order, predecessor = breadth_first_order(tree, int(strength.argmax()), directed=False)
    b_from_a = {}
    for a, b, rotation in zip(first, second, second_from_first, strict=True):
        b_from_a[a, b], b_from_a[b, a] = rotation, rotation.T
    rotmats, linked = np.tile(np.eye(3), (n, 1, 1)), np.zeros(n, dtype=bool)
    linked[order] = True
    for frame in order[1:]:
        before = int(predecessor[frame])
        rotmats[frame] = rotmats[before] @ b_from_a[int(frame), before]
    return rotmats, linked


def _gather(
    matches: Matches, rays: list[np.ndarray], sampled: list[np.ndarray], rows: np.ndarray
) -> _Rays:
    pair = np.repeat(np.arange(len(rows)), [len(features) for features in sampled])
    of = list(zip(rows, sampled, strict=True))
    first = np.concatenate([rays[row][features[:, 0]] for (row, _), features in of])
    second = [matches.keypoints_px[row][features[:, 1]] for (_, row), features in of]
    return _Rays(rows[pair], first, np.concatenate(second), pair)


def _predict(
    rotmats: np.ndarray, data: _Rays, intrinsics_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays in the second frames, second_from_first rotations, reprojection errors (M, 2) [px]."""
    second_from_first = np.swapaxes(rotmats[data.rows[:, 1]], 1, 2) @ rotmats[data.rows[:, 0]]
    seen = np.einsum("mij,mj->mi", second_from_first, data.first)
    # Rays that turn out of sight count as far away.
    image_px = (seen / np.maximum(seen[:, 2:], 1e-3)) @ intrinsics_px[:2].T
    return seen, second_from_first, image_px - data.second_px


def _refine(
    rotmats: np.ndarray,
    linked: np.ndarray,
    data: _Rays,
    intrinsics_px: np.ndarray,
    *,
    is_long: bool = False,
) -> np.ndarray:
    """Gauss-Newton on turns in the camera frames, R <- R exp(w), with Cauchy weights.  Of a long
    video given up soon where most matches are far from what any turn would explain."""
    # `scipy.optimize.least_squares` ends within 3e-7 rad of this, and takes ten times as long.
    free = np.flatnonzero(linked)[1:]
    if len(free) == 0:
        return rotmats
    unknowns = (3 * free[:, None] + np.arange(3)).ravel()
    for done in range(MAX_ITERATIONS):
        if is_long and done == FEW_ITERATIONS:
            far_px = np.median(_residuals_px(rotmats, data, intrinsics_px))
            if far_px > FAR_PX:
                break
        hessian, gradient = _normal_equations(rotmats, data, intrinsics_px)
        block = hessian[unknowns][:, unknowns]
        damping = 1e-9 * block.trace() / len(unknowns) * eye_array(len(unknowns))
        step = np.zeros(3 * len(rotmats))
        step[unknowns] = -_solved(csc_array(block + damping), gradient[unknowns], is_long=is_long)
        rotmats = rotmats @ Rotation.from_rotvec(step.reshape(-1, 3)).as_matrix()
        if np.abs(step).max() < 1e-9:
            break
    return rotmats


def _solved(system: csc_array, values: np.ndarray, *, is_long: bool) -> np.ndarray:
    """The solution of a sparse, symmetric and positive system."""
    if not is_long:
        # Unlike a dense solver the same to the last bit for any number of BLAS threads.
        return np.asarray(spsolve(system, values))
    # Frames that look alike link all of a long video with each other, so that its factor is nearly
    # full: one of 7,600 drawn keyframes took 51 s.  A step that ends early is but a shorter one.
    solution, _ = cg(system, values, rtol=1e-8, maxiter=2000, M=diags_array(1 / system.diagonal()))
    return np.asarray(solution)


def _residuals_px(rotmats: np.ndarray, data: _Rays, intrinsics_px: np.ndarray) -> np.ndarray:
    """(M,) how far each match is from where the turns put it [px]."""
    return np.asarray(np.linalg.norm(_predict(rotmats, data, intrinsics_px)[2], axis=1))


def _information(
    rotmats: np.ndarray, linked: np.ndarray, data: _Rays, intrinsics_px: np.ndarray
) -> csr_array:
    hessian, _ = _normal_equations(rotmats, data, intrinsics_px)
    # Turns in the cameras' axes become turns in the world's.
    world_from_cam = block_diagonal(rotmats)
    information = world_from_cam @ hessian @ world_from_cam.T
    variance_px2 = noise_px(_predict(rotmats, data, intrinsics_px)[2]) ** 2
    first = int(np.flatnonzero(linked)[0])
    fixed = np.zeros(hessian.shape[0])
    fixed[3 * first : 3 * first + 3] = hessian.trace() / len(fixed)
    return csr_array((information + diags_array(fixed)) / variance_px2)


def _normal_equations(
    rotmats: np.ndarray, data: _Rays, intrinsics_px: np.ndarray
) -> tuple[csr_array, np.ndarray]:
    """J^T W J (3T, 3T) and J^T W r (3T,) at the present rotations."""
    n = len(rotmats)
    starts = np.flatnonzero(np.diff(data.pair, prepend=-1))
    columns = (3 * data.rows[starts][:, :, None] + np.arange(3)).reshape(-1, 6)
    sums, gradient = np.zeros((len(starts), 6, 6)), np.zeros(3 * n)
    stops, done = np.append(starts, len(data.pair)), 0
    while done < len(starts):
        # Whole pairs: the slopes of all matches at once would take a kilobyte each.
        fit = int(np.searchsorted(stops, stops[done] + AT_ONCE, side="right")) - 1
        upto = max(done + 1, fit)
        some = slice(stops[done], stops[upto])
        blocks, slopes = _weighed(rotmats, _Rays(*(one[some] for one in data)), intrinsics_px)
        # Sum over each pair's matches first: they all fall on the same 6x6 block.
        pairs = slice(done, upto)
        sums[pairs] = np.add.reduceat(blocks, starts[pairs] - starts[done])
        pull = np.add.reduceat(slopes, starts[pairs] - starts[done])
        np.add.at(gradient, columns[pairs], pull)
        done = upto
    at = np.repeat(columns, 6, axis=1).ravel(), np.tile(columns, 6).ravel()
    return csr_array(coo_array((sums.ravel(), at), shape=(3 * n, 3 * n))), gradient


def _weighed(
    rotmats: np.ndarray, data: _Rays, intrinsics_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J^T w J (M, 6, 6) and J^T w r (M, 6) of single matches, by turns of both cameras."""
    seen, second_from_first, residual = _predict(rotmats, data, intrinsics_px)
    weight = 1.0 / (1.0 + (residual**2).sum(axis=1) / LOSS_PX**2)
    _, jacobian = slopes_by_turns(data.first, seen, second_from_first, np.diag(intrinsics_px)[:2])
    weighted = jacobian * weight[:, None, None]
    blocks = np.einsum("mki,mkj->mij", weighted, jacobian)
    return blocks, np.einsum("mki,mk->mi", weighted, residual)


def slopes_by_turns(
    rays: np.ndarray, seen: np.ndarray, second_from_first: np.ndarray, focal_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How image points in second frames follow rays (M, 3) and small turns of both cameras.

    Slopes (M, 2, 3) by rays `seen` (M, 3) in the second frames [px], and (M, 2, 6) by turns
    R <- R exp(w) of the first and of the second camera [px/rad]; `focal_px` is fx and fy.
    """
    depth = np.maximum(seen[:, 2], 1e-3)
    projection = np.zeros((len(seen), 2, 3))
    for axis in (0, 1):
        projection[:, axis, axis] = focal_px[axis] / depth
        projection[:, axis, 2] = -focal_px[axis] * seen[:, axis] / depth**2
    by_first = -projection @ second_from_first @ transforms.cross_matrices(rays)
    return projection, np.concatenate(
        [by_first, projection @ transforms.cross_matrices(seen)], axis=2
    )


ZOOM_PAIRS = 200  # that are looked at, at most
MOST_ZOOM = 1.0  # logarithm of what the first of two frames may be zoomed by
LEAST_ZOOM = 0.05  # logarithm, in the worst tenth of the pairs, from which a camera zooms


def zooms(matches: Matches, intrinsics_px: np.ndarray, config: SfmConfig) -> bool:
    """Whether turns together with a zoom explain the matches as well as a pure rotation must.

    They leave no parallax, so that who zooms looks like who goes towards a wall.
    """
    fits = [
        _zoomed(*matches.ends_px(pair), intrinsics_px, config.rotation_only_inlier_px)
        for pair in matches.pairs[:: -(-len(matches.pairs) // ZOOM_PAIRS)]
    ]
    zoom, median_px, share = np.array(fits).T
    return bool(
        np.percentile(np.abs(zoom), 90) >= LEAST_ZOOM
        and np.median(median_px) <= config.rotation_only_median_px
        and np.percentile(median_px, 90) <= config.rotation_only_wide_median_px
        and np.mean(share) >= config.rotation_only_share
    )


class _Zoomed(NamedTuple):
    """What a turn and a zoom leave of the matches of two frames."""

    zoom: float  # Logarithm
    median_px: float  # Of the residuals
    share: float  # Of the matches that agree


def _zoomed(
    first_px: np.ndarray, second_px: np.ndarray, intrinsics_px: np.ndarray, inlier_px: float
) -> _Zoomed:
    """The zoom beside a turn between matched points (N, 2), by their homography, from the focal
    length of the first frame that explains most: it may be zoomed already."""
    homography, _ = cv2.findHomography(first_px, second_px, cv2.RANSAC, inlier_px)
    if homography is None or not np.linalg.det(homography) > 0:
        return _Zoomed(0.0, np.inf, 0.0)

    def turned(log_before: float) -> tuple[float, np.ndarray]:
        """The logarithm of the zoom, and the distances (N,) that it leaves [px]."""
        before = np.diag([np.exp(log_before)] * 2 + [1.0])
        bent = np.linalg.inv(intrinsics_px) @ homography @ intrinsics_px @ before
        sizes = np.linalg.norm(bent, axis=1)
        then = np.diag([sizes[:2].mean() / sizes[2]] * 2 + [1.0])
        turn, _ = transforms.nearest_rotations(np.linalg.inv(then) @ bent)
        expected_px, _ = _turned(first_px, turn, intrinsics_px @ before, intrinsics_px @ then)
        off_px = np.linalg.norm(expected_px - second_px, axis=1)
        return float(np.log(then[0, 0])) - log_before, off_px

    best = minimize_scalar(lambda at: turned(at)[1].mean(), bounds=(-MOST_ZOOM, MOST_ZOOM))
    zoom, off_px = turned(float(best.x))
    return _Zoomed(zoom, float(np.median(off_px)), float((off_px < inlier_px).mean()))


CELLS = 8  # of the picture, along each side
FEWEST_FEATURES = 10  # of a cell that shows something


def covered_share(
    turning: RotationOnly,
    matches: Matches,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    most_px: float,
) -> float:
    """The median, over pairs of neighbours, of the share of the picture's cells with features of
    which the turn explains one to `most_px`; NaN where no two neighbours match.

    What stays in the picture while the camera moves (a logo, the hood of a car) looks like a scene
    before a camera at rest: its matches are exact and many, but all in one part of the picture.
    Features outside of masks count, where the second frame still shows their direction.
    """
    shares = []
    for pair in matches.pairs:
        if pair.second != pair.first + 1 or not turning.has_camera[[pair.first, pair.second]].all():
            continue
        n_free = matches.n_free[pair.first] if matches.n_free else None
        free_px = matches.keypoints_px[pair.first][:n_free]
        first, second = turning.world_from_cam_rotmats[[pair.first, pair.second]]
        turn = second.T @ first
        turned_px, ahead = _turned(free_px, turn, intrinsics_px)
        in_sight = ahead & ((turned_px >= 0) & (turned_px < size_px)).all(axis=1)
        first_px, second_px = matches.ends_px(pair)
        expected_px, before = _turned(first_px, turn, intrinsics_px)
        explained = before & (np.linalg.norm(expected_px - second_px, axis=1) < most_px)
        shown = _counts(free_px[in_sight], size_px) >= FEWEST_FEATURES
        met = _counts(first_px[explained], size_px) > 0
        if shown.any():
            shares.append(np.mean(met[shown]))
    return float(np.median(shares)) if shares else np.nan


def _turned(
    image_px: np.ndarray,
    turn: np.ndarray,
    intrinsics_px: np.ndarray,
    then_px: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Where image points (N, 2) come to lie after a turn (3, 3) [px], and which lie ahead (N,);
    the intrinsics may be others then."""
    rays = unit_rays(image_px, intrinsics_px) @ turn.T
    seen = rays @ (intrinsics_px if then_px is None else then_px).T
    return seen[:, :2] / np.maximum(rays[:, 2:], 1e-3), rays[:, 2] > 0


def _counts(image_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(CELLS^2,) how many image points (N, 2) lie in each cell of the picture."""
    cells = np.clip((image_px / size_px * CELLS).astype(np.int64), 0, CELLS - 1)
    return np.bincount(cells @ [1, CELLS], minlength=CELLS**2)


def require_cover(
    turning: RotationOnly, matches: Matches, frames: Frames, config: SfmConfig
) -> None:
    """Refuse a turn that explains what stays in the picture, such as a logo, and little else."""
    most_px = config.rotation_only_inlier_px
    share = covered_share(turning, matches, frames.intrinsics_px, frames.size_px, most_px)
    if share < (least := config.choice.least_covered):
        what = "a camera that stays in its place explains only {} of the picture, less than {}"
        raise NoReconstruction(
            f"{compared(what, share, least, '.0%')}. A logo, a subtitle or the hood of a car stays "
            "in the picture, and masks may keep it out; or most of the picture moves by itself",
            frames.images[0].parent,
        )
