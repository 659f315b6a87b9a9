"""Where the landmark network's 33 landmarks lie on a body of the 24-joint tree.

They are not the tree's joints: ears, nose and mouth lie on the head, heels behind the ankles,
and its hips are wider than the joints'.  Each landmark hangs on one joint, by an offset in the axes
of one joint's rest pose, which grows with the legs.  `landmark_body.json` has the offsets, fitted
to what the network saw of rendered people.
"""

from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.values.body import JOINT, N_JOINTS, PARENTS
from gmrdata.values.records import Record
from gmrdata.values.shapes import Float

BODY_FILE = Path(__file__).with_name("landmark_body.json")
LEG_M = 0.80
"""Leg, hip to ankle, for which the offsets are written [m]."""

MIRRORED_LANDMARKS = tuple(
    LANDMARKS.index(
        name.replace("left", "*").replace("right", "left").replace("*", "right")
        if "left" in name or "right" in name
        else name
    )
    for name in LANDMARKS
)
"""Index of each landmark's counterpart on the other side of the body."""

HIPS = (LANDMARKS.index("left_hip"), LANDMARKS.index("right_hip"))


def _hung(name: str) -> tuple[str, str]:
    """The joint at which a landmark hangs, and the one with which it turns."""
    side, _, part = name.partition("_")
    if part not in _PARTS:
        return "head", "head"
    at, turns = _PARTS[part]
    return f"{side}_{at}", turns if turns == "pelvis" else f"{side}_{turns}"


_PARTS = {
    "shoulder": ("shoulder", "collar"), "elbow": ("elbow", "shoulder"),
    "wrist": ("wrist", "elbow"), "pinky": ("wrist", "wrist"), "index": ("wrist", "wrist"),
    "thumb": ("wrist", "wrist"), "hip": ("hip", "pelvis"), "knee": ("knee", "hip"),
    "ankle": ("ankle", "knee"), "heel": ("ankle", "ankle"), "foot_index": ("foot", "ankle"),
}  # fmt: skip

HANGS_ON = tuple(JOINT[_hung(name)[0]] for name in LANDMARKS)
TURNS_WITH = tuple(JOINT[_hung(name)[1]] for name in LANDMARKS)


class LandmarkBodyRecord(Record):
    """`landmark_body.json`."""

    format: Literal["gmrdata-landmark-body/1"] = "gmrdata-landmark-body/1"
    made_from: str
    offsets_m: dict[str, tuple[float, float, float]]
    """By landmark: from its joint, in the rest axes of SMPL's tree, on a leg of 0.80 m [m]."""


@cache
def landmark_offsets_m() -> Float[np.ndarray, "33 3"]:
    """The offsets that travel with the package [m]."""
    found = LandmarkBodyRecord.read(BODY_FILE).offsets_m
    return np.array([found[name] for name in LANDMARKS])


def tree_joints(
    rest_joints_m: Float[Tensor, "*batch 24 3"], rotmats: Float[Tensor, "*batch 24 3 3"]
) -> tuple[Float[Tensor, "*batch 24 3"], Float[Tensor, "*batch 24 3 3"]]:
    """Joints from the pelvis [m] and frame_from_joint of local rotations, the root's first."""
    bones_m = rest_joints_m - rest_joints_m[..., [0, *PARENTS[1:]], :]
    turned, places_m = [rotmats[..., 0, :, :]], [torch.zeros_like(rotmats[..., 0, :, 0])]
    for joint in range(1, N_JOINTS):
        parent = PARENTS[joint]
        step_m = (turned[parent] @ bones_m[..., joint, :, None])[..., 0]
        places_m.append(places_m[parent] + step_m)
        turned.append(turned[parent] @ rotmats[..., joint, :, :])
    return torch.stack(places_m, dim=-2), torch.stack(turned, dim=-3)


def landmarks_on(
    joints_m: Float[Tensor, "*batch 24 3"],
    frame_from_joint: Float[Tensor, "*batch 24 3 3"],
    leg_m: Tensor,
    offsets_m: Float[Tensor, "33 3"],
) -> Float[Tensor, "*batch 33 3"]:
    """Landmarks of a posed body in the frame of its joints [m]; `leg_m` (*batch)."""
    grown_m = offsets_m * (leg_m / LEG_M)[..., None, None]
    turned = frame_from_joint[..., TURNS_WITH, :, :]
    return joints_m[..., HANGS_ON, :] + (turned @ grown_m[..., None])[..., 0]


def from_hips(points_m: Float[Tensor, "*batch 33 3"]) -> Float[Tensor, "*batch 33 3"]:
    """Landmarks from the middle of the hips, as the network has its metres."""
    return points_m - points_m[..., HIPS, :].mean(-2, keepdim=True)
