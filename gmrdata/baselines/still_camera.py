"""A moving camera's picture of a person, read as if the camera stood still."""

import numpy as np

from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.transforms import rigid
from gmrdata.motion.motion import Motion
from gmrdata.pseudogt.compose import camera_motion, world_motion

LEVEL_FROM_CAM = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""World of a camera that is held level and looks along +y: x to the right, z up, origin in it."""


def seen_motion(clip: Clip) -> tuple[Motion, np.ndarray]:
    """The person in the frame of the camera at each row, and the (T,) bool rows that have it.

    Raises:
        BadMotionFile: the motion is in the world frame, and the clip has no camera.
    """
    if clip.motion.frame == "camera":
        return clip.motion, clip.valid
    camera = camera_of(clip)
    return camera_motion(clip.motion, camera.world_from_cam), clip.valid & camera.has_camera


def as_if_still(seen: Motion) -> Motion:
    """A motion in the camera's frame taken as one in the world, the camera's motion ignored."""
    return world_motion(seen, np.tile(LEVEL_FROM_CAM, (seen.n_frames, 1, 1)))
