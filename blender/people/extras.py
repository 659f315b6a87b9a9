# SPDX-License-Identifier: GPL-3.0-or-later
"""Company, passers-by and cars as actors."""

from pathlib import Path
from typing import Any

import numpy as np

from blender.light import Light
from blender.objects import bpy_mesh, moving_picture_material
from blender.people.actors import Actor, add_actor
from blender.people.person import person_mesh
from blender.places.car import car_things, moved_vertices_m
from blender.places.layout import Mesh, mesh_of
from gmrdata.film.scene import Cast, SceneConfig, looks_of
from gmrdata.film.walkers import Drive
from gmrdata.motion.resample import slice_motion
from gmrdata.values.body import BodyModel
from gmrdata.values.skinning import motion_vertices_m


def add_extras(
    scene: Any,
    config: SceneConfig,
    cast: Cast,
    n_frames: int,
    body: BodyModel,
    light: Light,
    cache_dir: Path,
) -> tuple[Actor, ...]:
    """Put the extras into the scene; gives them in the order of their instance numbers.

    Args:
        scene: The bpy scene.
        config: The recipe of the place, whose extras these are.
        cast: Who they are and where they go.
        n_frames: How many frames the clip has; the extras may have more.
        body: The people's body.
        light: What falls on the place.
        cache_dir: Gets the vertex caches.
    """
    names, actors = config.extras.names, []
    for name, motion in zip(names, cast.walkers, strict=False):
        walk, rng = slice_motion(motion, 0, n_frames), looks_of(name, config.seed)
        vertices_m = motion_vertices_m(body, walk)
        mesh = person_mesh(name, body, walk.shape, vertices_m[0], light, rng)
        actors.append(add_actor(scene, mesh, vertices_m, cache_dir / f"{name}.pc2"))
    for name, drive in zip(names[len(cast.walkers) :], cast.cars, strict=True):
        mesh, vertices_m = driving_car(name, drive, light, looks_of(name, config.seed))
        actors.append(add_actor(scene, mesh, vertices_m[:n_frames], cache_dir / f"{name}.pc2"))
    return tuple(actors)


def driving_car(
    name: str, drive: Drive, light: Light, rng: np.random.Generator
) -> tuple[Any, np.ndarray]:
    """A car whose wheels turn as it goes: a bpy mesh, and its vertices (T, V, 3), world [m].

    Args:
        name: Name of the mesh; those of its materials begin with it.
        drive: Where it goes.
        light: What falls on it.
        rng: Chooses its paint.
    """
    things = car_things(np.zeros(2), 0.0, rng)
    parts = [mesh_of(thing, rng) for thing in things]
    starts = np.cumsum([0, *(len(part.vertices_m) for part in parts[:-1])])
    rest_m = np.concatenate([part.vertices_m for part in parts])
    faces = np.concatenate([part.faces + n for part, n in zip(parts, starts, strict=True)])
    uv = np.concatenate([part.uv for part in parts])
    slots = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    materials = [
        moving_picture_material(f"{name}_{slot}", thing.picture, light)
        for slot, thing in enumerate(things)
    ]
    data = bpy_mesh(name, Mesh(rest_m, faces, uv, smooth=False), materials)
    data.polygons.foreach_set("material_index", slots.astype(np.int32))
    data.update()
    wheels = [
        (slice(start, start + len(part.vertices_m)), thing.centre_m)
        for part, thing, start in zip(parts, things, starts, strict=True)
        if thing.solid == "wheel"
    ]
    return data, moved_vertices_m(rest_m, wheels, drive)
