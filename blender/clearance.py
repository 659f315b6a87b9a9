# SPDX-License-Identifier: GPL-3.0-or-later
"""Do the camera and the person keep clear of what stands about?  Asked of the meshes themselves.

The places are laid out so that they do; this measures it on every clip, whatever put the things
there.
"""

from typing import Any

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from gmrdata.film.render_outputs import Clearance
from gmrdata.values.errors import RenderFailed

GROUND = "ground"
"""Name of the ground's object, which people stand on."""
NEAREST_M = 0.05
"""From here on a path touches: nearer than this Blender's camera sees nothing."""

REMEDY = "take another scene.seed, or give the camera another height_m or distance_m"


def measure_clearance(
    objects: list[Any], camera_m: np.ndarray, pelvis_m: np.ndarray
) -> Clearance | None:
    """Measure the clearance of a clip's paths.

    Args:
        objects: The bpy mesh objects that don't move.
        camera_m: (T, 3) optical centres, world [m].
        pelvis_m: (T, 3) pelvis, world [m].

    Returns:
        None when there is nothing to come near to.

    Raises:
        RenderFailed: a path leads through a thing or touches it, or something hides the pelvis in
            every frame, as when the camera is inside of it.
    """
    surfaces = _surfaces([thing for thing in objects if thing.name != GROUND])
    if surfaces is None:
        return None
    hidden = [_meets(surfaces, *ends) for ends in zip(camera_m, pelvis_m, strict=True)]
    if all(hidden):
        raise RenderFailed(f"something hides the person from the camera in every frame; {REMEDY}")
    return Clearance(
        camera_m=_along("camera", camera_m, surfaces),
        person_m=_along("person", pelvis_m, surfaces),
        sight_share=1.0 - float(np.mean(hidden)),
    )


def _surfaces(things: list[Any]) -> BVHTree | None:
    """The faces of all things, in the world."""
    vertices: list[Any] = []
    faces: list[list[int]] = []
    for thing in things:
        first = len(vertices)
        vertices += [thing.matrix_world @ vertex.co for vertex in thing.data.vertices]
        faces += [[first + index for index in face.vertices] for face in thing.data.polygons]
    return BVHTree.FromPolygons(vertices, faces) if faces else None


def _along(who: str, path_m: np.ndarray, surfaces: BVHTree) -> float:
    """Smallest distance of the places (T, 3) to a surface [m]."""
    smallest_m = np.inf
    for row, point in enumerate(path_m):
        distance_m = surfaces.find_nearest(Vector(point))[3]
        if distance_m < NEAREST_M or (row > 0 and _meets(surfaces, path_m[row - 1], point)):
            raise RenderFailed(
                f"frame {row}: the {who}'s path leads through something that stands there; {REMEDY}"
            )
        smallest_m = min(smallest_m, distance_m)
    return round(smallest_m, 4)


def _meets(surfaces: BVHTree, start_m: np.ndarray, end_m: np.ndarray) -> bool:
    """Whether a surface is on the straight way between two points (3,)."""
    way = Vector(end_m) - Vector(start_m)
    if way.length == 0:
        return False
    return surfaces.ray_cast(Vector(start_m), way.normalized(), way.length)[0] is not None
