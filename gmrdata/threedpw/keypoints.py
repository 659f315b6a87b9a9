"""2D keypoints in OpenPose's COCO order, as a detector would see the 24 joints of a body."""

import numpy as np

from gmrdata.body.tree import JOINT, N_JOINTS
from gmrdata.config import Config
from gmrdata.geometry.camera import CameraPath, project_cam
from gmrdata.geometry.transforms import apply, invert
from gmrdata.threedpw.arrays import N_KEYPOINTS

OPENPOSE_JOINTS = {
    1: JOINT["neck"],
    2: JOINT["right_shoulder"], 3: JOINT["right_elbow"], 4: JOINT["right_wrist"],
    5: JOINT["left_shoulder"], 6: JOINT["left_elbow"], 7: JOINT["left_wrist"],
    8: JOINT["right_hip"], 9: JOINT["right_knee"], 10: JOINT["right_ankle"],
    11: JOINT["left_hip"], 12: JOINT["left_knee"], 13: JOINT["left_ankle"],
}  # fmt: skip
"""OpenPose's COCO keypoint -> SMPL joint.  Nose, eyes and ears (0, 14-17) are no SMPL joints."""

FEWEST_JOINTS = 6
"""With fewer joints 3DPW gives no keypoints at all."""


class KeypointConfig(Config):
    """How well the joints are detected."""

    noise_px: float = 2.0
    """Standard deviation of x and of y [px]."""
    confidence: tuple[float, float] = (0.6, 0.95)
    """Confidence of a joint that is seen is drawn from this range; 3DPW's are like that."""


def detected_keypoints(
    joints_world_m: np.ndarray, camera: CameraPath, config: KeypointConfig, rng: np.random.Generator
) -> np.ndarray:
    """Keypoints of a person: joints inside the image with noise, all others zero.

    Occlusion is not looked at: OpenPose guesses hidden joints too.

    Args:
        joints_world_m: (N, 24, 3) joints in the world [m].
        camera: The camera of the same N frames.
        config: How well joints are detected.
        rng: Source of noise and confidence.

    Returns:
        (N, 18, 3): x [px], y [px], confidence.

    Raises:
        ValueError: not 24 joints, or as many frames as the camera has.
    """
    if joints_world_m.shape != (camera.n_frames, N_JOINTS, 3):
        raise ValueError(f"joints {joints_world_m.shape} for {camera.n_frames} cameras")
    rows = list(OPENPOSE_JOINTS)
    joints_m = joints_world_m[:, list(OPENPOSE_JOINTS.values())]
    points_px = project_cam(apply(invert(camera.world_from_cam), joints_m), camera.intrinsics_px)
    points_px = points_px + rng.normal(0.0, config.noise_px, points_px.shape)
    confidence = rng.uniform(*config.confidence, points_px.shape[:2])
    seen = ((points_px >= 0) & (points_px < (camera.width_px, camera.height_px))).all(axis=-1)
    seen &= (seen.sum(axis=1) >= FEWEST_JOINTS)[:, None]
    keypoints = np.zeros((camera.n_frames, N_KEYPOINTS, 3))
    keypoints[:, rows, :2] = np.where(seen[..., None], points_px, 0.0)
    keypoints[:, rows, 2] = np.where(seen, confidence, 0.0)
    return keypoints
