"""Pointing a camera at a moving target."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gmrdata.errors import BadRecipe

UP_WORLD = np.array([0.0, 0.0, 1.0])


def look_at(centres_world_m: np.ndarray, targets_world_m: np.ndarray) -> np.ndarray:
    """Rotations of cameras that look at targets and keep the horizon level.

    Args:
        centres_world_m: (..., 3) optical centres, z-up world [m].
        targets_world_m: (..., 3) points that fall on the optical axis [m].

    Returns:
        (..., 3, 3) world_from_cam rotations, OpenCV axes (x right, y down, z forward).

    Raises:
        BadRecipe: a target is at the camera, or straight above or below it.
    """
    forward = np.asarray(targets_world_m, dtype=np.float64) - centres_world_m
    right = np.cross(forward, UP_WORLD)
    length = np.linalg.norm(forward, axis=-1, keepdims=True)
    level = np.linalg.norm(right, axis=-1, keepdims=True)
    if not np.all(level > 1e-6 * np.maximum(length, 1e-6)):
        raise BadRecipe(
            "the camera would look straight up or down, or be inside its subject; "
            "give it another height or distance"
        )
    forward, right = forward / length, right / level
    return np.stack([right, np.cross(forward, right), forward], axis=-1)


def smooth_path(points_m: np.ndarray, fps_hz: float, sigma_s: float, lag_s: float) -> np.ndarray:
    """A path as a camera operator follows it: low-pass filtered, and late.

    Args:
        points_m: (T, 3) path [m].
        fps_hz: Frame rate [Hz].
        sigma_s: Standard deviation of the Gaussian low-pass [s].
        lag_s: How late the operator is [s]; before the path starts it rests at its first point.

    Returns:
        (T, 3) smoothed path [m].
    """
    smooth = gaussian_filter1d(points_m, max(sigma_s * fps_hz, 1e-3), axis=0, mode="nearest")
    frames = np.arange(len(points_m))
    late = np.clip(frames - lag_s * fps_hz, 0, len(points_m) - 1)
    return np.stack([np.interp(late, frames, column) for column in smooth.T], axis=-1)
