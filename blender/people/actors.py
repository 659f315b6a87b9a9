# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that moves, as meshes whose vertices Blender reads from a cache on disk.

The cache makes the motion a part of the scene: Blender finds the vertices of any moment by itself,
between two frames as well, which motion blur needs, and a saved .blend plays.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blender.objects import add_object

FIRST_SAMPLE = -1
"""Frame of the cache's first sample: one before the clip, for a shutter that opens early."""


@dataclass(frozen=True, eq=False)
class Actor:
    """Someone or something that moves."""

    name: str
    """Name of its bpy object, which a backdrop may have taken from its mesh."""
    object: Any
    """The bpy object."""
    vertices_m: np.ndarray
    """(T, V, 3) vertices, world [m]."""
    joint_of_face: np.ndarray | None = None
    """(F,) joint that each face of a person moves with; None for what has no joints."""

    @property
    def mesh(self) -> Any:
        """The bpy mesh."""
        return self.object.data


def add_actor(
    scene: Any,
    mesh: Any,
    vertices_m: np.ndarray,
    cache_path: Path,
    *,
    joint_of_face: np.ndarray | None = None,
) -> Actor:
    """Put a bpy mesh into the scene and let it move.

    Args:
        scene: The bpy scene.
        mesh: The bpy mesh, with its materials; its V vertices may be anywhere.
        vertices_m: (T, V, 3) where its vertices are in the frames 0 to T - 1, world [m].
        cache_path: The cache file to write; it must stay there while Blender renders.
        joint_of_face: (F,) joint that each face of a person moves with.
    """
    write_vertex_cache(cache_path, vertices_m)
    thing = add_object(scene, mesh.name, mesh)
    cache = thing.modifiers.new("motion", "MESH_CACHE")
    cache.cache_format = "PC2"
    cache.filepath = str(cache_path)
    cache.frame_start = FIRST_SAMPLE
    return Actor(thing.name, thing, vertices_m, joint_of_face)


def write_vertex_cache(path: Path, vertices_m: np.ndarray) -> None:
    """Write vertices (T, V, 3) as a PC2 file: a header of 32 bytes, then little-endian floats.

    A sample before the first frame and one after the last continue the motion.
    """
    n_frames, n_vertices = vertices_m.shape[:2]
    second, second_last = min(1, n_frames - 1), max(n_frames - 2, 0)
    with path.open("wb") as file:
        file.write(
            struct.pack("<12siiffi", b"POINTCACHE2", 1, n_vertices, FIRST_SAMPLE, 1.0, n_frames + 2)
        )
        file.write(_floats(2 * vertices_m[0] - vertices_m[second]))
        for vertices in vertices_m:
            file.write(_floats(vertices))
        file.write(_floats(2 * vertices_m[-1] - vertices_m[second_last]))


def _floats(vertices_m: np.ndarray) -> bytes:
    return np.ascontiguousarray(vertices_m, dtype="<f4").tobytes()
