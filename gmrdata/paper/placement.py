"""Where a posed person stands before a camera, from 2D joints: one frame at a time.

The closed form is the global alignment of DeepCap (Habermann et al. 2020): the translation that
brings the 3D joints nearest to the rays of their 2D joints, weighted by confidence.  From there, or
from the frame before, Gauss-Newton steps minimise the reprojection error itself, robustly.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.read.openpose import keypoint_files, read_people
from gmrdata.values.body import N_JOINTS, BodyModel
from gmrdata.values.camera import CameraPath, project_cam
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadKeypoints
from gmrdata.values.records import Config
from gmrdata.values.skinning import motion_joints_m

NEAREST_M = 0.1  # joints nearer to the camera's plane than this can't be in the picture [m]
BEYOND_IMAGE_SHARE = 0.1
"""How far outside the image a detector may put a joint, as a share of the larger side."""
SAME_SHAPE = 0.02  # by how much the ratio of the sides may differ where images were made smaller


@dataclass(frozen=True, eq=False)
class ClipKeypoints:
    """2D joints of one person over a clip's T rows."""

    points: np.ndarray
    """(T, 24, 3) x [px], y [px], confidence of SMPL's joints; zero where there is none."""
    missing: tuple[str, ...]  # (T,) why a row has nothing; empty where it has
    n_crowded: int  # rows in which one of several people was chosen


def clip_keypoints(
    clip: Clip,
    folder: Path,
    *,
    person_id: int | None = None,
    image_size_px: tuple[int, int] | None = None,
) -> ClipKeypoints:
    """Read the keypoints of a clip's images, in `folder`'s JSON files of the images' numbers.

    Of several people in a frame, the one with STAF's track `person_id` is taken; without that, the
    one whose joints have the highest sum of confidences, frame by frame.  `image_size_px` are width
    and height of the images that the detector was given; None for those of the clip's camera.
    """
    camera = camera_of(clip)
    files = keypoint_files(folder)
    points = np.zeros((clip.motion.n_frames, N_JOINTS, 3))
    missing, n_crowded = [], 0
    for row, number in enumerate(clip.image_numbers.tolist()):
        if number not in files:
            missing.append("no keypoint file" if number >= 0 else "no image")
            continue
        people = read_people(files[number])
        wanted = [one for one in people if person_id is None or one.id == person_id]
        person = max(wanted, key=lambda one: one.confidence, default=None)
        if person is None:
            missing.append("nobody detected" if not people else f"no person {person_id} detected")
            continue
        points[row] = person.keypoints
        n_crowded += len(people) > 1
        missing.append("")
    if all(missing):
        raise BadKeypoints(_nothing(clip, folder, sorted(files), missing))
    points[..., :2] *= _factors(folder, camera, image_size_px)
    _check_in_image(points, camera, folder)
    return ClipKeypoints(points, tuple(missing), n_crowded)


def _nothing(clip: Clip, folder: Path, numbers: list[int], missing: list[str]) -> str:
    """Why no row has keypoints, and what to do."""
    detected_in = [why for why in missing if why not in ("no keypoint file", "no image")]
    if detected_in:
        return f"{folder}: {detected_in[0]} in any image of clip {clip.id}. Look at the detections"
    images = clip.image_numbers[clip.image_numbers >= 0]
    has = f"images {images.min()} to {images.max()}" if len(images) else "no images"
    return (
        f"{folder}: holds frames {numbers[0]} to {numbers[-1]}, but clip {clip.id} has {has}."
        " Name the files by the images' numbers"
    )


def _factors(
    folder: Path, camera: CameraPath, image_size_px: tuple[int, int] | None
) -> np.ndarray | float:
    """What the points are multiplied by to be those of the camera's images: (2,)."""
    if image_size_px is None:
        return 1.0
    factors = np.array([camera.width_px, camera.height_px]) / image_size_px
    if abs(factors[0] / factors[1] - 1) > SAME_SHAPE:
        raise BadKeypoints(
            f"{folder}: images of {image_size_px[0]}x{image_size_px[1]} px are of another shape"
            f" than the camera's {camera.width_px}x{camera.height_px}. Give uncropped images"
        )
    return factors


