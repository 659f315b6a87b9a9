"""A walk along a street that never comes back, drawn: two walls and the ground, each metre new."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.transforms import rigid

SIZE_PX = (320, 180)
FOCAL_PX = 270.0
PX_PER_M, BLOCK_M, BREADTH_M = 30, 40, 8
WALL_M, EYES_M = 4.0, 1.6
"""From the middle to each wall, and from the ground to the camera."""
SPEED_M, SWAY_M = 1.4 / 30, 0.04  # per frame; of a step
STEP_FRAMES = 16
HAZE_M = 15.0


def walk(n_frames: int) -> np.ndarray:
    """(T, 4, 4) world_from_cam of who walks along z, looks about and sways; y is down."""
    time = np.arange(n_frames)
    step = 2 * np.pi * time / STEP_FRAMES
    places = np.stack(
        [SWAY_M * np.sin(step / 2), -SWAY_M * np.abs(np.sin(step / 2)), SPEED_M * time], axis=1
    )
    angles = np.stack([0.02 * np.sin(step), 0.35 * np.sin(time / 97), 0.01 * np.sin(step / 2)], 1)
    return rigid(Rotation.from_euler("xyz", angles).as_matrix(), places)


@cache
def _block(surface: int, number: int) -> np.ndarray:
    """Grey values of some metres of a wall or of the ground: spots of all sizes."""
    rng, shape = (
        np.random.default_rng([surface, number]),
        (BLOCK_M * PX_PER_M, BREADTH_M * PX_PER_M),
    )
    grey = np.full(shape, 128.0, np.float32)
    for size in (3, 8, 24, 80):
        small = rng.normal(0, 1, (shape[0] // size + 2, shape[1] // size + 2)).astype(np.float32)
        grey += 22 * cv2.resize(small, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return grey


def draw(world_from_cam: np.ndarray) -> np.ndarray:
    """A picture (H, W) uint8."""
    u, v = np.meshgrid(np.arange(SIZE_PX[0]) + 0.5, np.arange(SIZE_PX[1]) + 0.5)
    flat = np.stack([u - SIZE_PX[0] / 2, v - SIZE_PX[1] / 2, np.full(u.shape, FOCAL_PX)], axis=-1)
    rays, centre = flat @ world_from_cam[:3, :3].T, world_from_cam[:3, 3]
    picture, nearest = np.full(u.shape, 200.0, np.float32), np.full(u.shape, 200.0)
    # Walls at x = -4 and 4 m, seen by z and y; the ground, by z and x.
    for surface, (axis, at, across) in enumerate(((0, -WALL_M, 1), (0, WALL_M, 1), (1, EYES_M, 0))):
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (at - centre[axis]) / rays[..., axis]
        there = centre + far[..., None] * rays
        shown = (far > 0) & (far * FOCAL_PX < nearest) & (abs(there[..., across]) < BREADTH_M / 2)
        nearest = np.where(shown, far * FOCAL_PX, nearest)
        along = np.where(shown, there[..., 2], 0.0)
        for number in np.unique(np.floor(along[shown] / BLOCK_M)).astype(int).tolist():
            here = shown & (np.floor(along / BLOCK_M) == number)
            rows = (along - number * BLOCK_M) * PX_PER_M
            columns = (there[..., across] + BREADTH_M / 2) * PX_PER_M
            block = _block(surface, number + 1000)
            seen = cv2.remap(
                block, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
            picture[here] = seen[here]
    # Haze, so that nothing ends at a distance that goes with the camera.
    haze = np.exp(-nearest / HAZE_M)
    return np.clip(200 + haze * (picture - 200), 0, 255).astype(np.uint8)


def film_street(folder: Path, n_frames: int) -> np.ndarray:
    """Draw the frames that are not there; the true cameras (T, 4, 4) [m]."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = walk(n_frames)
    for row, camera in enumerate(cameras):
        if not (path := folder / f"{row:05d}.jpg").exists():
            noisy = draw(camera) + np.random.default_rng(row).normal(0, 1.5, SIZE_PX[::-1])
            grey = np.clip(noisy, 0, 255).astype(np.uint8)
            cv2.imwrite(str(path), grey, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return cameras
