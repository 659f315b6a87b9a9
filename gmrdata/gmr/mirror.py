"""Left and right exchanged: the mirror augmentation.

A motion is reflected in a vertical plane of the world, x -> -x, and each joint takes over from its
counterpart on the other side.  In the body's frame, x to its left, that is the same reflection
M = diag(-1, 1, 1): a local rotation R becomes M R M, and of the motion between frames dR becomes
M dR M and dT becomes M dT.  The mirrored body is exactly the body's mirror image where its two
sides are alike.
"""

from dataclasses import replace

import numpy as np

from gmrdata.body.tree import MIRRORED
from gmrdata.errors import BadMotionFile
from gmrdata.motion.motion import Motion

AXES = np.array([-1.0, 1.0, 1.0])
"""Diagonal of the reflection M, in the world and in the body's frame."""

_SIGNS = np.outer(AXES, AXES)
"""M R M multiplies each entry of R by one of these."""

_LOCAL = np.array(MIRRORED[1:]) - 1
"""Row of the counterpart among the 23 local rotations."""


def mirror_motion(motion: Motion) -> Motion:
    """The motion with left and right exchanged, in the world.

    Raises:
        BadMotionFile: the motion is in the camera's frame, whose image would be mirrored too.
    """
    if motion.frame != "world":
        raise BadMotionFile(
            f"{motion.source}: only motions in the world can be mirrored. Give such a motion"
        )
    return replace(
        motion,
        local_rotmats=mirror_local(motion.local_rotmats),
        root_rotmats=mirror_rotmats(motion.root_rotmats),
        pelvis_m=mirror_points_m(motion.pelvis_m),
        source=f"{motion.source}, mirrored",
    )


def mirror_local(local_rotmats: np.ndarray) -> np.ndarray:
    """Local rotations of the mirrored pose: (..., 23, 3, 3) -> (..., 23, 3, 3)."""
    return mirror_rotmats(local_rotmats[..., _LOCAL, :, :])


def mirror_rotmats(rotmats: np.ndarray) -> np.ndarray:
    """M R M, for a root or a motion between frames: (..., 3, 3) -> (..., 3, 3)."""
    return rotmats * _SIGNS.astype(rotmats.dtype)


def mirror_points_m(points_m: np.ndarray) -> np.ndarray:
    """M p, for a pelvis or a motion between frames: (..., 3) -> (..., 3) [m]."""
    return points_m * AXES.astype(points_m.dtype)
