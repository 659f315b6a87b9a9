"""Whether the background fits the intrinsics: the focal length that it would choose itself.

A reconstruction with fixed intrinsics is adjusted once more with the focal length free, on a copy.
Where the camera moves enough the background holds the focal length firmly; where it doesn't, the
standard error says so.  Nothing of the result but this figure is used.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gmrdata.sfm.adjusting import adjustment_options, whole_problem
from gmrdata.sfm.colmap import pycolmap

MAX_ITERATIONS = 200
NOISE_FLOOR_PX = 0.05
"""Features are not placed better than this [px]."""
NOT_INDEPENDENT = 2.5
"""The error by covariance is too small by this, as errors of a feature in several frames have much
in common.  Measured: 2.4 over eight filmed arcs with right intrinsics."""


@dataclass(frozen=True)
class FreedFocal:
    """The focal length that the background asks for."""

    factor: float
    """Over that of the intrinsics that were given; 1 where they are right."""
    sigma: float | None
    """Standard error of `factor`, from the covariance of the adjustment; None where it has none,
    and then `factor` means nothing."""


def freed_focal(model: Any) -> FreedFocal | None:
    """Adjust a copy of a COLMAP reconstruction with its focal length free.

    Args:
        model: A `pycolmap.Reconstruction` with one pinhole camera; stays as it is.

    Returns:
        None where there is nothing to adjust, or the adjustment fails.
    """
    if model.num_cameras() != 1 or model.num_reg_images() < 3 or model.num_points3D() == 0:
        return None
    copy = pycolmap.Reconstruction(model)
    (camera_id,) = copy.cameras
    given_px = _focal_px(copy, camera_id)
    # COLMAP's usual tolerance of 1e-6 stops short.
    options = adjustment_options(
        free_focal=True, max_iterations=MAX_ITERATIONS, function_tolerance=1e-8
    )
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, whole_problem(copy), copy)
    summary = adjuster.solve()
    factor = _focal_px(copy, camera_id) / given_px
    if not summary.is_solution_usable() or not np.isfinite(factor) or factor <= 0:
        return None
    return FreedFocal(factor, _sigma(copy, camera_id, adjuster))


def _focal_px(model: Any, camera_id: int) -> float:
    """Geometric mean of fx and fy [px]."""
    camera = model.camera(camera_id)
    return float(np.sqrt(camera.focal_length_x * camera.focal_length_y))


def _sigma(model: Any, camera_id: int, adjuster: Any) -> float | None:
    """Standard error of the focal length, as a share of it."""
    options = pycolmap.BACovarianceOptions()
    covariance = pycolmap.estimate_ba_covariance(options, model, adjuster)
    camera = model.camera(camera_id)
    of_focal = None if covariance is None else covariance.get_other_params_cov(camera.params)
    if of_focal is None or of_focal.shape != (2, 2):
        return None
    focal_px = np.array([camera.focal_length_x, camera.focal_length_y])
    slope = 0.5 / focal_px  # of log(sqrt(fx fy))
    model.update_point_3d_errors()
    errors_px = np.array([model.point3D(i).error for i in sorted(model.point3D_ids())])
    # An error is the length of two coordinates; for normal ones its median is 1.177 sigma.
    noise_px = max(NOISE_FLOOR_PX, float(np.median(errors_px)) / 1.177)
    variance = float(slope @ of_focal @ slope) * noise_px**2
    return NOT_INDEPENDENT * float(np.sqrt(variance)) if variance >= 0 else None
