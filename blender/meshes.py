# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of the solids as arrays: vertices, quads, and picture coordinates per corner."""

from dataclasses import dataclass

import numpy as np

from blender.layout import Thing

TAPER = np.array([0.66, 0.84, 1.0])
"""The top of a tapering box, as a share of its foot."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A quad mesh."""

    vertices_m: np.ndarray
    """(V, 3) world [m]."""
    faces: np.ndarray
    """(F, 4) vertex indices, counter-clockwise seen from outside."""
    uv: np.ndarray
    """(F, 4, 2) picture coordinates per corner; (0, 0) is the picture's lower left."""
    smooth: bool
    """Whether shading is interpolated across faces."""


def mesh_of(thing: Thing, rng: np.random.Generator) -> Mesh:
    """The mesh of a thing, in the world."""
    if thing.solid == "box":
        unit, faces, uv, smooth = (*_box(thing.size_m, thing.picture_m), False)
    elif thing.solid == "taper":
        unit, faces, uv, smooth = (*_box(thing.size_m, thing.picture_m), False)
        unit = np.where(unit[:, 2:] > 0, unit * TAPER, unit)
    elif thing.solid == "cylinder":
        unit, faces, uv, smooth = (*_cylinder(32), False)
    elif thing.solid == "wheel":
        unit, faces, uv, smooth = (*_cylinder(32), False)
        unit = unit[:, [0, 2, 1]] * [1, 1, -1]  # the axis from z to y, still right-handed
    else:
        unit, faces, uv, smooth = (*_blob(28, 18, rng), True)
    cos, sin = np.cos(thing.yaw_rad), np.sin(thing.yaw_rad)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return Mesh(unit * thing.size_m @ turn.T + thing.centre_m, faces, uv, smooth)


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
