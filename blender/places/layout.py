# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain data of what stands where, and the room that the subject and the camera keep.

Meshes of the solids as arrays: vertices, quads, and picture coordinates per corner.

Each kind of place is a function of the subject's pelvis (T, 3) and of the camera's centres (T, 3)
[m], and of a generator that chooses everything else.  In its `Yard` nothing stands within about a
metre of the subject or the camera, or between them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from blender.textures.base import blocks, by_channel
from gmrdata.values.transforms import about_z

SUBJECT_CLEARANCE_M = 1.1
CAMERA_CLEARANCE_M = 0.9
SIGHT_CLEARANCE_M = 0.5
PERSON_M = 2.0


Solid = Literal["box", "taper", "cylinder", "wheel", "blob"]


@dataclass(frozen=True, eq=False)
class Thing:
    """A solid with one picture on it."""

    solid: Solid
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
    """Centre (2,) and half sides (2,) of a rectangle with a margin round both paths (T, 2) [m].

    Half sides are at least `smallest_half_m`.
    """
    everywhere = np.concatenate([subject_m, camera_m])
    low, high = everywhere.min(axis=0) - margin_m, everywhere.max(axis=0) + margin_m
    return (low + high) / 2, np.maximum((high - low) / 2, smallest_half_m)


def is_free(
    place_m: np.ndarray, radius_m: float, subject_m: np.ndarray, camera_m: np.ndarray
) -> bool:
    """Whether a disc on the ground keeps clear of both paths (T, 2) and of all lines of sight."""
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

    A way (W, 3) counts as both: things keep clear of it, but may stand in the line of sight to it.
    """
    return np.concatenate([subject_m, ways_m]), np.concatenate([camera_m, ways_m])


def direction(angle_rad: float) -> np.ndarray:
    """Unit vector (2,) at an angle from x to y."""
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def upright(
    solid: Literal["box", "cylinder"],
    place: np.ndarray,
    size_m: tuple[float, float, float],
    yaw_rad: float,
    picture: np.ndarray,
    *,
    round_each_face: bool = True,
) -> Thing:
    """A thing that stands on the ground at a place (2,).

    Its picture goes once round each face, or once over its front at its own size.
    """
    picture_m = None if round_each_face else (size_m[0], size_m[2])
    centre_m = np.array([*place, size_m[2] / 2])
    return Thing(solid, centre_m, np.array(size_m), yaw_rad, picture, picture_m)


def part_of(
    place: np.ndarray,
    yaw_rad: float,
    offset_m: tuple[float, float, float],
    size_m: tuple[float, float, float],
    picture: np.ndarray,
    solid: Solid = "box",
) -> Thing:
    """A part of something at a place (2,), turned by a yaw; the middle of the part's foot is offset
    along the whole's own x, y, and z."""
    ahead, aside = direction(yaw_rad), direction(yaw_rad + np.pi / 2)
    middle = place + ahead * offset_m[0] + aside * offset_m[1]
    centre_m = np.array([*middle, offset_m[2] + size_m[2] / 2])
    return Thing(solid, centre_m, np.array(size_m), yaw_rad, picture, None)


@dataclass(frozen=True, eq=False)
class Side:
    """One of the four sides of a rectangle."""

    yaw_rad: float
    """Turn of something that stands along it [rad]."""
    middle_m: np.ndarray
    """(2,) the rectangle's middle [m]."""
    half_length_m: float
    depth_m: float
    """From the rectangle's middle to the side [m]."""

    def at(self, along_m: float, out_m: float) -> np.ndarray:
        """Place (2,) so far along the side from its middle, and out from the rectangle's [m]."""
        along, out = direction(self.yaw_rad), direction(self.yaw_rad - np.pi / 2)
        return self.middle_m + along * along_m + out * out_m


def four_sides(centre: np.ndarray, half: np.ndarray) -> Iterator[Side]:
    """The sides of a rectangle of centre (2,) and half sides (2,) [m]."""
    for number in range(4):
        length_m, depth_m = half if number % 2 == 0 else half[::-1]
        yield Side(number * np.pi / 2, centre, float(length_m), float(depth_m))


def yard_of(
    centre: np.ndarray,
    side_m: float,
    ground: np.ndarray,
    things: tuple[Thing, ...],
    sky: np.ndarray | None,
    lamp_m: np.ndarray | None = None,
) -> Yard:
    """A yard; the picture of its ground gets the things' shadows."""
    darken_contacts(ground, things, centre, side_m)
    return Yard(centre, side_m, ground, things, sky, lamp_m)


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
    enlarged = cv2.resize(light, ground.shape[1::-1])
    for part in blocks(len(ground)):
        ground[part] *= by_channel(enlarged[part])


