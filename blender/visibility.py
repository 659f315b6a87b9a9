# SPDX-License-Identifier: GPL-3.0-or-later
"""Which joints the camera sees.

A joint lies inside the body, so what can be seen is the skin round it.  A ray goes from the camera
to the joint.  The joint counts as visible when the ray arrives unhindered, or when what it meets
first is skin of the person that is near the joint (`SKIN_WITHIN_M`) and moves with the joint or
with one at most `STEPS` bones away.  So a hand in front of the chest hides the chest's joint even
when it is near, a forearm doesn't hide its own wrist, and a wall hides whatever is behind it.
"""

from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from blender.people.actors import Actor
from gmrdata.values.body import N_JOINTS, PARENTS

SKIN_WITHIN_M = 0.20
"""Farther than from the pelvis to the skin of the hip."""
STEPS = 2


def visible_joints(
    scene: Any, person: Actor, joints_m: np.ndarray, centres_m: np.ndarray
) -> np.ndarray:
    """Whether nothing hides a joint, for joints inside the frame or not.

    Args:
        scene: The bpy scene.
        person: The person, with the joint of each face.
        joints_m: (T, 24, 3) its joints, world frame.
        centres_m: (T, 3) the camera's places, world frame.

    Returns:
        (T, 24) bool.
    """
    if person.joint_of_face is None:
        raise ValueError(f"{person.name} has no joints")
    related = _bones_between() <= STEPS
    visible = np.zeros(joints_m.shape[:2], dtype=bool)
    for row in range(len(joints_m)):
        scene.frame_set(row)
        graph = bpy.context.evaluated_depsgraph_get()
        origin = Vector(centres_m[row])
        for joint in range(N_JOINTS):
            to_joint = Vector(joints_m[row, joint]) - origin
            hit, place, _, face, thing, _ = scene.ray_cast(
                graph, origin, to_joint.normalized(), distance=to_joint.length
            )
            if not hit:
                visible[row, joint] = True
            elif thing.name == person.name:
                left_m = (origin + to_joint - place).length
                part = person.joint_of_face[face]
                visible[row, joint] = bool(related[joint, part]) and left_m <= SKIN_WITHIN_M
    return visible


def _bones_between() -> np.ndarray:
    """(24, 24) number of bones on the way from one joint to another."""
    bones = np.full((N_JOINTS, N_JOINTS), N_JOINTS)
    np.fill_diagonal(bones, 0)
    for joint in range(1, N_JOINTS):  # parents come first
        parent = PARENTS[joint]
        bones[joint, :joint] = bones[:joint, joint] = bones[parent, :joint] + 1
    return bones
