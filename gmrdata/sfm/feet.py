"""Points of the feet that touch the ground, and when they stand still."""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.subset import with_vertices
from gmrdata.body.tree import JOINT
from gmrdata.motion.motion import Motion

SIDES = ("left", "right")
POINT_NAMES = ("ankle", "foot", "heel", "ball", "toe")
SOLE_POINTS = slice(2, 5)
"""Heel, ball and toe: the points that lie on the sole."""
SOLE_THICKNESS_M = 0.02
"""Rest vertices this close above the lowest one of a foot belong to its sole [m]."""


def foot_points_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """Points of both feet, in the motion's frame of reference.

    Args:
        body: The motion's body.
        motion: T frames.

    Returns:
        (T, 2, 5, 3) [m]: left and right; ankle joint, foot joint (ball of the foot), and the
        sole's heel, ball and toe vertices.
    """
    from gmrdata.body.skin import motion_joints_m, motion_vertices_m

    joints_m = motion_joints_m(body, motion)
    sole = np.array([_sole_vertices(body, motion.shape, side) for side in SIDES])
    vertices_m = motion_vertices_m(with_vertices(body, sole.ravel()), motion)
    points = []
    for s, side in enumerate(SIDES):
        inner = joints_m[:, [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]]
        points.append(np.concatenate([inner, vertices_m[:, 3 * s : 3 * s + 3]], axis=1))
    return np.stack(points, axis=1)


def standing(points_world_m: np.ndarray, slip_m: float) -> np.ndarray:
    """Which points stand still.

    Args:
        points_world_m: (T, ..., 3) points [m]; NaN where unknown.
        slip_m: Distance between neighbouring frames up to which a point counts as still [m].

    Returns:
        (T, ...) bool: the point moved less to the next frame, or since the one before.
    """
    still = np.linalg.norm(np.diff(points_world_m, axis=0), axis=-1) < slip_m
    result = np.zeros(points_world_m.shape[:-1], dtype=bool)
    result[1:] |= still
    result[:-1] |= still
    return result


def _sole_vertices(body: BodyModel, shape: np.ndarray, side: str) -> list[int]:
    """Indices of a foot's heel, ball and toe on the sole, in the rest pose."""
    ankle, foot = JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]
    rest_m = body.template_m + body.shape_dirs_m @ np.asarray(shape, dtype=np.float64)
    of_foot = np.flatnonzero(body.skin_weights[:, [ankle, foot]].sum(axis=1) > 0.5)
    height_m = rest_m[of_foot, 1]
    sole = of_foot[height_m < height_m.min() + SOLE_THICKNESS_M]
    forward_m = rest_m[sole, 2]
    ball_m = body.rest_joints_m(shape)[foot]
    nearest = np.linalg.norm(rest_m[sole][:, [0, 2]] - ball_m[[0, 2]], axis=1).argmin()
    return [int(sole[forward_m.argmin()]), int(sole[nearest]), int(sole[forward_m.argmax()])]
