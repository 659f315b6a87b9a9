"""Eqs. 6-8 of the paper: from the camera's frame to the world's, and back.

The body's translation is the pelvis throughout.  With SMPL's `trans` in its place eq. 8 is wrong
by (R_col,i+1 - R_col,i) J0 per frame: 11.8 mm at 10 fps for a camera that tilts at 30 degrees/s.
"""

from dataclasses import replace

import numpy as np

from gmrdata.geometry import transforms
from gmrdata.motion.motion import Motion


def world_motion(camera_motion: Motion, world_from_cam: np.ndarray, scale: float = 1.0) -> Motion:
    """The person in the world: R_w = R_col R_c and T_w = R_col T_c + s T_col (eqs. 7 and 8).

    Args:
        camera_motion: T frames, `frame` "camera".
        world_from_cam: (T, 4, 4) cameras, metric up to `scale`.
        scale: Metres per unit of the cameras' translations.

    Returns:
        The motion with `frame` "world".

    Raises:
        ValueError: the motion is not in the camera frame, or the frame counts differ.
    """
    _require(camera_motion, "camera", world_from_cam)
    metric = metric_cameras(world_from_cam, scale)
    return replace(
        camera_motion,
        root_rotmats=metric[:, :3, :3] @ camera_motion.root_rotmats,
        pelvis_m=transforms.apply(metric, camera_motion.pelvis_m[:, None])[:, 0],
        frame="world",
    )


def camera_motion(motion: Motion, world_from_cam: np.ndarray) -> Motion:
    """The person as each camera sees it: the inverse of `world_motion` for metric cameras.

    Args:
        motion: T frames, `frame` "world".
        world_from_cam: (T, 4, 4) metric cameras.

    Returns:
        The motion with `frame` "camera".

    Raises:
        ValueError: the motion is not in the world frame, or the frame counts differ.
    """
    _require(motion, "world", world_from_cam)
    cam_from_world = transforms.invert(world_from_cam)
    return replace(
        motion,
        root_rotmats=cam_from_world[:, :3, :3] @ motion.root_rotmats,
        pelvis_m=transforms.apply(cam_from_world, motion.pelvis_m[:, None])[:, 0],
        frame="camera",
    )


def metric_cameras(world_from_cam: np.ndarray, scale: float) -> np.ndarray:
    """Cameras (T, 4, 4) with their centres multiplied by `scale`."""
    return transforms.rigid(world_from_cam[:, :3, :3], scale * world_from_cam[:, :3, 3])


def _require(motion: Motion, frame: str, world_from_cam: np.ndarray) -> None:
    if motion.frame != frame:
        raise ValueError(f"the motion is in the {motion.frame} frame, expected the {frame} frame")
    if len(world_from_cam) != motion.n_frames:
        raise ValueError(f"{motion.n_frames} frames of motion, {len(world_from_cam)} cameras")
