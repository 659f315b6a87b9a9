"""Whether the background fits the intrinsics: the focal length and the lens that it would choose.

A reconstruction with fixed intrinsics is adjusted again on a thinned copy, once with the focal
length free and once with one term of radial distortion.  Where the camera moves enough the
background holds both firmly; where it doesn't, the standard errors say so.  The focal length is
sought from far starts too, and the lowest cost wins, so that a wrong one doesn't confirm itself.
Of a camera that only turns, two frames are related by K R K^-1, so their overlap holds the focal
length (Hartley 1994): Gauss-Newton with Cauchy weights on all orientations and its logarithm.
Nothing of these results but their figures is used.

Where two terms of distortion explain the matches clearly better, they are taken out of the image
points: bent rays bend the path.  No image is undistorted.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import LEAST_NOISE_PX, LOSS_PX, FreeIntrinsic, bundle_adjuster, pycolmap
from gmrdata.cameras.files import Distortion
from gmrdata.cameras.map.rotation_only import RotationOnly, most_per_pair, slopes_by_turns
from gmrdata.cameras.match.keypoint_adjustment import MEASURED_PX
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import DistortionConfig
from gmrdata.values import transforms
from gmrdata.values.camera import bent, straightened

FREED_NOT_INDEPENDENT = 2.5
"""The error by covariance is too small by this: a feature's errors have much in common."""
SYSTEMATIC_FOCAL, SYSTEMATIC_K1 = 0.0125, 0.008
"""What no covariance has: rolling shutter, what moves, the one lens standing for the other."""
WARP_PX = 1.0
"""What a rolling shutter and a phone's steadying bend at the edge of a turning picture."""
STARTS = (1.0, 0.6, 1.6)  # focal lengths that the adjustment starts from, over the given one
MOST_KEYFRAMES, MOST_POINTS, FEWEST_SEEN = 16, 800, 3  # of the thinned copy
MATCHES_PER_PAIR = 100
MAX_ITERATIONS = 30
MAX_LOG_FACTOR = 1.5  # beyond this the fit has run away
MAX_RADIAL = 1.0  # likewise
LENS_STEP = 1e-6  # of log f and k1, for their slopes
MAX_SIGMA = 0.5  # a factor that is less certain than this says nothing
NOT_INDEPENDENT = 5.0
"""The error by covariance is too small by this: a camera in the hand also moves a little, and what
parallax it leaves leans on the focal length."""


@dataclass(frozen=True)
class FreedFocal:
    """What the background asks for."""

    factor: float  # Focal length over that of the given intrinsics; 1 where they are right
    sigma: float  # Standard error of `factor`
    radial_k1: float | None = None
    """Distortion at the given focal length: a point at r, in units of it, is seen at r + k1 r^3.
    None where it was not measured: of a camera that only turns."""
    radial_k1_sigma: float | None = None  # Its standard error


def freed_focal(model: Any) -> FreedFocal | None:
    """Adjust copies of a COLMAP reconstruction; None where it fails or has no standard error."""
    if model.num_cameras() != 1 or model.num_reg_images() < 3 or model.num_points3D() == 0:
        return None
    thin, images = _thinned(model)
    tried = [_adjusted(thin, images, "focal", start) for start in STARTS]
    focal = min((one for one in tried if one is not None), key=lambda one: one.cost, default=None)
    radial = _adjusted(thin, images, "radial", 1.0)
    if focal is None or radial is None:
        return None
    factor = float(np.exp(focal.value))
    sigma = float(np.hypot(FREED_NOT_INDEPENDENT * focal.sigma, SYSTEMATIC_FOCAL))
    if radial.cost < focal.cost:
        # Distortion explains it better than another focal length does: that may well be right.
        sigma = float(np.hypot(sigma, factor - 1.0))
    k1_sigma = float(np.hypot(FREED_NOT_INDEPENDENT * radial.sigma, SYSTEMATIC_K1))
    return FreedFocal(factor, sigma, radial.value, k1_sigma)


class _Adjusted(NamedTuple):
    value: float  # Logarithm of the focal length's factor, or k1
    sigma: float  # By covariance
    cost: float


