"""pycolmap, imported in the one order that works, and silent; what its callers share."""

from collections.abc import Iterable
from typing import Any, Literal

import cv2  # noqa: F401
import numpy as np
import pycolmap as pycolmap

from gmrdata.values import transforms

# OpenCV first: with pycolmap loaded before it, cv2.imwrite of a PNG aborts the process, because
# both wheels carry their own libpng (seen with pycolmap 4.2.1 and OpenCV 4.11).

# Only fatal messages: what goes wrong is told by our own errors, with the file and the remedy.
pycolmap.logging.minloglevel = 3


def matrix_of(rigid: Any) -> np.ndarray:
    """A pycolmap.Rigid3d as a transform (4, 4)."""
    matrix = np.asarray(rigid.matrix())
    return transforms.rigid(matrix[:, :3], matrix[:, 3])


FreeIntrinsic = Literal["focal", "radial", "both"]


def bundle_adjuster(
    model: Any,
    images: Iterable[int] | None = None,
    free: FreeIntrinsic | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-6,
) -> Any:
    """Adjusts a model with a loss that forgives wrong matches; two cameras hold the gauge.
    On one thread, so that results repeat; of the intrinsics the focal length, distortion or both
    may be free."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = free in ("focal", "both")
    options.refine_extra_params = free in ("radial", "both")
    options.refine_principal_point = False
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = 1.0
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = max_iterations
    options.ceres.solver_options.function_tolerance = tolerance
    problem = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids() if images is None else images):
        problem.add_image(image_id)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # Not `pycolmap.bundle_adjustment`, which turns its log back on.
    return pycolmap.create_default_ceres_bundle_adjuster(options, problem, model)
