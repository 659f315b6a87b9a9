"""The landmark network's landmarks on a body of the 24-joint tree, and how they are seen.

Each hangs on one joint, by an offset in the axes of a joint's rest pose.

The network sees a crop and nothing else, so its metres are along the crop's ray, the one through
the middle of the hips ("Perspective Crop Layers", Yu et al., 2021).
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.values.body import JOINT, leg_length_m
from gmrdata.values.records import Record
from gmrdata.values.shapes import Float
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import turns_to_rays

BODY_FILE = Path(__file__).with_name("landmark_body.json")
LEG_M = 0.80
"""Leg, hip to ankle, for which the offsets are written [m]."""

HIPS = (LANDMARKS.index("left_hip"), LANDMARKS.index("right_hip"))
SIZED_BY = tuple(
    LANDMARKS.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("shoulder", "hip", "knee", "ankle")
)
"""Landmarks by whose spread a person's size in the picture is taken."""
KNEES = tuple(LANDMARKS.index(f"{side}_knee") for side in ("left", "right"))
VISIBLE = 0.5  # from which a landmark counts as seen
LEAST_DEPTH = 0.1  # of a ray's end, along the axis of the person's camera: 84 degrees off it
LEAST_SIZE = 1e-3  # a person of 2 px or so
LEAST_SPREAD_M2 = 1e-3  # of landmarks that lie on one line of sight


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
    """Where the landmarks lie on a body of the 24-joint tree [m], as it travels with the package;
    they grow with the legs."""
    offsets_m = LandmarkBodyRecord.read(BODY_FILE).offsets_m
    return np.array([offsets_m[name] for name in LANDMARKS])


def legs_hidden(visibility: np.ndarray) -> np.ndarray:
    """(T,) bool: both knees are hidden, or out of the picture, so that the network guesses what is
    below the hips; from visibilities (T, 33)."""
    return np.asarray((visibility[:, KNEES] <= VISIBLE).all(axis=1))


@dataclass(frozen=True, eq=False)
class SeenLandmarks:
    """One person's landmarks over T frames, without the lens's distortion."""

    times_s: np.ndarray  # (T,) rising
    rays: np.ndarray  # (T, 33, 2) x / z and y / z in the camera's axes
    world_m: np.ndarray  # (T, 33, 3) along each frame's ray
    visibility: np.ndarray  # (T, 33)

    def take(self, rows: slice | np.ndarray) -> "SeenLandmarks":
        """Some of the frames."""
        return SeenLandmarks(
            self.times_s[rows], self.rays[rows], self.world_m[rows], self.visibility[rows]
        )

    @property
    def weights(self) -> np.ndarray:
        """(T, 33) how much each counts: little where it is hidden."""
        return self.visibility.clip(0.05, 1.0)

    @property
    def slopes(self) -> np.ndarray:
        """(T, 2) how much further away the body is per metre to the right and down, as a whole."""
        flat_m, depth_m = self.world_m[..., :2], self.world_m[..., 2:]
        weighted = (flat_m * self.weights[..., None]).swapaxes(1, 2)
        spread = weighted @ flat_m + LEAST_SPREAD_M2 * np.eye(2)
        return np.asarray(np.linalg.solve(spread, weighted @ depth_m)[..., 0])

    @property
    def cam_from_ray(self) -> np.ndarray:
        """(T, 3, 3) the smallest turns that take the z axis to the ray of the hips."""
        return turns_to_rays(self.rays[:, HIPS].mean(axis=1))

    @property
    def sizes(self) -> np.ndarray:
        """(T,) of the person at a distance of 1, seen along its own ray."""
        ends = np.concatenate([self.rays, np.ones_like(self.rays[..., :1])], axis=-1)
        ends = ends @ self.cam_from_ray
        flat = (ends[..., :2] / ends[..., 2:].clip(LEAST_DEPTH))[:, SIZED_BY]
        return np.asarray(np.sqrt((flat**2).sum(-1).mean(-1)).clip(LEAST_SIZE))


def landmarks_on(
    joints_m: Float[np.ndarray, "frames 24 3"],
    frame_from_joint: Float[np.ndarray, "frames 24 3 3"],
    offsets_m: Float[np.ndarray, "33 3"],
) -> Float[np.ndarray, "frames 33 3"]:
    """Landmarks of a posed body in the frame of its joints, for offsets of its size [m]."""
    turned = frame_from_joint[:, TURNS_WITH]
    return np.asarray(joints_m[:, HANGS_ON] + (turned @ offsets_m[..., None])[..., 0])


def landmarks_about(
    rotmats: Float[np.ndarray, "frames 24 3 3"], rest_joints_m: Float[np.ndarray, "24 3"]
) -> Float[np.ndarray, "frames 33 3"]:
    """Landmarks of a posed body from its pelvis [m]."""
    joints_m, turned = posed_joints_m(rest_joints_m, rotmats, np.zeros((len(rotmats), 3)))
    return landmarks_on(joints_m, turned, offsets_of(rest_joints_m))


def offsets_of(rest_joints_m: Float[np.ndarray, "24 3"]) -> Float[np.ndarray, "33 3"]:
    """The landmarks' offsets on a body of this size [m]."""
    return landmark_offsets_m() * (leg_length_m(rest_joints_m) / LEG_M)


def from_hips(points_m: Float[np.ndarray, "*batch 33 n"]) -> Float[np.ndarray, "*batch 33 n"]:
    """Landmarks from the middle of the hips, as the network has its metres."""
    return np.asarray(points_m - points_m[..., HIPS, :].mean(-2, keepdims=True))
