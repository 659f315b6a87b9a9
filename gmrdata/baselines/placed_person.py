"""A person placed before the camera, row by row."""

from dataclasses import dataclass, replace

import numpy as np

from gmrdata.baselines.clip_keypoints import ClipKeypoints
from gmrdata.baselines.placement import PlacementConfig, place, used_joints
from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_joints_m
from gmrdata.clip import Clip
from gmrdata.geometry.camera import project_cam

NO_POSE = "no pose"
NOT_TOLD = "too few joints detected, or none of them before the camera"


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a person is over T rows."""

    pelvis_m: np.ndarray
    """(T, 3) in the camera's frame [m]; NaN where it is not known."""
    missing: tuple[str, ...]
    """(T,) why it is not known; empty where it is."""
    residual_px: float | None
    """Median distance of the joints from their keypoints; None where no row is known [px]."""


def place_person(
    posed: Clip,
    found: ClipKeypoints,
    intrinsics_px: np.ndarray,
    body: BodyModel,
    config: PlacementConfig,
) -> Placed:
    """Place a person in each row that has a pose and enough keypoints; the others stay unknown.

    Args:
        posed: The person in the camera's frame, but for the translation.
        found: The keypoints of the same rows.
        intrinsics_px: (3, 3) calibration matrix [px].
        body: The person's body.
        config: The recipe.
    """
    joints_m, has_pose = _posed_joints(posed, body)
    pelvis_m = np.full((len(joints_m), 3), np.nan)
    missing, residuals_px = list(found.missing), []
    previous_m: np.ndarray | None = None
    for row, points in enumerate(found.points):
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
    return Placed(pelvis_m, tuple(missing), median_px)


def _posed_joints(posed: Clip, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """Joints from the pelvis in the camera's axes (T, 24, 3) [m], and (T,) rows that have them."""
    at_origin = replace(posed.motion, pelvis_m=np.zeros((posed.motion.n_frames, 3)))
    joints_m = motion_joints_m(body, at_origin)
    has_pose = posed.valid & np.isfinite(joints_m).all(axis=(1, 2))
    return joints_m, has_pose & np.isfinite(posed.motion.local_rotmats).all(axis=(1, 2, 3))
