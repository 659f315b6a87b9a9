# SPDX-License-Identifier: GPL-3.0-or-later
"""How a motion of the 24 joints turns, sizes and places a character's own skeleton.

The definition is that of `gmrdata.motion.retarget`, read backwards.  With H_j the global rotation
of the body's joint away from the body's T-pose, A the turn from rest axes (x left, y up, z front)
to the character's own, and C_j the constant rotation that takes the body's rest pose to the
character's at that joint, the character's bone is turned away from its rest by

    D_j = H_j C_j^T A^T

so that thighs, shanks, upper arms and forearms point where the body's point, an A-pose or not, and
flat feet stay flat.  Hands and fingers stay to the forearm as they are at rest in both.  Pelvis,
spine, collars, neck and head turn as the body's do, each keeping its own posture at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmrdata.motion.ground import FOOT_JOINTS, foot_corrections
from gmrdata.motion.rest_pose import (
    LIMBS,
    LONGEST_LEG_M,
    SHORTEST_LEG_M,
    limb_corrections,
    source_from_rest_axes,
    stands,
)
from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS, BodyModel, leg_length_m
from gmrdata.values.errors import BadCharacter
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import global_rotmats
from gmrdata.values.transforms import quaternions_from_rotmats

HIPS = (JOINT["left_hip"], JOINT["right_hip"])
SHORTEST_LIMB_SHARE = 0.05
"""Of the leg's length: a shorter limb has no direction."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """A character at rest, in the world of its file (z up, any unit)."""

    joints: np.ndarray
    """(24, 3) its joints; NaN where it has no bone."""
    toe_tips: np.ndarray
    """(2, 3) left and right toe tip from the toe joint; NaN where unknown."""
    feet: np.ndarray
    """(N, 3) vertices that move with its ankles and toes, shoes and all."""


@dataclass(frozen=True)
class Size:
    """By how much a character is enlarged, and how high its hips go."""

    scale: float
    """Metres per unit of the file's world."""
    leg_ratio: float
    """Its legs' length over the body's, after scaling."""
    ankle_m: float
    """Height of its ankles over its soles at rest, after scaling."""
    body_ankle_m: float
    """The same of the body."""


def check_rest(rest: RestPose, keep_size: bool, name: str) -> np.ndarray:
    """See that a rest pose is a standing person; gives (3, 3) file_from_rest_axes.

    Raises:
        BadCharacter: it isn't, or it has not human size and the size is to be kept.
    """
    leg = leg_length_m(rest.joints)
    for start, end in LIMBS:
        if not np.linalg.norm(rest.joints[end] - rest.joints[start]) > SHORTEST_LIMB_SHARE * leg:
            raise BadCharacter(
                f"{name}: the bones of {JOINT_NAMES[start]} and {JOINT_NAMES[end]} start at the "
                "same place; give a joint_map that names other bones"
            )
    if keep_size and not SHORTEST_LEG_M <= leg <= LONGEST_LEG_M:
        raise BadCharacter(
            f"{name}: its legs are {leg:.4g} m long, which nobody's are; "
            "let it be scaled (scale: legs), or export it in metres"
        )
    if not stands(rest.joints):
        raise BadCharacter(
            f"{name}: at rest it is not a person standing along the axes (hips sideways, legs "
            "below, trunk above); export it in a T-pose or A-pose, turned to the front"
        )
    return source_from_rest_axes(rest.joints)


def joint_turns(
    rest: RestPose, file_from_rest: np.ndarray, body: BodyModel, motion: Motion
) -> np.ndarray:
    """D of each joint, (T, 24, 3, 3): the turn away from the character's rest, in the world.

    Args:
        rest: The character at rest.
        file_from_rest: (3, 3) from `check_rest`.
        body: The body.
        motion: Its motion, world frame.
    """
    corrections = _corrections(rest, file_from_rest, body.rest_joints_m(motion.shape))
    local = motion.rotmats
    turns = global_rotmats(PARENTS, local)
    for joint, correction in corrections.items():
        turns[:, joint] = turns[:, joint] @ correction.T
    return np.asarray(turns @ file_from_rest.T)


