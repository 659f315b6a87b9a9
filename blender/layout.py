# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain data of what stands where, and the room that the subject and the camera keep."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

SUBJECT_CLEARANCE_M = 1.1
CAMERA_CLEARANCE_M = 0.9
SIGHT_CLEARANCE_M = 0.5
PERSON_M = 2.0


@dataclass(frozen=True, eq=False)
class Thing:
    """A solid with one picture on it."""

    solid: Literal["box", "taper", "cylinder", "wheel", "blob"]
    centre_m: np.ndarray
    """(3,) centre, world [m]."""
    size_m: np.ndarray
    """(3,) extent along its own x, y, z [m]."""
    yaw_rad: float
    """Turn about the world's z axis [rad]."""
    picture: np.ndarray
    """(H, W, 3) texture."""
    picture_m: tuple[float, float] | None
    """Width and height of the picture on the surface [m]; None: once round each face."""


@dataclass(frozen=True, eq=False)
class Yard:
    """Everything that doesn't move."""

    ground_centre_m: np.ndarray
    """(2,) middle of the yard [m]."""
    ground_side_m: float
    ground: np.ndarray
    """(H, W, 3) texture of the ground, with soft shadows where things touch it."""
    things: tuple[Thing, ...]
    sky: np.ndarray | None
    """(H, W, 3) equirectangular; None: none to be seen."""
    lamp_m: np.ndarray | None = None
    """(3,) the lamp of a closed room, world [m]."""


def main_colours(yard: Yard) -> np.ndarray:
    """(N, 3) mean colours of the ground and of what stands higher than a person."""
    tall = [thing.picture for thing in yard.things if thing.size_m[2] > PERSON_M]
    return np.array([picture.mean(axis=(0, 1)) for picture in (yard.ground, *tall)])


def surroundings(
    subject_m: np.ndarray, camera_m: np.ndarray, margin_m: float, smallest_half_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centre (2,) and half sides (2,) of a rectangle with a margin round both paths [m].

    Args:
        subject_m: (T, 2) [m].
        camera_m: (T, 2) [m].
        margin_m: Between the paths and the rectangle's sides [m].
        smallest_half_m: Half sides are at least this [m].
    """
    everywhere = np.concatenate([subject_m, camera_m])
    low, high = everywhere.min(axis=0) - margin_m, everywhere.max(axis=0) + margin_m
    return (low + high) / 2, np.maximum((high - low) / 2, smallest_half_m)


def is_free(
    place_m: np.ndarray, radius_m: float, subject_m: np.ndarray, camera_m: np.ndarray
) -> bool:
    """Whether a disc on the ground keeps clear of both paths and of all lines of sight.

    Args:
        place_m: (2,) centre of the disc [m].
        radius_m: Its radius [m].
        subject_m: (T, 2) [m].
        camera_m: (T, 2) [m].
    """
    if np.linalg.norm(subject_m - place_m, axis=1).min() < radius_m + SUBJECT_CLEARANCE_M:
        return False
    if np.linalg.norm(camera_m - place_m, axis=1).min() < radius_m + CAMERA_CLEARANCE_M:
        return False
    sight = subject_m - camera_m
    share = ((place_m - camera_m) * sight).sum(axis=1) / np.maximum((sight**2).sum(axis=1), 1e-9)
    nearest = camera_m + np.clip(share, 0, 1)[:, None] * sight
    return bool(np.linalg.norm(nearest - place_m, axis=1).min() > radius_m + SIGHT_CLEARANCE_M)


def with_ways(
    subject_m: np.ndarray, camera_m: np.ndarray, ways_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Paths (N, 3) of subject and camera to lay a place out for, with the ways of others [m].

    A way counts as both: things keep clear of it, but may stand in the line of sight to it.

    Args:
        subject_m: (T, 3) [m].
        camera_m: (T, 3) [m].
        ways_m: (W, 3) points that extras come by [m].
    """
    return np.concatenate([subject_m, ways_m]), np.concatenate([camera_m, ways_m])


def direction(angle_rad: float) -> np.ndarray:
    """Unit vector (2,) at an angle from x to y."""
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def darken_contacts(
    ground: np.ndarray, things: tuple[Thing, ...], centre: np.ndarray, side_m: float
) -> None:
    """Soft shadows round what stands on the ground: light without bounces makes none."""
    rows = len(ground) // 4  # of the shadows, which are soft: a quarter is fine enough
    px_per_m = rows / side_m
    cover = np.zeros((rows, rows), np.float32)
    for thing in things:
        if thing.centre_m[2] - thing.size_m[2] / 2 > 0.05:
            continue
        middle = (thing.centre_m[:2] - centre + side_m / 2) * px_per_m
        size = thing.size_m[:2] * px_per_m
        # Row 0 is the far side (+y), so angles turn the other way.
        box = ((middle[0], rows - middle[1]), tuple(size), -np.rad2deg(thing.yaw_rad))
        cv2.fillConvexPoly(cover, cv2.boxPoints(box).astype(np.int32), (1.0,))
    light = 1 - np.float32(0.65) * cv2.GaussianBlur(cover, (0, 0), 0.16 * px_per_m)
    ground *= cv2.merge([cv2.resize(light, ground.shape[1::-1])] * 3)
