"""Where up is in a predicted world, and its floor.

GMR predicts motion between frames and knows no gravity.  But a foot that stands still stands flat,
nearly always: in the frames in which its ankle and its toe joint hardly move, the direction that
points out of the foot's upper side in the rest pose points up.  The geometric median of those
directions (Weiszfeld 1937) is taken as up, so a few feet on their toes do not matter.  A motion in
which no foot stands (swimming, lying) keeps the world in which the pelvis is upright in the first
frame.  Last, standing soles are put on z = 0 (`gmrdata.motion.ground`).
"""

from dataclasses import replace

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_joints_m
from gmrdata.body.tree import JOINT, PARENTS
from gmrdata.motion.feet import PLANTED_M_PER_S, SHORTEST_STAND_S
from gmrdata.motion.ground import put_on_floor
from gmrdata.motion.motion import Motion
from gmrdata.motion.rest_pose import minimal_rotation
from gmrdata.motion.skeleton import global_rotmats

UP = np.array([0.0, 0.0, 1.0])
SHORTEST_UP = 0.5
"""Standing feet that point everywhere have a median near zero, which is no direction."""
_UP_IN_REST = np.array([0.0, 1.0, 0.0])


def stand(motion: Motion, body: BodyModel) -> Motion:
    """The same motion in a z-up world with the floor at z = 0, as its feet show them.

    The person starts above the origin.

    Args:
        motion: At least two frames, in any world.
        body: Its body.
    """
    up = up_of_standing_feet(motion, body)
    level_from_world = np.eye(3) if up is None else minimal_rotation(up, UP)
    root_rotmats = level_from_world @ motion.root_rotmats
    pelvis_m = motion.pelvis_m @ level_from_world.T
    rotmats = np.concatenate([root_rotmats[:, None], motion.local_rotmats], axis=1)
    root_rotmats, pelvis_m, _ = put_on_floor(body, motion.shape, rotmats, pelvis_m, motion.fps_hz)
    how = (
        "no foot stands still; up from the first pelvis" if up is None else "up from standing feet"
    )
    return replace(
        motion,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m - [*pelvis_m[0, :2], 0.0],
        source=f"{motion.source}; {how}",
    )


def up_of_standing_feet(motion: Motion, body: BodyModel) -> np.ndarray | None:
    """The direction (3,) that standing feet show as up, or None where none stands for 0.1 s."""
    rotmats = np.concatenate([motion.root_rotmats[:, None], motion.local_rotmats], axis=1)
    world_from_joint = global_rotmats(PARENTS, rotmats)
    joints_m = motion_joints_m(body, motion)
    ups = []
    for side in ("left", "right"):
        ankle, toe = JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]
        speeds = np.linalg.norm(np.gradient(joints_m[:, [ankle, toe]], axis=0), axis=-1)
        still = (speeds * motion.fps_hz < PLANTED_M_PER_S).all(axis=1)
        ups.append(world_from_joint[still, ankle] @ _UP_IN_REST)
    found = np.concatenate(ups)
    if len(found) < max(1.0, SHORTEST_STAND_S * motion.fps_hz):
        return None
    up = _geometric_median(found)
    length = np.linalg.norm(up)
    return np.asarray(up / length) if length > SHORTEST_UP else None


def _geometric_median(points: np.ndarray) -> np.ndarray:
    """The point (3,) with the least sum of distances to points (N, 3)."""
    middle = points.mean(axis=0)
    for _ in range(50):
        weights = 1.0 / np.maximum(np.linalg.norm(points - middle, axis=1), 1e-3)
        middle = weights @ points / weights.sum()
    return np.asarray(middle)
