"""The 24 joints of a filmed person: in the world, in the camera, in the image, seen or hidden."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_joints_m
from gmrdata.body.tree import N_JOINTS
from gmrdata.clip import Clip, camera_of, read_npz
from gmrdata.errors import BadMotionFile
from gmrdata.geometry.camera import project_cam
from gmrdata.geometry.transforms import apply, invert
from gmrdata.store import write_npz


@dataclass(frozen=True, eq=False)
class Joints2d:
    """Joints of T frames, in the order of `gmrdata.body.tree.JOINT_NAMES`."""

    world_m: np.ndarray
    """(T, 24, 3) places in the world [m]."""
    camera_m: np.ndarray
    """(T, 24, 3) places in the camera's OpenCV axes [m]."""
    image_px: np.ndarray
    """(T, 24, 2) image points; NaN behind the camera."""
    in_frame: np.ndarray
    """(T, 24) bool: in front of the camera and inside the image."""
    visible: np.ndarray
    """(T, 24) bool: in the frame, and neither the scene nor another part of the body hides it."""


def project_joints(clip: Clip, body: BodyModel) -> Joints2d:
    """Joints of a world-frame clip through its camera; `visible` is `in_frame` here.

    Raises:
        BadMotionFile: the clip has no camera.
    """
    camera = camera_of(clip)
    world_m = motion_joints_m(body, clip.motion)
    camera_m = apply(invert(camera.world_from_cam), world_m)
    image_px = project_cam(camera_m, camera.intrinsics_px)
    size_px = (camera.width_px, camera.height_px)
    in_frame = ((image_px >= 0) & (image_px < size_px)).all(axis=-1)  # False for NaN
    return Joints2d(world_m, camera_m, image_px, in_frame, in_frame)


def save_joints(path: Path, joints: Joints2d) -> None:
    """Write `joints.npz`; FORMAT.md describes it."""
    write_npz(
        path,
        {
            "joints_world_m": joints.world_m,
            "joints_camera_m": joints.camera_m,
            "joints_px": joints.image_px,
            "in_frame": joints.in_frame,
            "visible": joints.visible,
        },
    )


def load_joints(path: Path) -> Joints2d:
    """Read a file by `save_joints`.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: not readable, or its arrays do not fit together.
    """
    arrays = read_npz(path)
    n_frames = len(arrays.get("joints_px", ()))
    keys = {
        "joints_world_m": ("f", (3,)),
        "joints_camera_m": ("f", (3,)),
        "joints_px": ("f", (2,)),
        "in_frame": ("b", ()),
        "visible": ("b", ()),
    }
    for key, (kind, last) in keys.items():
        found = arrays.get(key)
        wanted = (n_frames, N_JOINTS, *last)
        if found is None or found.dtype.kind != kind or found.shape != wanted:
            raise BadMotionFile(f"{path}: no array {key!r} of shape {wanted}; render it again")
    return Joints2d(*(arrays[key] for key in keys))