def _check_in_image(points: np.ndarray, camera: CameraPath, folder: Path) -> None:
    """Refuse points outside the camera's images; those of smaller images can't be told apart."""
    seen_px = points[points[..., 2] > 0][:, :2]
    if not len(seen_px):
        return
    if np.abs(seen_px).max() <= 1:
        remedy = "Run OpenPose with --keypoint_scale 0"
        raise BadKeypoints(f"{folder}: points are shares of the image, not pixels. {remedy}")
    size_px = np.array([camera.width_px, camera.height_px])
    margin_px = BEYOND_IMAGE_SHARE * size_px.max()
    if ((seen_px < -margin_px) | (seen_px > size_px + margin_px)).any():
        low, high = seen_px.min(axis=0), seen_px.max(axis=0)
        raise BadKeypoints(
            f"{folder}: points from ({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f})"
            f" px are not of the camera's images of {size_px[0]}x{size_px[1]} px. Say with"
            " image_size_px which size the detector was given"
        )


class PlacementConfig(Config):
    """How a person is placed before the camera."""

    min_confidence: float = Field(default=0.3, ge=0.0)
    """Joints with less confidence are not looked at."""
    min_joints: int = Field(default=6, ge=2)
    """A frame with fewer joints is not valid; two would do for exact ones."""
    robust_px: float = Field(default=10.0, gt=0.0)
    """Error beyond which a joint's weight falls (Huber 1964) [px]."""


@dataclass(frozen=True, eq=False)
class _Reprojection:
    """Joints before a camera, as the pelvis places them, beside their 2D points."""

    joints_m: np.ndarray  # (n, 3) from the pelvis, in the camera's axes [m]
    points_px: np.ndarray  # (n, 2)
    root_weights: np.ndarray  # (n, 1)
    intrinsics_px: np.ndarray  # (3, 3)

    def residuals(self, pelvis_m: np.ndarray) -> np.ndarray:
        image_px = (self.joints_m + pelvis_m) @ self.intrinsics_px.T
        offsets_px = image_px[:, :2] / image_px[:, 2:] - self.points_px
        return np.asarray((offsets_px * self.root_weights).ravel())

    def jacobian(self, pelvis_m: np.ndarray) -> np.ndarray:
        image_px = (self.joints_m + pelvis_m) @ self.intrinsics_px.T
        ratios_px = image_px[:, :2] / image_px[:, 2:]
        rows = self.intrinsics_px[:2] - ratios_px[..., None] * self.intrinsics_px[2]
        return np.asarray(
            (rows / image_px[:, 2:, None] * self.root_weights[..., None]).reshape(-1, 3)
        )


def place(
    joints_m: np.ndarray,
    points: np.ndarray,
    intrinsics_px: np.ndarray,
    config: PlacementConfig,
    previous_m: np.ndarray | None = None,
) -> np.ndarray | None:
    """The pelvis in the camera's frame (3,) [m]; None where the joints do not tell.

    Args:
        joints_m: (24, 3) joints from the pelvis, in the camera's axes [m].
        points: (24, 3) x [px], y [px], confidence of the same joints.
        intrinsics_px: (3, 3) calibration matrix [px].
        previous_m: (3,) where the pelvis was in the frame before [m], a second place to start from.
    """
    from scipy.optimize import least_squares

    used = used_joints(points, config)
    if used.sum() < config.min_joints:
        return None
    joints_m, points_px, confidence = joints_m[used], points[used, :2], points[used, 2]
    lowest_m = NEAREST_M - joints_m[:, 2].min()
    starts_m = [closed_form(joints_m, points_px, confidence, intrinsics_px), previous_m]
    in_front = [start for start in starts_m if start is not None and start[2] > lowest_m]
    if not in_front:
        return None
    seen = _Reprojection(joints_m, points_px, np.sqrt(confidence)[:, None], intrinsics_px)
    solution = least_squares(
        seen.residuals,
        min(in_front, key=lambda start: _huber(seen.residuals(start), config.robust_px)),
        jac=seen.jacobian,
        bounds=([-np.inf, -np.inf, lowest_m], np.inf),
        x_scale="jac",
        loss="huber",
        f_scale=config.robust_px,
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-12,
    )
    at_the_camera = solution.active_mask[2] != 0
    return None if at_the_camera or not solution.success else np.asarray(solution.x)