def _thinned(model: Any) -> tuple[Any, list[int]]:
    """A copy with one lens for both axes, and the keyframes that still see points."""
    copy, every = pycolmap.Reconstruction(model), sorted(model.reg_image_ids())
    at = np.linspace(0, len(every) - 1, min(len(every), MOST_KEYFRAMES)).round().astype(int)
    images = [every[i] for i in np.unique(at)]
    points = sorted(copy.point3D_ids())
    for point in points:
        track = [(e.image_id, e.point2D_idx) for e in copy.point3D(point).track.elements]
        if sum(image in images for image, _ in track) < FEWEST_SEEN:
            copy.delete_point3D(point)
            continue
        for seen in track:
            if seen[0] not in images:
                copy.delete_observation(*seen)
    points = sorted(copy.point3D_ids())
    keep = set(points[:: max(1, -(-len(points) // MOST_POINTS))])
    for point in points:
        if point not in keep:
            copy.delete_point3D(point)
    _let_bend(copy, images, pycolmap.CameraModelId.SIMPLE_RADIAL, [0.0])
    return copy, images


def _let_bend(model: Any, images: list[int], kind: Any, terms: list[float]) -> None:
    """Give a model one lens for both axes, with terms of distortion."""
    (camera,) = model.cameras.values()
    fx, fy, cx, cy = camera.params
    for image in images if fx != fy else ():
        for spot in model.image(image).points2D:
            spot.xy = [spot.xy[0], cy + (spot.xy[1] - cy) * fx / fy]
    camera.model = kind
    camera.params = [fx, cx, cy, *terms]


def with_lens(model: Any, config: DistortionConfig) -> tuple[Any, Distortion | None]:
    """The model adjusted with radial distortion, and that; itself and None where it hardly helps.

    The image points of the result are stretched to one focal length and are still distorted.
    """
    if model.num_cameras() != 1 or model.compute_num_observations() < config.min_observations:
        return model, None
    bent = pycolmap.Reconstruction(model)
    images = sorted(bent.reg_image_ids())
    _let_bend(bent, images, pycolmap.CameraModelId.RADIAL, [0.0, 0.0])
    summary = bundle_adjuster(bent, free="radial").solve()
    (camera,) = bent.cameras.values()
    focal_px, cx, cy, k1, k2 = camera.params
    cost = summary.ceres_summary
    corner_px = np.hypot(max(cx, camera.width - cx), max(cy, camera.height - cy))
    r2 = np.linspace(0, corner_px / focal_px, 50) ** 2
    stretch = 1 + 3 * k1 * r2 + 5 * k2 * r2**2
    explains = 1.0 - cost.final_cost / cost.initial_cost
    helps = explains >= config.least_share and stretch.min() >= config.least_stretch
    if not (summary.is_solution_usable() and helps):
        return model, None
    return bent, Distortion(k1, k2, explains)


def _adjusted(thin: Any, images: list[int], free: FreeIntrinsic, start: float) -> _Adjusted | None:
    """Adjust a copy with one intrinsic free; None where that fails or has no standard error."""
    model = pycolmap.Reconstruction(thin)
    (camera,) = model.cameras.values()
    given_px, cx, cy, _ = camera.params
    camera.params = [start * given_px, cx, cy, 0.0]
    # What a patch's motion errs by is in all of its track: what is left of it shows too little.
    adjusted = adjust_lens(model, images, free, MEASURED_PX)
    if adjusted is None or adjusted.covariance.shape != (1, 1):
        return None
    factor, k1 = camera.params[0] / given_px, camera.params[3]
    sigma = float(np.sqrt(adjusted.covariance[0, 0]))
    if free == "radial":
        return _Adjusted(float(k1), sigma, adjusted.cost)
    return _Adjusted(float(np.log(factor)), sigma / float(camera.params[0]), adjusted.cost)


class AdjustedLens(NamedTuple):
    """What an adjustment of a model says of the intrinsics that it left free."""

    covariance: np.ndarray  # (N, N) of COLMAP's parameters, at the noise that is left
    cost: float


def adjust_lens(
    model: Any, images: list[int], free: FreeIntrinsic, least_noise_px: float = LEAST_NOISE_PX
) -> AdjustedLens | None:
    """Adjust a model of one camera in place; None where that fails or has no standard error."""
    (camera,) = model.cameras.values()
    # COLMAP's usual tolerance of 1e-6 stops short.
    adjuster = bundle_adjuster(model, images, free, max_iterations=100, tolerance=1e-7)
    summary = adjuster.solve()
    if not summary.is_solution_usable() or not camera.params[0] > 0:
        return None
    covariance = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), model, adjuster)
    of_free = None if covariance is None else covariance.get_other_params_cov(camera.params)
    if of_free is None:
        return None
    model.update_point_3d_errors()
    errors_px = np.array([model.point3D(i).error for i in sorted(model.point3D_ids())])
    # An error is the length of two coordinates; for normal ones its median is 1.177 sigma.
    noise_px = max(least_noise_px, float(np.median(errors_px)) / 1.177)
    return AdjustedLens(noise_px**2 * of_free, float(summary.ceres_summary.final_cost))


class TurningFit(NamedTuple):
    """Orientations and lens that make a camera's matches those of one that only turns."""

    log_factor: float  # Logarithm of the focal length over the given one
    radial_k1: float
    covariance: np.ndarray  # (2, 2) of both at the noise that is left; k1's is 0 where it is fixed
    cost: float  # Mean of the loss over the matches, which are the same for every start
    noise_px: float


def turning_focal(
    turning: RotationOnly, matches: Matches, intrinsics_px: np.ndarray
) -> FreedFocal | None:
    """Refine orientations and focal length together; None where the matches don't hold it."""
    focal_px, longer_px = float(intrinsics_px[0, 0]), 2 * float(intrinsics_px[:2, 2].max())
    # A camera that stays says nothing by the shortest focal length that may be found, and the fit
    # of a long video takes minutes.
    if warp_error(turning, longer_px, float(np.exp(-MAX_LOG_FACTOR)) * focal_px) > MAX_SIGMA:
        return None
    fit = fit_turning(turning, matches, intrinsics_px, radial=False)
    if fit is None:
        return None
    factor = float(np.exp(fit.log_factor))
    warped = warp_error(turning, longer_px, factor * focal_px)
    of_fit = NOT_INDEPENDENT * float(np.sqrt(fit.covariance[0, 0]))
    sigma = float(np.linalg.norm([of_fit, SYSTEMATIC_FOCAL, warped]))
    if sigma > MAX_SIGMA:
        return None
    return FreedFocal(factor, sigma)


def warp_error(turning: RotationOnly, longer_px: float, focal_px: float) -> float:
    """What a warp of the pictures makes of the focal length of a camera that turns, as a share.

    Over a turn by an angle a the picture's edge, r from the middle, moves by a r^2 / f more than
    its middle; nothing else tells the focal length.
    """
    known = turning.world_from_cam_rotmats[turning.has_camera]
    turn_rad = 2 * float(np.sqrt((transforms.turns_about_mean_rad(known) ** 2).mean()))
    more_px = turn_rad * (longer_px / 2) ** 2 / focal_px
    return min(WARP_PX / more_px, 1.0) if more_px > 0 else 1.0


def fit_turning(
    turning: RotationOnly, matches: Matches, intrinsics_px: np.ndarray, *, radial: bool
) -> TurningFit | None:
    """Orientations and focal length together, and one term of distortion if it is asked for; None
    where the matches don't hold them."""
    sampled = _gather(turning, matches, intrinsics_px)
    if not len(sampled[0]):
        return None
    rotmats, lens = turning.world_from_cam_rotmats, np.zeros(2)
    focal_px, n_lens = np.diag(intrinsics_px)[:2], 2 if radial else 1
    for _ in range(MAX_ITERATIONS):
        residuals_px, jacobian = _linearised(rotmats, lens, sampled, focal_px, n_lens)
        error2_px = (residuals_px**2).sum(axis=1)
        weights = np.repeat(1.0 / (1.0 + error2_px / LOSS_PX**2), 2)
        hessian = csc_array(jacobian.T @ (jacobian * weights[:, None]))
        # Frames without matches, and the one orientation that all share, stay where they are.
        damping = 1e-9 * hessian.trace() / hessian.shape[0]
        solver = splu(csc_array(hessian + damping * eye_array(hessian.shape[0])))
        step = -solver.solve(jacobian.T @ (weights * residuals_px.ravel()))
        rotmats = rotmats @ Rotation.from_rotvec(step[:-n_lens].reshape(-1, 3)).as_matrix()
        lens[:n_lens] += step[-n_lens:]
        if not abs(lens[0]) < MAX_LOG_FACTOR or not abs(lens[1]) < MAX_RADIAL:
            return None
        if np.abs(step[-n_lens:]).max() < 1e-7:
            break
    unit = np.eye(len(step))[:, -n_lens:]
    covariance = np.zeros((2, 2))
    covariance[:n_lens, :n_lens] = solver.solve(unit)[-n_lens:]
    if covariance.diagonal().max() * damping > 0.01:  # nothing but the damping holds it
        return None
    noise_px = max(LEAST_NOISE_PX, float(np.sqrt(np.median(error2_px))) / 1.177)
    cost = float(np.log1p(error2_px / LOSS_PX**2).mean())
    return TurningFit(float(lens[0]), float(lens[1]), noise_px**2 * covariance, cost, noise_px)


_Sampled = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Frames (M, 2) of matches, and both image points (M, 2) from the principal point, over K."""


def _gather(turning: RotationOnly, matches: Matches, intrinsics_px: np.ndarray) -> _Sampled:
    frames = [np.zeros((0, 2), dtype=np.int64)]
    first, second = [np.zeros((0, 2))], [np.zeros((0, 2))]
    most = most_per_pair(len(matches.pairs), MATCHES_PER_PAIR)
    for pair in matches.pairs:
        if turning.has_camera[pair.first] and turning.has_camera[pair.second]:
            chosen = pair.features[:: max(1, len(pair.features) // most)]
            frames.append(np.tile([pair.first, pair.second], (len(chosen), 1)))
            first.append(matches.keypoints_px[pair.first][chosen[:, 0]])
            second.append(matches.keypoints_px[pair.second][chosen[:, 1]])
    centre_px, focal_px = intrinsics_px[:2, 2], np.diag(intrinsics_px)[:2]
    over_k = [(np.concatenate(px) - centre_px) / focal_px for px in (first, second)]
    return np.concatenate(frames), over_k[0], over_k[1]


def _linearised(
    rotmats: np.ndarray, lens: np.ndarray, sampled: _Sampled, focal_px: np.ndarray, n_lens: int
) -> tuple[np.ndarray, csc_array]:
    """Residuals (M, 2) [px] and their slopes (2 M, 3 T + n_lens) by turns R <- R exp(w), and by the
    lens: log f, and k1 where it is free."""
    frames, first, second = sampled
    second_from_first = np.swapaxes(rotmats[frames[:, 1]], 1, 2) @ rotmats[frames[:, 0]]

    def predicted_px(of: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays (M, 3) in the first and the second frames, and image points (M, 2)."""
        factor, k1 = np.exp(of[0]), of[1]
        rays = np.c_[straightened(first / factor, k1), np.ones(len(first))]
        seen = np.einsum("mij,mj->mi", second_from_first, rays)
        flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)
        return rays, seen, factor * focal_px * bent(flat, k1)

    rays, seen, image_px = predicted_px(lens)
    flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)
    _, by_turns = slopes_by_turns(rays, seen, second_from_first, np.ones(2))
    by_flat = _slopes_of_bent(flat, lens[1]) * (np.exp(lens[0]) * focal_px)[:, None]
    values = np.concatenate([by_flat @ by_turns, np.zeros((len(seen), 2, n_lens))], axis=2)
    for column in range(n_lens):
        moved = lens + LENS_STEP * (np.arange(2) == column)
        values[:, :, 6 + column] = (predicted_px(moved)[2] - image_px) / LENS_STEP
    n_unknowns = 3 * len(rotmats) + n_lens
    turns = (3 * frames[:, :, None] + np.arange(3)).reshape(-1, 6)
    last = np.tile(np.arange(n_unknowns - n_lens, n_unknowns), (len(turns), 1))
    columns = np.c_[turns, last]
    rows = np.arange(2 * len(seen)).reshape(-1, 2, 1)
    where = [np.broadcast_to(at, values.shape).ravel() for at in (rows, columns[:, None])]
    entries, shape = (values.ravel(), tuple(where)), (2 * len(seen), n_unknowns)
    return image_px - focal_px * second, csc_array(coo_array(entries, shape))


def _slopes_of_bent(straight: np.ndarray, radial_k1: float) -> np.ndarray:
    """(M, 2, 2) slopes of `bent` by its points (M, 2)."""
    r2 = (straight**2).sum(axis=1)[:, None, None]
    outer = straight[:, :, None] * straight[:, None]
    return np.asarray((1 + radial_k1 * r2) * np.eye(2) + 2 * radial_k1 * outer)
