"""Posing a body of another rest pose into SMPL's T-pose, so that one local pose fits both.

SMPL's T-pose: arms level and straight to the sides, palms down, legs straight down, feet forward.
"""

from dataclasses import dataclass

import numpy as np

from gmrdata.body.tree import JOINT, MIRRORED, N_JOINTS, PARENTS

LEFT, UP, FRONT = np.eye(3)
"""The body's own directions in SMPL's axes."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """Rest joints of N shapes of a body whose rest pose is not SMPL's; SMPL's axes, metres."""

    joints_m: np.ndarray
    """(N, 24, 3)."""
    index_knuckles_m: np.ndarray
    """(N, 2, 3) base of the index finger, left and right hand."""
    little_knuckles_m: np.ndarray
    """(N, 2, 3) base of the little finger, left and right hand."""

    def symmetric(self) -> "RestPose":
        """The mean of the body and its mirror image: a rig's own asymmetry is an artefact."""
        flip = np.array([-1.0, 1.0, 1.0])

        def mean(points_m: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
            halved: np.ndarray = (points_m + mirrored * flip) / 2
            return halved

        return RestPose(
            mean(self.joints_m, self.joints_m[:, list(MIRRORED)]),
            mean(self.index_knuckles_m, self.index_knuckles_m[:, ::-1]),
            mean(self.little_knuckles_m, self.little_knuckles_m[:, ::-1]),
        )


def t_posed(
    rest: RestPose, vertices_m: np.ndarray, skin_weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joints and vertices in the T-pose, with the pelvis at the origin.

    Args:
        rest: Rest joints of N shapes.
        vertices_m: (N, V, 3) rest vertices, same axes [m].
        skin_weights: (V, 24).

    Returns:
        (N, 24, 3) joints and (N, V, 3) vertices [m].
    """
    rotmats = t_pose_rotmats(rest)
    joints_m = np.zeros_like(rest.joints_m)
    for joint in range(1, N_JOINTS):
        bone_m = rest.joints_m[:, joint] - rest.joints_m[:, PARENTS[joint]]
        turned_m = np.einsum("nab,nb->na", rotmats[:, PARENTS[joint]], bone_m)
        joints_m[:, joint] = joints_m[:, PARENTS[joint]] + turned_m
    offsets_m = joints_m - np.einsum("njab,njb->nja", rotmats, rest.joints_m)
    posed_m = np.empty_like(vertices_m)
    for n in range(len(vertices_m)):
        blended = np.tensordot(skin_weights, rotmats[n], axes=1)
        posed_m[n] = np.einsum("vab,vb->va", blended, vertices_m[n]) + skin_weights @ offsets_m[n]
    return joints_m, posed_m


def t_pose_rotmats(rest: RestPose) -> np.ndarray:
    """Rotation of each joint's body part from the rest pose to the T-pose, (N, 24, 3, 3).

    The rest pose must have bent elbows and legs that are not vertical already, as an A-pose has.
    """
    rotmats = np.tile(np.eye(3), (len(rest.joints_m), N_JOINTS, 1, 1))
    for side, outward in (("left", LEFT), ("right", -LEFT)):

        def bone(start: str, end: str, side: str = side) -> np.ndarray:
            difference_m: np.ndarray = (
                rest.joints_m[:, JOINT[f"{side}_{end}"]]
                - rest.joints_m[:, JOINT[f"{side}_{start}"]]
            )
            return difference_m

        def turn(joint: str, rotmat: np.ndarray, side: str = side) -> None:
            rotmats[:, JOINT[f"{side}_{joint}"]] = rotmat

        # A straight arm bends at the elbow to the front, which fixes its twist.
        upper_arm, forearm = bone("shoulder", "elbow"), bone("elbow", "wrist")
        hinge, t_hinge = np.cross(upper_arm, forearm), np.cross(outward, FRONT)
        turn("shoulder", _turn_pair(upper_arm, hinge, outward, t_hinge))
        turn("elbow", _turn_pair(forearm, hinge, outward, t_hinge))
        hand = 0 if side == "left" else 1
        across = rest.index_knuckles_m[:, hand] - rest.little_knuckles_m[:, hand]
        for joint in ("wrist", "hand"):
            turn(joint, _turn_pair(bone("wrist", "hand"), across, outward, FRONT))
        turn("hip", _turn_shortest(bone("hip", "knee"), -UP))
        turn("knee", _turn_shortest(bone("knee", "ankle"), -UP))
        # The sole stays as level as it was: a foot only turns about the vertical.
        level = bone("ankle", "foot") * (1.0, 0.0, 1.0)
        for joint in ("ankle", "foot"):
            turn(joint, _turn_pair(level, UP, FRONT, UP))
    return rotmats


def _turn_pair(
    first: np.ndarray, second: np.ndarray, t_first: np.ndarray, t_second: np.ndarray
) -> np.ndarray:
    """Rotations (N, 3, 3) that turn `first` to `t_first` and `second` towards `t_second`."""
    turned: np.ndarray = _frame(t_first, t_second) @ np.swapaxes(_frame(first, second), -1, -2)
    return turned


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    z = _unit(np.cross(first, second))
    x = np.broadcast_to(_unit(first), z.shape)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _turn_shortest(first: np.ndarray, t_first: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) about the axis square to both directions."""
    axis = np.cross(first, t_first)
    return _turn_pair(first, np.cross(axis, first), t_first, np.cross(axis, t_first))


def _unit(vectors: np.ndarray) -> np.ndarray:
    normed: np.ndarray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return normed