def used_joints(points: np.ndarray, config: PlacementConfig) -> np.ndarray:
    """Which joints (24, 3) x [px], y [px], confidence are looked at: (24,) bool."""
    return np.asarray((points[:, 2] >= config.min_confidence) & (points[:, 2] > 0))


def closed_form(
    joints_m: np.ndarray, points_px: np.ndarray, confidence: np.ndarray, intrinsics_px: np.ndarray
) -> np.ndarray | None:
    """The translation (3,) that brings joints nearest to their rays [m]; None for parallel rays.

    Joints (n, 3) from the pelvis, in the camera's axes [m], are at image points (n, 2) with weights
    (n,).
    """
    homogeneous = np.concatenate([points_px, np.ones((len(points_px), 1))], axis=1)
    rays = np.linalg.solve(intrinsics_px, homogeneous.T).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    # What is left of a vector across each ray.
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    left = np.einsum("n,nij->ij", confidence, across)
    right = -np.einsum("n,nij,nj->i", confidence, across, joints_m)
    if np.linalg.cond(left) > 1e12:
        return None
    return np.asarray(np.linalg.solve(left, right))


def _huber(residuals_px: np.ndarray, robust_px: float) -> float:
    """What `least_squares` minimises with this loss, but for a factor."""
    sizes = np.abs(residuals_px / robust_px)
    return float(np.where(sizes <= 1, sizes**2, 2 * sizes - 1).sum())


NO_POSE = "no pose"
NOT_TOLD = "too few joints detected, or none of them before the camera"


@dataclass(frozen=True, eq=False)
class PlacedPerson:
    """Where a person is over T rows."""

    pelvis_m: np.ndarray  # (T, 3) in the camera's frame [m]; NaN where it is not known
    missing: tuple[str, ...]  # (T,) why it is not known; empty where it is
    residual_px: float | None
    """Median distance of the joints from their keypoints; None where no row is known [px]."""


def place_person(
    posed: Clip,
    keypoints: ClipKeypoints,
    intrinsics_px: np.ndarray,
    body: BodyModel,
    config: PlacementConfig,
) -> PlacedPerson:
    """Place a person in each row that has a pose (translation aside) and enough keypoints."""
    at_origin = replace(posed.motion, pelvis_m=np.zeros((posed.motion.n_frames, 3)))
    joints_m = motion_joints_m(body, at_origin)  # in the camera's axes
    has_pose = posed.valid & np.isfinite(joints_m).all(axis=(1, 2))
    has_pose &= np.isfinite(posed.motion.local_rotmats).all(axis=(1, 2, 3))
    pelvis_m = np.full((len(joints_m), 3), np.nan)
    missing, residuals_px = list(keypoints.missing), []
    previous_m: np.ndarray | None = None
    for row, points in enumerate(keypoints.points):
        if not missing[row] and not has_pose[row]:
            missing[row] = NO_POSE
        if missing[row]:
            previous_m = None
            continue
        previous_m = place(joints_m[row], points, intrinsics_px, config, previous_m)
        if previous_m is None:
            missing[row] = NOT_TOLD
            continue
        pelvis_m[row] = previous_m
        used = used_joints(points, config)
        image_px = project_cam(joints_m[row, used] + previous_m, intrinsics_px)
        residuals_px.append(np.linalg.norm(image_px - points[used, :2], axis=1))
    median_px = float(np.median(np.concatenate(residuals_px))) if residuals_px else None
    return PlacedPerson(pelvis_m, tuple(missing), median_px)
