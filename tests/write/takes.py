"""A take to write: someone who walks, a second who is not always there, and a camera with a gap."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.motion import Motion
from gmrdata.write.take import Performer, Take
from tests.filming import look_at

INTRINSICS_PX = np.array([[150.0, 0.0, 71.5], [0.0, 160.0, 55.25], [0.0, 0.0, 1.0]])
SIZE_PX = (160, 96)
N_FRAMES = 12
HIDDEN = [4, 5]
"""Rows without a pose of the second person; the camera is not known in the last of them."""


def make_take(walk: Callable[..., Motion], body: BodyModel, fps_hz: float = 29.97) -> Take:
    motion = walk(fps_hz, N_FRAMES)
    beside = replace(motion, pelvis_m=motion.pelvis_m + np.array([1.0, 0.5, 0.0]))
    beside.pelvis_m[HIDDEN] = np.nan
    shown = np.ones(N_FRAMES, dtype=bool)
    there = shown.copy()
    there[HIDDEN] = False
    middle_m = motion.pelvis_m.mean(axis=0)
    offsets_m = [np.array([-3.0, -2.0 - 0.1 * i, 0.8]) for i in range(N_FRAMES)]
    cameras = [look_at(middle_m + offset_m, middle_m) for offset_m in offsets_m]
    world_from_cam, has_camera = np.stack(cameras), shown.copy()
    has_camera[HIDDEN[-1]] = False
    world_from_cam[~has_camera] = np.nan
    camera = CameraPath(INTRINSICS_PX, *SIZE_PX, world_from_cam, has_camera)
    people = (Performer("person", motion, body, shown), Performer("second", beside, body, there))
    return Take("truth", people, camera)


def save_turned(path: Path) -> None:
    """Store an image's pixels on their side, with EXIF that turns them back."""
    with Image.open(path) as image:
        turned, exif = image.transpose(Image.Transpose.ROTATE_90), Image.Exif()
    exif[0x0112] = 6  # orientation: to be turned clockwise
    turned.save(path, exif=exif, quality=95)
