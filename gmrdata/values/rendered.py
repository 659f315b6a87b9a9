"""The truth beside a rendered clip, row by row: places of joints, and a character's residual."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.values.body import N_JOINTS
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import read_npz, write_npz

CHARACTER_FILE = "character.npz"
T = -1  # stands for the number of frames in `TruthShapes`
TruthShapes = Mapping[str, tuple[str, tuple[int, ...]]]
JOINT_ARRAYS: TruthShapes = {
    "joints_world_m": ("f", (T, N_JOINTS, 3)),
    "joints_camera_m": ("f", (T, N_JOINTS, 3)),
    "joints_px": ("f", (T, N_JOINTS, 2)),
    "in_frame": ("b", (T, N_JOINTS)),
    "visible": ("b", (T, N_JOINTS)),
}
"""The fields of `Joints2d`, as they are called in its file."""


@dataclass(frozen=True, eq=False)
class Joints2d:
    """Joints of T frames, in the order of `gmrdata.values.body.JOINT_NAMES`."""

    world_m: np.ndarray  # (T, 24, 3) places in the world [m]
    camera_m: np.ndarray  # (T, 24, 3) places in the camera's OpenCV axes [m]
    image_px: np.ndarray  # (T, 24, 2) image points; NaN behind the camera
    in_frame: np.ndarray  # (T, 24) bool: in front of the camera and inside the image
    visible: np.ndarray
    """(T, 24) bool: in the frame, and neither the scene nor another part of the body hides it."""


def save_joints(path: Path, joints: Joints2d) -> None:
    """Write `joints.npz`; FORMAT.md describes it."""
    write_npz(path, dict(zip(JOINT_ARRAYS, vars(joints).values(), strict=True)))


def load_joints(path: Path) -> Joints2d:
    """Read a file by `save_joints`; errors as of `read_truth`."""
    return Joints2d(*read_truth(path, JOINT_ARRAYS, frames_of="joints_px"))


def read_truth(path: Path, shapes: TruthShapes, frames_of: str) -> list[np.ndarray]:
    """The arrays of a file of truth, in the order of `shapes`: kind (numpy's letter) and shape.
    The first axis of the array `frames_of` tells the number of frames."""
    arrays = read_npz(path)
    n_frames = len(np.atleast_1d(arrays.get(frames_of, ())))
    for key, (kind, shape) in shapes.items():
        found = arrays.get(key)
        wanted = tuple(n_frames if length == T else length for length in shape)
        if found is None or found.dtype.kind != kind or found.shape != wanted:
            raise BadMotionFile(f"{path}: no array {key!r} of shape {wanted}; render it again")
    return [arrays[key] for key in shapes]


@dataclass(frozen=True, eq=False)
class CharacterRecord:
    """What a render with a character knows beside the truth; T frames."""

    joints_world_m: np.ndarray  # (T, 24, 3) heads of the bones, world [m]; NaN without a bone
    residual_m: np.ndarray  # (T, 24, 3) the same less the body's joints, world axes [m]
    in_frame: np.ndarray  # (T,) bool: the whole character is inside the image
    bones: tuple[str, ...]  # 24 names, empty for a joint without a bone
    scale: float  # by how much the character's file was enlarged


def save_character(path: Path, record: CharacterRecord) -> None:
    """Write `character.npz`; FORMAT.md describes it."""
    write_npz(path, vars(record) | {"bones": np.array(record.bones)})


def load_character(path: Path) -> CharacterRecord:
    """Read a file by `save_character`; errors as of `read_truth`."""
    shapes: TruthShapes = {
        "joints_world_m": ("f", (T, N_JOINTS, 3)),
        "residual_m": ("f", (T, N_JOINTS, 3)),
        "in_frame": ("b", (T,)),
        "bones": ("U", (N_JOINTS,)),
        "scale": ("f", ()),
    }
    joints_m, residual_m, in_frame, bones, scale = read_truth(path, shapes, frames_of="in_frame")
    return CharacterRecord(joints_m, residual_m, in_frame, tuple(bones.tolist()), float(scale))
