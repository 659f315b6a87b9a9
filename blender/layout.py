# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands where: a courtyard round a subject and a camera that both have room to move."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from blender import textures

SUBJECT_CLEARANCE_M = 1.1
CAMERA_CLEARANCE_M = 0.9
SIGHT_CLEARANCE_M = 0.5
WALL_MARGIN_M = 2.5
SMALLEST_HALF_SIDE_M = 6.5
CORNER_M = 1.0
"""How far each row of houses goes on behind the next row: more than the houses stand back."""
WALL_PX_PER_M = 90.0
PROP_PX_PER_M = 200.0
GROUND_PX = 2048


@dataclass(frozen=True, eq=False)
class Thing:
    """A solid with one picture on it."""

    solid: Literal["box", "cylinder", "blob"]
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
    sky: np.ndarray
    """(H, W, 3) equirectangular."""


def courtyard(
    subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator
) -> Yard:
    """A yard between houses, with crates, drums, pillars, bushes and trees.

    Nothing stands within about a metre of the subject or the camera, or between them.

    Args:
        subject_world_m: (T, 3) pelvis path [m].
        camera_world_m: (T, 3) optical centres [m].
        rng: Chooses everything else.
    """
    subject, camera = subject_world_m[:, :2], camera_world_m[:, :2]
    everywhere = np.concatenate([subject, camera])
    low, high = everywhere.min(axis=0) - WALL_MARGIN_M, everywhere.max(axis=0) + WALL_MARGIN_M
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, SMALLEST_HALF_SIDE_M)
    houses = _houses(centre, half, rng)
    props = _props(centre, half, subject, camera, rng)
    things = tuple(houses + props)
    side_m = float(2 * half.max() + 3.0)
    ground = textures.paving(GROUND_PX, side_m, rng)
    _darken_contacts(ground, things, centre, side_m)
    return Yard(centre, side_m, ground, things, textures.sky(1024, 512, rng))


def _houses(centre: np.ndarray, half: np.ndarray, rng: np.random.Generator) -> list[Thing]:
    """Fronts of different width, height and depth along the four sides."""
    houses = []
    for side in range(4):
        yaw_rad = side * np.pi / 2
        along, out = _direction(yaw_rad), _direction(yaw_rad - np.pi / 2)
        length, depth = (half[0], half[1]) if side % 2 == 0 else (half[1], half[0])
        end = float(length) + CORNER_M
        start = -end
        while start < end - 0.3:
            width_m = float(min(rng.uniform(2.8, 4.8), end - start))
            height_m = float(rng.uniform(4.6, 8.2))
            step_m = float(rng.uniform(0.0, 0.7))
            middle = centre + along * (start + width_m / 2) + out * (depth + step_m + 1.0)
            houses.append(
                Thing(
                    "box",
                    np.array([*middle, height_m / 2]),
                    np.array([width_m, 2.0, height_m]),
                    yaw_rad,
                    textures.facade(width_m, height_m, WALL_PX_PER_M, rng),
                    (width_m, height_m),
                )
            )
            start += width_m
    return houses


def _props(
    centre: np.ndarray,
    half: np.ndarray,
    subject: np.ndarray,
    camera: np.ndarray,
    rng: np.random.Generator,
) -> list[Thing]:
    makers = (_crates, _crates, _drum, _pillar, _planter, _tree)
    props: list[Thing] = []
    taken: list[tuple[np.ndarray, float]] = []
    for attempt in range(400):
        if len(taken) >= 30:
            break
        make = makers[int(rng.integers(len(makers)))]
        radius_m = float(rng.uniform(0.35, 0.65))
        place = centre + rng.uniform(-1, 1, 2) * (half - radius_m - 0.1)
        near_wall = bool(np.any(np.abs(place - centre) > half - 1.6))
        if attempt % 2 and not near_wall:
            continue
        clear_of_others = all(
            np.linalg.norm(place - other) > radius_m + other_m + 0.25 for other, other_m in taken
        )
        if clear_of_others and is_free(place, radius_m, subject, camera):
            taken.append((place, radius_m))
            props += make(place, radius_m, rng)
    return props


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