TAPER = np.array([0.66, 0.84, 1.0])
"""The top of a tapering box, as a share of its foot."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh of quads; a person's is of triangles."""

    vertices_m: np.ndarray
    """(V, 3) world [m]."""
    faces: np.ndarray
    """(F, 4 or 3) vertex indices, counter-clockwise seen from outside."""
    uv: np.ndarray
    """(F, 4 or 3, 2) picture coordinates per corner; (0, 0) is the picture's lower left."""
    smooth: bool
    """Whether shading is interpolated across faces."""


def mesh_of(thing: Thing, rng: np.random.Generator) -> Mesh:
    """The mesh of a thing, in the world."""
    if thing.solid in ("box", "taper"):
        unit, faces, uv = _box(thing.size_m, thing.picture_m)
        if thing.solid == "taper":
            unit = np.where(unit[:, 2:] > 0, unit * TAPER, unit)
    elif thing.solid in ("cylinder", "wheel"):
        unit, faces, uv = _cylinder(32)
        if thing.solid == "wheel":
            unit = unit[:, [0, 2, 1]] * [1, 1, -1]  # the axis from z to y, still right-handed
    else:
        unit, faces, uv = _blob(28, 18, rng)
    placed_m = unit * thing.size_m @ about_z(thing.yaw_rad).T + thing.centre_m
    return Mesh(placed_m, faces, uv, smooth=thing.solid == "blob")


def ground_mesh(centre_m: np.ndarray, side_m: float) -> Mesh:
    """A square at z = 0."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side_m / 2 + centre_m
    uv = np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]], dtype=np.float64)
    return Mesh(np.c_[corners, np.zeros(4)], np.array([[0, 1, 2, 3]]), uv, False)


def _box(
    size_m: np.ndarray, picture_m: tuple[float, float] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit cube; the picture stands upright on its four sides, starting at the front (-y)."""
    vertices = np.array([(x, y, z) for z in (-0.5, 0.5) for x, y in _SQUARE])
    sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    faces = np.array([*sides, (4, 5, 6, 7), (3, 2, 1, 0)])
    uv = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64), (6, 1, 1))
    if picture_m is not None:
        lengths_m = [size_m[0], size_m[1], size_m[0], size_m[1], size_m[0], size_m[0]]
        heights_m = [size_m[2]] * 4 + [size_m[1]] * 2
        uv[..., 0] *= np.array(lengths_m)[:, None] / picture_m[0]
        uv[..., 1] *= np.array(heights_m)[:, None] / picture_m[1]
    return vertices, faces, uv


_SQUARE = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))


def _cylinder(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit cylinder with the picture once round it and fans of quads on top and bottom."""
    angles = np.arange(n) * 2 * np.pi / n
    ring = np.c_[np.cos(angles), np.sin(angles)] / 2
    vertices = np.r_[np.c_[ring, np.full(n, -0.5)], np.c_[ring, np.full(n, 0.5)]]
    k = np.arange(n)
    sides = np.c_[k, (k + 1) % n, n + (k + 1) % n, n + k]
    u = np.c_[k, k + 1, k + 1, k] / n
    v = np.tile([0.0, 0.0, 1.0, 1.0], (n, 1))
    pairs = np.arange(1, n - 2, 2)
    top = np.c_[np.zeros_like(pairs), pairs, pairs + 1, pairs + 2] + n
    caps = np.r_[top, (top - n)[:, ::-1]]
    uv = np.r_[np.stack([u, v], axis=-1), vertices[caps][..., :2] * 0.5 + 0.5]
    return vertices, np.r_[sides, caps], uv


def _blob(
    n: int, rings: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A lumpy unit ball: foliage."""
    polar = np.pi * (np.arange(rings + 1) / rings)[:, None]
    azimuth = 2 * np.pi * (np.arange(n) / n)[None]
    ball = np.stack(
        [
            np.sin(polar) * np.cos(azimuth),
            np.sin(polar) * np.sin(azimuth),
            np.cos(polar) + 0 * azimuth,
        ],
        axis=-1,
    ).reshape(-1, 3)
    waves = rng.normal(0, 3.0, (3, 24))
    lumps = np.sin(ball @ waves + rng.uniform(0, 2 * np.pi, 24)).mean(axis=1)
    vertices = ball * (0.5 + 0.55 * lumps[:, None])
    i, k = (a.ravel() for a in np.meshgrid(np.arange(rings), np.arange(n), indexing="ij"))
    faces = np.stack(
        [i * n + k, (i + 1) * n + k, (i + 1) * n + (k + 1) % n, i * n + (k + 1) % n], -1
    )
    u = np.stack([k, k, k + 1, k + 1], axis=-1) / n * 2
    v = 1 - np.stack([i, i + 1, i + 1, i], axis=-1) / rings
    return vertices, faces, np.stack([u, v], axis=-1)
