"""Errors of recovered cameras against the true ones of the same frames."""

import numpy as np

from gmrdata.evaluate.alignment import fit_similarity, mean_rotation
from gmrdata.evaluate.metrics import angles_rad
from gmrdata.geometry import transforms

MIN_CAMERA_EXTENT_M = 0.05
"""Extent of the true camera path below which a scale can't be read off it [m]."""


def camera_rotation_deg(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """Mean angle between world_from_cam (n, 4, 4) after one best rotation of the pseudo world
    [deg]; None without cameras."""
    if not len(pseudo_cameras):
        return None
    pseudo_rotmats, true_rotmats = pseudo_cameras[:, :3, :3], true_cameras[:, :3, :3]
    true_from_pseudo = mean_rotation(true_rotmats @ np.swapaxes(pseudo_rotmats, 1, 2))
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_pseudo @ pseudo_rotmats
    return float(np.rad2deg(angles_rad(residuals)).mean())


def camera_path_mm(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """Mean distance of the centres of world_from_cam (n, 4, 4) after one best rigid transform of
    the pseudo world [mm]; None without cameras.

    The absolute trajectory error of Sturm et al. (2012, section IV-D), as a mean.  The scale is not
    fitted, so its error counts.
    """
    if not len(pseudo_cameras):
        return None
    centres_m, true_centres_m = pseudo_cameras[:, :3, 3], true_cameras[:, :3, 3]
    fit = fit_similarity(true_centres_m, centres_m, scale=False)
    moved_m = transforms.apply(transforms.rigid(fit.rotmat, fit.translation_m), centres_m)
    return float(np.linalg.norm(moved_m - true_centres_m, axis=1).mean() * 1000)


def scale_error_percent(pseudo_cameras: np.ndarray, true_cameras: np.ndarray) -> float | None:
    """By how much the pseudo path is too large (> 0) or too small (< 0) in the best similarity fit
    of the centres of world_from_cam (n, 4, 4) [%]; None where the true camera stays within 5 cm, or
    the pseudo cameras have no positions."""
    centres_m, true_centres_m = pseudo_cameras[:, :3, 3], true_cameras[:, :3, 3]
    if len(centres_m) < 2 or _extent_m(true_centres_m) < MIN_CAMERA_EXTENT_M:
        return None
    # Cameras of which only the rotations were recovered all stand in one place.
    if _extent_m(centres_m) < 1e-9:
        return None
    true_scale_from_pseudo = fit_similarity(true_centres_m, centres_m, scale=True).scale
    if true_scale_from_pseudo <= 0:
        return None
    return 100 * (1 / true_scale_from_pseudo - 1)


def _extent_m(points_m: np.ndarray) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(points_m, axis=0)))
