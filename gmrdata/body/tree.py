"""The 24-joint SMPL tree: names, parents, and the joints that other modules ask for by name."""

JOINT_NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee",
    "spine2", "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot",
    "neck", "left_collar", "right_collar", "head", "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
"""SMPL's joints in SMPL's order (Loper et al. 2015)."""

PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
"""Parent of each joint; the pelvis has none (-1).  A parent always comes before its children."""

N_JOINTS = 24
N_LOCAL = 23
"""Joints with a local rotation: all but the pelvis, whose rotation is the root's."""

JOINT = {name: i for i, name in enumerate(JOINT_NAMES)}

_OTHER_SIDE = {"left": "right", "right": "left"}

MIRRORED = tuple(
    JOINT["_".join(_OTHER_SIDE.get(word, word) for word in name.split("_"))] for name in JOINT_NAMES
)
"""Index of each joint's counterpart on the other side of the body."""
