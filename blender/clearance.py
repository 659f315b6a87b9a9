# SPDX-License-Identifier: GPL-3.0-or-later
"""Nobody in a wall: whether a person or the camera goes through a backdrop's surfaces.

Do the camera and the person keep clear of what stands about?  Asked of the meshes themselves.

The places are laid out so that they do; this measures it on every clip, whatever put the things
there.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from gmrdata.film.render_outputs import Clearance
from gmrdata.values.body import PARENTS
from gmrdata.values.errors import BadBackdrop, RenderFailed

WALL_M = 1.0
"""Walls are thinner than this, rooms wider."""


def require_clear(
    scene: Any,
    path: Path,
    joints_m: np.ndarray,
    centres_m: np.ndarray,
    others_m: Mapping[str, np.ndarray],
) -> None:
    """Check what moves against all surfaces of a scene that holds none of it yet.

    A surface counts that lies across a bone, or across a way from a frame to the next; so does a
    solid thinner than `WALL_M` round the pelvis, the camera or another mover, and what lies between
    the camera and the pelvis in every frame.

    Args:
        scene: The bpy scene.
        path: The backdrop's file, for the message.
        joints_m: (T, 24, 3) the person's joints, world [m].
        centres_m: (T, 3) the camera's places, world [m].
        others_m: `{name: (T, 3)}` the ways of the extras, world [m].

    Raises:
        BadBackdrop: something is in the way; the message names it and the frame.
    """
    graph = bpy.context.evaluated_depsgraph_get()
    paths_m = {"the camera": centres_m, "the person": joints_m[:, 0], **others_m}
    hiding = [_between(scene, graph, *ends) for ends in zip(centres_m, joints_m[:, 0], strict=True)]
    for row, joints in enumerate(joints_m):
        after = min(row + 1, len(joints_m) - 1)
        ways = [(who, path_m[row], path_m[after]) for who, path_m in paths_m.items()]
        ways += [("the person", joints[PARENTS[j]], joints[j]) for j in range(1, len(joints))]
        for number, (who, start_m, stop_m) in enumerate(ways):
            thing = _between(scene, graph, start_m, stop_m)
            if thing is None and number < len(paths_m):
                thing = _wall_round(scene, graph, start_m)
            if thing is not None:
                raise _in_the_way(path, f"in frame {row} {who} goes through {thing!r}")
    if all(hiding):
        raise _in_the_way(path, f"{hiding[0]!r} hides the person from the camera in every frame")


def _in_the_way(path: Path, what: str) -> BadBackdrop:
    return BadBackdrop(
        f"{path}: {what}; choose another backdrop.origin_m or yaw_deg, another camera, another "
        "scene.seed for extras, or allow_collisions: true"
    )


def _wall_round(scene: Any, graph: Any, place_m: np.ndarray) -> str | None:
    """Name of a solid round a point that is thinner than a wall can be, if any.

    From inside a solid one sees the back sides of its faces, as in a room that is a turned-out box;
    a room is wider than a wall.
    """
    for axis in (Vector((1, 0, 0)), Vector((0, 1, 0))):
        thickness_m, names = 0.0, []
        for way in (axis, -axis):
            hit, place, normal, _, thing, _ = scene.ray_cast(
                graph, Vector(place_m), way, distance=WALL_M
            )
            if hit and normal.dot(way) > 0:
                names.append(str(thing.name))
                thickness_m += (place - Vector(place_m)).length
        if len(names) == 2 and names[0] == names[1] and thickness_m < WALL_M:
            return names[0]
    return None


def _between(scene: Any, graph: Any, start_m: np.ndarray, stop_m: np.ndarray) -> str | None:
    """Name of the first object with a surface between two points, if any."""
    way = Vector(stop_m) - Vector(start_m)
    if not way.length:
        return None
    hit, _, _, _, thing, _ = scene.ray_cast(
        graph, Vector(start_m), way.normalized(), distance=way.length
    )
    return str(thing.name) if hit else None


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
