"""pycolmap, imported in the one order that works, and silent; what its callers share."""

from typing import Any

import cv2  # noqa: F401
import numpy as np
import pycolmap

from gmrdata.values import transforms

# OpenCV first: with pycolmap loaded before it, cv2.imwrite of a PNG aborts the process, because
# both wheels carry their own libpng (seen with pycolmap 4.2.1 and OpenCV 4.11).

# Only fatal messages: what goes wrong is told by our own errors, with the file and the remedy.
pycolmap.logging.minloglevel = 3

__all__ = ["pycolmap"]


def matrix_of(rigid: Any) -> np.ndarray:
    """A pycolmap.Rigid3d as a transform (4, 4)."""
    matrix = np.asarray(rigid.matrix())
    return transforms.rigid(matrix[:, :3], matrix[:, 3])


def adjustment_options(*, free_focal: bool, max_iterations: int, function_tolerance: float) -> Any:
    """COLMAP's options on one thread, so that results repeat; at most the focal length is free."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = free_focal
    options.refine_principal_point = False
    options.refine_extra_params = False
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = 1.0
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = max_iterations
    options.ceres.solver_options.function_tolerance = function_tolerance
    return options


def whole_problem(model: Any) -> Any:
    """All cameras and points of a model, its gauge held by two cameras."""
    problem = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids()):
        problem.add_image(image_id)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    return problem
