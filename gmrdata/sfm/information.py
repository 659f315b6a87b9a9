"""How firmly its image points hold each camera: information matrices with fixed points."""

from collections.abc import Mapping

import numpy as np
from scipy.sparse import block_diag, csr_array

CAUCHY_SCALE_PX = 1.0
"""As in the bundle adjustment."""
LEAST_NOISE_PX = 0.05
"""Image points are never taken to be better than this [px]."""
NEAREST_DEPTH = 1e-6


def camera_information(
    world_from_cam: np.ndarray,
    seen_px: Mapping[int, np.ndarray],
    seen_points: Mapping[int, np.ndarray],
    intrinsics_px: np.ndarray,
) -> tuple[csr_array, np.ndarray]:
    """Information of each camera's six degrees of freedom, from its reprojection Jacobian.

    The unknowns of a camera are a small turn w [rad] and a step d, both in the world's axes:
    R <- exp(w) R, c <- c + d.  Observations are weighted as by the Cauchy loss of the bundle
    adjustment, and by the noise that the residuals show.  The points themselves are held fixed,
    so the errors that frames share through them are not in here.

    Args:
        world_from_cam: (T, 4, 4); NaN where there is no camera.
        seen_px: By row of a frame with a camera: (N, 2) image points [px].
        seen_points: By the same rows: the points (N, 3) behind them.
        intrinsics_px: (3, 3) calibration matrix [px].

    Returns:
        (6T, 6T) block-diagonal J^T W J and (6T,) slope J^T W r, both over the variance of the
        image points; zero where there is no camera.
    """
    n = len(world_from_cam)
    blocks, slopes = np.zeros((n, 6, 6)), np.zeros((n, 6))
    residuals_px = [np.zeros((0, 2))]
    for row in sorted(seen_px):
        residual_px, jacobian = _linearized(
            world_from_cam[row], seen_px[row], seen_points[row], intrinsics_px
        )
        weight = 1.0 / (1.0 + (residual_px**2).sum(axis=1) / CAUCHY_SCALE_PX**2)
        blocks[row] = np.einsum("nki,n,nkj->ij", jacobian, weight, jacobian)
        slopes[row] = np.einsum("nki,n,nk->i", jacobian, weight, residual_px)
        residuals_px.append(residual_px)
    variance_px2 = noise_px(np.concatenate(residuals_px)) ** 2
    return csr_array(block_diag(blocks, format="csr")) / variance_px2, slopes.ravel() / variance_px2


def noise_px(residuals_px: np.ndarray) -> float:
    """Standard deviation per axis of residuals (N, 2), from their median size [px]."""
    if not len(residuals_px):
        return LEAST_NOISE_PX
    # Median of a Rayleigh distribution: 1.1774 standard deviations.
    median_px = float(np.median(np.linalg.norm(residuals_px, axis=1)))
    return max(LEAST_NOISE_PX, median_px / 1.1774)


def _linearized(
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