def _direction(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def _px(size_m: float) -> int:
    return max(int(size_m * PROP_PX_PER_M), 16)


def _crates(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """One to three crates, the upper ones smaller and turned."""
    crates, top_m, side_m = [], 0.0, radius_m * 1.35
    for _ in range(int(rng.integers(1, 4))):
        size = np.array([side_m, side_m, side_m * rng.uniform(0.7, 1.0)])
        centre = np.array([*place, top_m + size[2] / 2])
        picture = textures.planks(_px(side_m), _px(size[2]), rng)
        crates.append(Thing("box", centre, size, rng.uniform(0, np.pi), picture, None))
        top_m, side_m = top_m + size[2], side_m * rng.uniform(0.7, 0.95)
    return crates


def _drum(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    width_m, height_m = min(1.4 * radius_m, 0.62), float(rng.uniform(0.8, 1.0))
    picture = textures.barrel(_px(np.pi * width_m), _px(height_m), rng)
    centre, size = np.array([*place, height_m / 2]), np.array([width_m, width_m, height_m])
    return [Thing("cylinder", centre, size, rng.uniform(0, np.pi), picture, None)]


def _pillar(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """An advertising pillar with a cap."""
    width_m, height_m = 1.3 * radius_m, float(rng.uniform(2.2, 3.0))
    picture = textures.posters(_px(np.pi * width_m), _px(height_m), rng)
    body = Thing(
        "cylinder",
        np.array([*place, height_m / 2]),
        np.array([width_m, width_m, height_m]),
        rng.uniform(0, np.pi),
        picture,
        None,
    )
    cap_m = np.array([width_m * 1.25, width_m * 1.25, 0.22])
    cap = textures.barrel(_px(np.pi * width_m), 64, rng)
    return [body, Thing("cylinder", np.array([*place, height_m + 0.11]), cap_m, 0.0, cap, None)]


def _planter(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    width_m, height_m = 1.35 * radius_m, float(rng.uniform(0.4, 0.6))
    yaw_rad = rng.uniform(0, np.pi)
    box = Thing(
        "box",
        np.array([*place, height_m / 2]),
        np.array([width_m, width_m, height_m]),
        yaw_rad,
        textures.planks(_px(width_m), _px(height_m), rng),
        None,
    )
    bush_m = np.array([1.2 * width_m, 1.2 * width_m, rng.uniform(0.7, 1.1)])
    centre = np.array([*place, height_m + 0.35 * bush_m[2]])
    return [box, Thing("blob", centre, bush_m, yaw_rad, textures.foliage(256, rng), None)]


def _tree(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    trunk_m = float(rng.uniform(2.0, 2.6))
    bark = textures.planks(96, 384, rng)[:, :, :] * 0.6
    parts = [
        Thing(
            "cylinder",
            np.array([*place, trunk_m / 2]),
            np.array([0.2, 0.2, trunk_m]),
            0.0,
            bark,
            None,
        )
    ]
    for _ in range(3):
        size = rng.uniform(1.0, 1.7) * np.array([1.0, 1.0, 0.8])
        centre = np.array([*place, trunk_m + 0.3]) + rng.normal(0, 0.32, 3)
        yaw_rad = rng.uniform(0, np.pi)
        parts.append(Thing("blob", centre, size, yaw_rad, textures.foliage(384, rng), None))
    return parts


def _darken_contacts(
    ground: np.ndarray, things: tuple[Thing, ...], centre: np.ndarray, side_m: float
) -> None:
    """Soft shadows round what stands on the ground: light without bounces makes none."""
    px_per_m = len(ground) / side_m
    cover = np.zeros(ground.shape[:2], np.float32)
    for thing in things:
        if thing.centre_m[2] - thing.size_m[2] / 2 > 0.05:
            continue
        middle = (thing.centre_m[:2] - centre + side_m / 2) * px_per_m
        size = thing.size_m[:2] * px_per_m
        # Row 0 is the far side (+y), so angles turn the other way.
        box = ((middle[0], len(ground) - middle[1]), tuple(size), -np.rad2deg(thing.yaw_rad))
        cv2.fillConvexPoly(cover, cv2.boxPoints(box).astype(np.int32), (1.0,))
    ground *= 1 - 0.65 * cv2.GaussianBlur(cover, (0, 0), 0.16 * px_per_m)[..., None]