def _corrections(
    rest: RestPose, file_from_rest: np.ndarray, body_rest_m: np.ndarray
) -> dict[int, np.ndarray]:
    """C of all joints that have one."""
    joints = rest.joints @ file_from_rest
    limbs = limb_corrections(joints, body_rest_m)
    # No frames to learn the pitch of flat feet from: a character stands flat at rest.
    feet, _ = foot_corrections(joints, rest.toe_tips @ file_from_rest, body_rest_m, {}, {}, 1.0)
    return limbs | feet


def bone_rotations(
    turns: np.ndarray,
    joints: Sequence[int],
    parents: Sequence[int],
    armature_from_bone: np.ndarray,
    world_from_armature: np.ndarray,
) -> dict[int, np.ndarray]:
    """What Blender's pose bones have to be turned by, each in its own rest axes.

    Args:
        turns: (T, 24, 3, 3) from `joint_turns`.
        joints: (B,) the joint that each bone moves with; bones of one joint move as one.
        parents: (B,) parent of each bone, -1 for none.
        armature_from_bone: (B, 4, 4) bones at rest.
        world_from_armature: (4, 4) the armature's object.

    Returns:
        `{bone: (T, 4) unit quaternions, real part first}` of all bones that turn.
    """
    axes = world_from_armature[:3, :3] / np.cbrt(np.linalg.det(world_from_armature[:3, :3]))
    turns = axes.T @ turns @ axes
    rotations = {}
    for bone, (joint, parent) in enumerate(zip(joints, parents, strict=True)):
        if parent >= 0 and joints[parent] == joint:
            continue
        relative = turns[:, joint]
        if parent >= 0:
            relative = turns[:, joints[parent]].transpose(0, 2, 1) @ relative
        at_rest = armature_from_bone[bone, :3, :3]
        rotations[bone] = quaternions_from_rotmats(at_rest.T @ relative @ at_rest)
    return rotations


def size_of(
    rest: RestPose, file_from_rest: np.ndarray, body: BodyModel, shape: np.ndarray, keep_size: bool
) -> Size:
    """The size of a character beside a body of (S,) shape coefficients."""
    body_joints_m = body.rest_joints_m(shape)
    up = file_from_rest[:, 1]
    legs_m, body_legs_m = leg_length_m(rest.joints), leg_length_m(body_joints_m)
    scale = 1.0 if keep_size else body_legs_m / legs_m
    ankles = [JOINT["left_ankle"], JOINT["right_ankle"]]
    ankle = float(rest.joints[ankles].mean(axis=0) @ up - (rest.feet @ up).min())
    body_vertices_m = body.rest_vertices_m(shape)
    soles_m = body_vertices_m[of_feet(body.skin_weights)][:, 1].min()
    body_ankle_m = float(body_joints_m[ankles, 1].mean() - soles_m)
    return Size(scale, scale * legs_m / body_legs_m, scale * ankle, body_ankle_m)


def of_feet(weights: np.ndarray) -> np.ndarray:
    """(V,) bool: vertices that move with an ankle or the toes; all, if none does. (V, 24) given."""
    feet = np.isin(weights.argmax(axis=1), FOOT_JOINTS)
    return feet if feet.any() else np.ones_like(feet)


def hips_m(size: Size, body_joints_m: np.ndarray) -> np.ndarray:
    """(T, 3) where the middle of the character's hips goes, from the body's joints (T, 24, 3).

    Where the body's is, but as much higher as keeps the soles on the floor when the body's are:
    legs of the same length may end in higher ankles, and longer legs need higher hips.
    """
    middle_m = body_joints_m[:, HIPS].mean(axis=1)
    above_ankle_m = middle_m[:, 2] - size.body_ankle_m
    middle_m[:, 2] = size.leg_ratio * above_ankle_m + size.ankle_m
    return np.asarray(middle_m)
