"""Scale from the ground: planted soles lie on the plane of the points triangulated round them.

Above that plane, seen along its normal n, the camera is n.c - d in the reconstruction's unit, and
-n.(R p) metres above a planted sole p that is known in its frame.  The scale is their ratio.  It
needs no slow feet, and it holds for a camera that hardly travels, as long as there are points.
"""

import numpy as np
from scipy.spatial import cKDTree

from gmrdata.values.camera import CameraPath
from gmrdata.world.planted_feet import SOLE_POINTS, SeenFeet, standing
from gmrdata.world.recipe import CueEstimate, ScaleConfig

SAMPLES = 400
LARGEST_TILT_RAD = np.deg2rad(30.0)  # between the ground's normal and the person's mean up
LOOKS, LOOK_RAD, FEWEST_BELOW = 20, np.deg2rad(35.0), 5
"""Frames in which to look below the person, how far round the ray to them, and for how many."""
LOWEST_CAMERA = 0.1  # a camera nearer to the ground, as a share of the way to the feet, is too low


def ground_contact_scale(
    seen: SeenFeet, points: np.ndarray, rough_scale: float, config: ScaleConfig
) -> CueEstimate | None:
    """Scale at which planted soles are on the ground; None where too few points show the ground.

    Background points (N, 3) are in the unit of the cameras; the rough scale is right to some tens
    of percent.
    """
    camera_path = seen.camera_path
    rotmats, centres = camera_path.world_from_cam[:, :3, :3], camera_path.centres_world_m
    soles_m = np.einsum("tij,tfkj->tfki", rotmats, seen.points_cam_m[:, :, SOLE_POINTS])
    up = np.nanmean(np.einsum("tij,tj->ti", rotmats, seen.up_cam), axis=0)
    up /= np.linalg.norm(up)
    slip_m = config.slip_m(seen.fps_hz)
    still = standing(soles_m + rough_scale * centres[:, None, None], slip_m)
    frames, foot = np.nonzero(still.any(axis=-1))
    if not len(frames):
        return None
    feet = centres[frames] + soles_m[frames, foot].mean(axis=1) / rough_scale
    # The person may lean, and then the plane that was found tells up better.
    tolerance = config.ground_inlier_m / rough_scale
    for _ in range(2):
        near = _near_feet(points, feet, up, rough_scale, config)
        plane = _fit_plane(near, up, tolerance)
        if plane is None or plane[2] < config.min_ground_points:
            return None
        normal, offset, n_points, residual = plane
        up = normal
    frames, height_m, away_m = _lowest(soles_m, still, normal)
    height = centres[frames] @ normal - offset
    if np.median(height_m) < LOWEST_CAMERA * np.median(away_m):
        return None
    scales = height_m / height
    scale = float(np.median(scales))
    stances = 1 + np.count_nonzero(np.diff(np.unique(frames)) > 1)
    spread = 1.4826 * float(np.median(np.abs(scales - scale))) / np.sqrt(stances)
    contact = scale * config.contact_sigma_m / float(np.median(height_m))
    plane_error = scale * residual / np.sqrt(n_points) / float(np.median(height))
    sigma = float(np.sqrt(spread**2 + contact**2 + plane_error**2))
    if not np.isfinite([scale, sigma]).all():
        return None
    return CueEstimate("ground_contact", scale, sigma, n_points, residual * scale, person=None)


def scale_by_what_is_below(
    camera_path: CameraPath, points: np.ndarray, pelvis_cam_m: np.ndarray, up_cam: np.ndarray
) -> float | None:
    """Scale at which the person is as far away as what is seen below the pelvis, mostly the ground
    before and behind; None where nothing is.  A start for `ground_contact_scale`, no cue."""
    known = np.flatnonzero(np.isfinite(camera_path.world_from_cam).all(axis=(1, 2)))
    scales = []
    for row in known[:: max(1, len(known) // LOOKS)]:
        rotmat, centre = camera_path.world_from_cam[row, :3, :3], camera_path.centres_world_m[row]
        seen = (points - centre) @ rotmat
        away, away_m = np.linalg.norm(seen, axis=1), float(np.linalg.norm(pelvis_cam_m[row]))
        rays, ray = seen / np.maximum(away, 1e-12)[:, None], pelvis_cam_m[row] / away_m
        below = (rays @ ray > np.cos(LOOK_RAD)) & (rays @ up_cam[row] < ray @ up_cam[row])
        if below.sum() >= FEWEST_BELOW:
            scales.append(away_m / float(np.median(away[below])))
    return float(np.median(scales)) if scales else None


def _lowest(
    soles_m: np.ndarray, still: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames in which soles (T, 2, K, 3) stand still, and of each the lowest point that does: how
    far below the camera it is, and how far away [m].

    Of both feet, since a slow one may be in the air; and along the ground's normal, since a person
    who leans forward would call toes and the front foot the lowest.
    """
    depths_m = np.where(still, -soles_m @ normal, -np.inf).reshape(len(soles_m), -1)
    frames, lowest = np.flatnonzero(still.any(axis=(1, 2))), depths_m.argmax(axis=1)
    away_m = np.linalg.norm(soles_m, axis=-1).reshape(depths_m.shape)
    return frames, depths_m[frames, lowest[frames]], away_m[frames, lowest[frames]]


def _near_feet(
    points: np.ndarray, feet: np.ndarray, up: np.ndarray, scale: float, config: ScaleConfig
) -> np.ndarray:
    """Points that may be the ground, (P, 3): near planted feet, and about as low."""
    across = np.linalg.svd(up[None])[2][1:]
    tree = cKDTree(feet @ across.T)
    apart, nearest = tree.query(points @ across.T)
    above = np.abs(points @ up - feet[nearest] @ up)
    near = (apart * scale < config.ground_radius_m) & (above * scale < config.ground_height_m)
    return np.asarray(points[near])


def _fit_plane(
    points: np.ndarray, up: np.ndarray, tolerance: float
) -> tuple[np.ndarray, float, int, float] | None:
    """Normal (3,), offset, number and RMS of the points on the best nearly level plane."""
    if len(points) < 3:
        return None
    # Samples of three points, then least squares with Cauchy weights.
    rng = np.random.default_rng(0)
    corners = points[rng.integers(0, len(points), (SAMPLES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    normals *= np.sign(normals @ up)[:, None]
    level = normals @ up > np.cos(LARGEST_TILT_RAD)
    normals, starts = np.r_[normals[level], up[None]], corners[lengths > 0][level][:, 0]
    offsets = np.r_[(normals[:-1] * starts).sum(axis=1), np.median(points @ up)]
    costs = [
        np.minimum(np.abs(points @ normal - offset), tolerance).sum()
        for normal, offset in zip(normals, offsets, strict=True)
    ]
    best = int(np.argmin(costs))
    normal, offset = normals[best], offsets[best]
    for _ in range(20):
        residual = points @ normal - offset
        weights = 1.0 / (1.0 + (residual / tolerance) ** 2) ** 2
        middle = weights @ points / weights.sum()
        spread = (points - middle).T @ ((points - middle) * weights[:, None])
        normal = np.linalg.eigh(spread)[1][:, 0]
        normal = normal * np.sign(normal @ up)
        offset = float(middle @ normal)
    on = np.abs(points @ normal - offset) < 2 * tolerance
    if normal @ up < np.cos(LARGEST_TILT_RAD) or not on.any():
        return None
    rms = float(np.sqrt(np.mean((points[on] @ normal - offset) ** 2)))
    return normal, offset, int(on.sum()), rms
