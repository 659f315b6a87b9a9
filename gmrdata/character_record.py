"""The residual of a rigged character: how far its joints are from those of the truth.

A character is driven by rotations: each limb points where the body's limb points.  As its bones
have other lengths, and its joints lie elsewhere in its flesh, its joints are then at other places
than the body's, which the stored motion says.  The residual is that gap, joint by joint [m].  It is
no error of the motion; it is how much a picture of the character misleads a method that is scored
by joint places.  Directions of limbs show the error of the motion itself, which should be none.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.body.tree import N_JOINTS
from gmrdata.clip import read_npz
from gmrdata.errors import BadMotionFile
from gmrdata.motion.rest_pose import LIMBS
from gmrdata.store import write_npz

CHARACTER_FILE = "character.npz"


@dataclass(frozen=True, eq=False)
class CharacterRecord:
    """What a render with a character knows beside the truth; T frames."""

    joints_world_m: np.ndarray
    """(T, 24, 3) the character's joints, which are the heads of its bones, in the world [m]; NaN
    where it has no bone for a joint."""
    residual_m: np.ndarray
    """(T, 24, 3) the same less the body's joints, world axes [m]."""
    in_frame: np.ndarray
    """(T,) bool: the whole character is inside the image."""
    bones: tuple[str, ...]
    """24 names of bones, empty where there is none for a joint."""
    scale: float
    """By how much the character's file was enlarged."""


def save_character(path: Path, record: CharacterRecord) -> None:
    """Write `character.npz`; FORMAT.md describes it."""
    write_npz(
        path,
        {
            "joints_world_m": record.joints_world_m,
            "residual_m": record.residual_m,
            "in_frame": record.in_frame,
            "bones": np.array(record.bones),
            "scale": record.scale,
        },
    )


def load_character(path: Path) -> CharacterRecord:
    """Read a file by `save_character`.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: not readable, or its arrays do not fit together.
    """
    arrays = read_npz(path)
    n_frames = len(np.atleast_1d(arrays.get("in_frame", ())))
    wanted: dict[str, tuple[str, tuple[int, ...]]] = {
        "joints_world_m": ("f", (n_frames, N_JOINTS, 3)),
        "residual_m": ("f", (n_frames, N_JOINTS, 3)),
        "in_frame": ("b", (n_frames,)),
        "bones": ("U", (N_JOINTS,)),
        "scale": ("f", ()),
    }
    for key, (kind, shape) in wanted.items():
        found = arrays.get(key)
        if found is None or found.dtype.kind != kind or found.shape != shape:
            raise BadMotionFile(f"{path}: no array {key!r} of shape {shape}; render it again")
    return CharacterRecord(
        arrays["joints_world_m"],
        arrays["residual_m"],
        arrays["in_frame"],
        tuple(str(name) for name in arrays["bones"]),
        float(arrays["scale"]),
    )


def residual_figures(record: CharacterRecord) -> dict[str, float]:
    """The residual in three numbers for the manifest.

    `character_residual_mm_mean` and `_max` are over all frames and all joints that have a bone;
    `character_bone_direction_deg_mean` is the mean angle between the character's and the body's
    thighs, shanks, upper arms and forearms.
    """
    residual_mm = 1000 * np.linalg.norm(record.residual_m, axis=-1)
    return {
        "character_residual_mm_mean": float(np.nanmean(residual_mm)),
        "character_residual_mm_max": float(np.nanmax(residual_mm)),
        "character_bone_direction_deg_mean": float(limb_angles_deg(record).mean()),
    }


def limb_angles_deg(record: CharacterRecord) -> np.ndarray:
    """(T, 8) angles between the character's limbs, in `LIMBS`' order, and the body's [deg]."""
    start, end = np.transpose(LIMBS)
    true_m = record.joints_world_m - record.residual_m
    a = record.joints_world_m[:, end] - record.joints_world_m[:, start]
    b = true_m[:, end] - true_m[:, start]
    sine, cosine = np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(sine, cosine)))
