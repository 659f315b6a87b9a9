"""pycolmap, imported in the one order that works, and silent; what its callers share."""

from collections.abc import Iterable
from typing import Any, Literal

import cv2  # noqa: F401
import numpy as np
import pycolmap as pycolmap

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.stage.workers import give_sigterm_back
from gmrdata.values import limits, transforms
from gmrdata.values.camera import project_cam

# OpenCV first: with pycolmap loaded before it, cv2.imwrite of a PNG aborts the process, because
# both wheels carry their own libpng (seen with pycolmap 4.2.1 and OpenCV 4.11).

MIN_PARALLAX_DEG = 0.1  # points with less hardly have a depth; COLMAP's 1 empties slow sequences
TRACKS_PER_FRAME = 100  # by which the global mapper places a frame where it doesn't take all
ROUGH = 1e-4  # share of the cost at which adjustments end that others follow
LOSS_PX = 1.0  # scale of the Cauchy loss: an error of it counts half as much as by least squares
LEAST_NOISE_PX = 0.05  # image points are never taken to be better

# Only fatal messages: what goes wrong is told by our own errors, with the file and the remedy.
pycolmap.logging.minloglevel = 3
give_sigterm_back()


def matrix_of(rigid: Any) -> np.ndarray:
    """A pycolmap.Rigid3d as a transform (4, 4)."""
    matrix = np.asarray(rigid.matrix())
    return transforms.rigid(matrix[:, :3], matrix[:, 3])


def project_into(image: Any, points: np.ndarray) -> np.ndarray:
    """Image points (N, 2) [px]; NaN behind the camera."""
    points_cam = transforms.apply(matrix_of(image.cam_from_world()), points)
    return project_cam(points_cam, np.asarray(image.camera.calibration_matrix()))


def camera_of(image: Any) -> np.ndarray:
    """world_from_cam (4, 4) of an image of a model."""
    return transforms.invert(matrix_of(image.cam_from_world()))


def seen_by(model: Any, image: Any) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Features of an image that show points, their places (N, 2) [px], and the points (N, 3)."""
    features = [n for n, spot in enumerate(image.points2D) if spot.has_point3D()]
    spots = [image.point2D(n) for n in features]
    points = np.array([model.point3D(spot.point3D_id).xyz for spot in spots]).reshape(-1, 3)
    return features, np.array([spot.xy for spot in spots]).reshape(-1, 2), points


def observations_of(image: Any) -> np.ndarray:
    """(N, 2) int64: the features of an image that show points, and the ids of these."""
    features = image.get_observation_point2D_idxs()
    pairs = [(feature, image.point2D(feature).point3D_id) for feature in features]
    return np.array(pairs, np.int64).reshape(-1, 2)


def add_bare_image(model: Any, image: Any) -> None:
    """Give a model the image of another one, where that has it, without points."""
    points_px = np.array([spot.xy for spot in image.points2D]).reshape(-1, 2)
    bare = pycolmap.Image(image.name, points_px, image.camera_id, image.image_id)
    model.add_image_with_trivial_frame(bare, image.cam_from_world())


def global_options(config: SfmConfig, *, free_lens: bool) -> Any:
    """Options of COLMAP's global mapper, which repeats its results; the lens may be free."""
    options = _repeating(pycolmap.GlobalPipelineOptions(), config)
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = adjustment.refine_extra_params = free_lens
    adjustment.ceres.use_gpu = options.mapper.global_positioning.use_gpu = False
    return options


def incremental_options(config: SfmConfig, *, free_lens: bool) -> Any:
    """The same of the incremental mapper."""
    options = _repeating(pycolmap.IncrementalPipelineOptions(), config)
    options.ba_refine_focal_length = options.ba_refine_extra_params = free_lens
    options.mapper.abs_pose_refine_focal_length = free_lens
    options.mapper.abs_pose_refine_extra_params = free_lens
    options.extract_colors = False
    return options


def _repeating(options: Any, config: SfmConfig) -> Any:
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = config.seed
    options.min_num_matches = config.min_pair_inliers
    return options


FreeIntrinsic = Literal["focal", "radial", "both"]


def bundle_adjuster(
    model: Any,
    images: Iterable[int] | None = None,
    free: FreeIntrinsic | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-6,
    loss_px: float = LOSS_PX,
) -> Any:
    """Adjusts a model with a loss that forgives wrong matches; two cameras hold the gauge.
    On one thread, so that results repeat; of the intrinsics the focal length, distortion or both
    may be free."""
    options = _adjustment_options(max_iterations, loss_px)
    options.refine_focal_length = free in ("focal", "both")
    options.refine_extra_params = free in ("radial", "both")
    options.ceres.solver_options.function_tolerance = tolerance
    problem = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids() if images is None else images):
        problem.add_image(image_id)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # Not `pycolmap.bundle_adjustment`, which turns its log back on.
    return pycolmap.create_default_ceres_bundle_adjuster(options, problem, model)


def camera_adjuster(model: Any, image_id: int, max_iterations: int) -> Any:
    """Adjusts one camera and the points that it sees; the other cameras that see them hold both."""
    problem = pycolmap.BundleAdjustmentConfig()
    problem.add_image(image_id)
    for spot in model.image(image_id).points2D:
        if spot.has_point3D():
            problem.add_variable_point(spot.point3D_id)
    options = _adjustment_options(max_iterations, LOSS_PX)
    return pycolmap.create_default_ceres_bundle_adjuster(options, problem, model)


def _adjustment_options(max_iterations: int, loss_px: float) -> Any:
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = False
    options.refine_principal_point = False
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = loss_px
    # Else a path of over a thousand keyframes is adjusted by conjugate gradients, which hardly
    # bend it as a whole.
    options.ceres.max_num_images_direct_sparse_cpu_solver = limits.MOST_FRAMES
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = max_iterations
    return options
