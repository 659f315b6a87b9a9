"""What a rendering leaves beside frames and masks: joints, surface passes, clearance.

Depth, normals, flow and instances are PNG: `cv2.imread(path, cv2.IMREAD_UNCHANGED)` gives what is
stored, colours in the order blue, green, red.  The flow's form is that of KITTI's 2015 benchmark
(http://www.cvlibs.net/datasets/kitti).  BadFrames: no such file, or another kind of picture.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.read.frames import decoded, write_image
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import in_frame, project_cam
from gmrdata.values.clip import Clip, Joints2d, camera_of
from gmrdata.values.errors import BadFrames
from gmrdata.values.motion_metrics import chunks
from gmrdata.values.records import Record
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.values.transforms import apply, invert

MM_PER_M = 1000.0
FARTHEST_M = 65.535
FLOW_STEPS_PER_PX = 64.0
FLOW_ZERO = 2**15
_MOST = 65535
CLEARANCE_FILE = "clearance.json"
IN_FRAME = "in_frame_share"
"""The manifest's figure: share of a clip's frames with the whole person in frame."""


def project_joints(clip: Clip, body: BodyModel) -> Joints2d:
    """Joints of a world-frame clip through its camera; `visible` is `in_frame` here."""
    camera = camera_of(clip)
    world_m = motion_joints_m(body, clip.motion)
    camera_m = apply(invert(camera.world_from_cam), world_m)
    image_px = project_cam(camera_m, camera.intrinsics_px)
    size_px = (camera.width_px, camera.height_px)
    inside = (image_px >= 0) & (image_px < size_px)
    in_frame = np.asarray(inside.all(axis=-1))  # False for NaN
    return Joints2d(world_m, camera_m, image_px, in_frame, in_frame)


def write_depth(path: Path, depth_m: np.ndarray) -> None:
    """Write (H, W) depths along the optical axis [m] in whole mm; 0: none within 65.535 m."""
    near = np.nan_to_num(depth_m, nan=np.inf) < FARTHEST_M
    _write(path, np.rint(np.where(near, depth_m, 0.0) * MM_PER_M))


def read_depth(path: Path) -> np.ndarray:
    """(H, W) float64 depths [m] of a file by `write_depth`; infinite where it has none."""
    stored = _read(path, 2)
    return np.where(stored > 0, stored / MM_PER_M, np.inf)


def write_normals(path: Path, normals: np.ndarray) -> None:
    """Write (H, W, 3) unit normals, x y z as red green blue: -1 -> 0, 1 -> 65535; none is zeros."""
    there = (normals != 0).any(axis=-1, keepdims=True)
    stored = np.where(there, (np.clip(normals, -1, 1) + 1) / 2 * _MOST, 0.0)
    _write(path, np.rint(stored)[..., ::-1])


def read_normals(path: Path) -> np.ndarray:
    """(H, W, 3) float64 normals of a file by `write_normals`; zeros where it has none."""
    stored = _read(path, 3)[..., ::-1]
    return np.where((stored > 0).any(axis=-1, keepdims=True), stored / _MOST * 2 - 1, 0.0)


def write_flow(path: Path, flow_px: np.ndarray) -> None:
    """Write (H, W, 2) flow [px]: red and green are 64 u + 2^15 and 64 v + 2^15, blue is 1.
    NaN, and a flow of 512 px or more, are not known: 0, 0, 0."""
    stored = np.rint(flow_px * FLOW_STEPS_PER_PX + FLOW_ZERO)
    known = ((stored >= 0) & (stored <= _MOST)).all(axis=-1, keepdims=True)  # False for NaN
    pixels = np.concatenate([np.ones_like(stored[..., :1]), stored[..., ::-1]], axis=-1)
    _write(path, np.where(known, pixels, 0.0))


def read_flow(path: Path) -> np.ndarray:
    """(H, W, 2) float64 flow [px] of a file by `write_flow`; NaN where it has none."""
    stored = _read(path, 3)
    flow_px = (stored[..., :0:-1] - FLOW_ZERO) / FLOW_STEPS_PER_PX
    return np.where(stored[..., :1] > 0, flow_px, np.nan)


def write_instances(path: Path, instances: np.ndarray) -> None:
    """Write (H, W) numbers of what is seen, 0 for the background: 8 bit."""
    write_image(path, instances.astype(np.uint8))


def read_instances(path: Path) -> np.ndarray:
    """(H, W) uint8 numbers of a file by `write_instances`."""
    return _read(path, 2, np.uint8)


def _write(path: Path, pixels: np.ndarray) -> None:
    write_image(path, pixels.astype(np.uint16))


def _read(path: Path, n_dimensions: int, kind: type[np.integer] = np.uint16) -> np.ndarray:
    import cv2

    fault = f"missing, or no such PNG of {8 * np.dtype(kind).itemsize}-bit; render this frame again"
    stored = decoded(path, cv2.IMREAD_UNCHANGED, fault)
    if stored.dtype != kind or stored.ndim != n_dimensions:
        raise BadFrames(f"{path}: {fault}")
    return stored.astype(np.float64) if kind is np.uint16 else stored


class Clearance(Record):
    """Measured in Blender against the surfaces of everything that doesn't move, but the ground."""

    format: Literal["gmrdata-clearance/1"] = "gmrdata-clearance/1"
    camera_m: float = Field(gt=0)
    """Smallest distance of the camera's place to a surface [m]."""
    person_m: float = Field(gt=0)
    """Smallest distance of the pelvis to a surface [m]."""
    sight_share: float = Field(ge=0, le=1)
    """Share of the frames in which nothing stands between the camera and the pelvis."""

    @property
    def figures(self) -> dict[str, float]:
        """As a manifest's quality figures."""
        names = ("camera_clearance_m", "person_clearance_m", "clear_sight_share")
        return dict(zip(names, (self.camera_m, self.person_m, self.sight_share), strict=True))


def clearance_figures(folder: Path) -> Mapping[str, float]:
    """The figures of a rendered clip; none for a clip with nothing round it."""
    path = folder / CLEARANCE_FILE
    return Clearance.read(path).figures if path.is_file() else {}


def whole_person_share(clip: Clip, body: BodyModel) -> float:
    """Share of a clip's frames (0 to 1) in which every vertex of the body is inside the image."""
    camera, parts = camera_of(clip), chunks(clip.motion.n_frames, len(body.template_m))
    seen = [
        in_frame(camera.at_rows(rows), motion_vertices_m(body, clip.motion, rows)) for rows in parts
    ]
    return float(np.concatenate(seen).mean())
