# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything of a clip that stands or moves in front of the camera, and the camera, animated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender.camera import animate_camera, make_camera, read_back
from blender.clearance import require_clear
from blender.light import Light
from blender.objects import build_yard
from blender.people.actors import Actor, add_actor
from blender.people.extras import add_extras
from blender.people.person import joint_of_face, person_mesh
from blender.people.rigged import Figure, bring_in
from blender.places.backdrop import add_backdrop
from blender.places.courtyard import courtyard
from blender.places.layout import main_colours, with_ways
from blender.places.park import park
from blender.places.room import room
from blender.places.street import street
from gmrdata.film.render import CAST_FILE, RenderConfig, RenderJob
from gmrdata.film.scene import Cast, load_cast
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import RenderFailed
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

PLACES = {"courtyard": courtyard, "street": street, "park": park, "room": room}


@dataclass(frozen=True, eq=False)
class ClipScene:
    """A scene that is ready to be rendered; row t of the clip is its frame t."""

    scene: Any
    """The bpy scene."""
    camera: CameraPath
    """The camera as Blender uses it."""
    person: Actor
    """The person whose motion is the clip's."""
    cast: Cast
    """Who and what moves besides; perhaps for longer than the clip."""
    extras: tuple[Actor, ...]
    """The same as actors."""
    figure: Figure | None = None
    """What is known of the character that the person is, if it isn't the body."""

    @property
    def actors(self) -> tuple[Actor, ...]:
        """All that moves, in the order of the instance numbers 1, 2, ..."""
        return (self.person, *self.extras)


def build_scene(
    job: RenderJob, clip: Clip, body: BodyModel, wanted: CameraPath, cache_dir: Path
) -> ClipScene:
    """Build the scene of a clip, its body and its camera in an empty Blender.

    `cache_dir` gets the vertex caches, and must stay while Blender renders.
    """
    config, motion = job.config, clip.motion
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 0, motion.n_frames - 1
    scene.render.fps = max(1, round(motion.fps_hz))  # Blender's are whole, and at most 32767
    scene.render.fps_base = scene.render.fps / motion.fps_hz
    # Separate streams, so that a change of the clothes leaves the yard as it is.
    yard_rng, mesh_rng, person_rng = (
        np.random.default_rng(seed) for seed in np.random.SeedSequence(config.scene.seed).spawn(3)
    )
    backdrop = config.scene.backdrop
    if backdrop is not None:  # before all that moves, for it freezes what is there
        add_backdrop(scene, backdrop)
    camera = make_camera(scene, wanted)
    animate_camera(camera, wanted.world_from_cam)
    used = read_back(scene, camera, wanted)  # while nothing else has to move with it
    sharing = [load_clip(path) for path in job.layout_paths] or [clip]
    cast = Cast((), ())
    if config.scene.extras.names:
        cast = load_cast(job.out_dir / CAST_FILE)
    colours = None
    light = Light("traced", 0.0)
    if backdrop is None:
        light = Light(config.scene.lit_by, _sun_azimuth_rad(sharing[0]))
        yard = PLACES[config.scene.kind](*with_ways(*_paths_m(sharing), cast.ground_m), yard_rng)
        build_yard(scene, yard, light, config.scene.hdri_path, mesh_rng)
        colours = main_colours(yard)
    elif not backdrop.allow_collisions:
        joints_m = motion_joints_m(body, motion)
        require_clear(scene, backdrop.path, joints_m, wanted.centres_world_m, _ways_m(config, cast))
    if config.person.seed is not None:
        person_rng = np.random.default_rng(config.person.seed)
    figure = None
    if config.character is None:
        mesh, vertices_m = _person_mesh(config, body, motion, light, colours, person_rng)
        faces_of = joint_of_face(body)
    else:
        figure = bring_in("person", config.character, body, motion, light)
        mesh, vertices_m, faces_of = figure.mesh, figure.vertices_m, figure.joint_of_face
    person = add_actor(scene, mesh, vertices_m, cache_dir / "person.pc2", joint_of_face=faces_of)
    extras = add_extras(scene, config.scene, cast, motion.n_frames, body, light, cache_dir)
    return ClipScene(scene, used, person, cast, extras, figure)


def _person_mesh(
    config: RenderConfig,
    body: BodyModel,
    motion: Motion,
    light: Light,
    surroundings: np.ndarray | None,
    rng: np.random.Generator,
) -> tuple[Any, np.ndarray]:
    """The bpy mesh of the body, dressed, and its vertices (T, V, 3) in the world [m]."""
    vertices_m = motion_vertices_m(body, motion)
    mesh = person_mesh(
        "person",
        body,
        motion.shape,
        vertices_m[0],
        light,
        rng,
        surroundings=surroundings,
        texture=config.person.texture,
    )
    return mesh, vertices_m


def save_blend(clip_scene: ClipScene, folder: Path) -> None:
    """Save the scene as `scene.blend`, next to the vertex caches, so that the folder can move.

    Raises:
        RenderFailed: Blender can't write it.
    """
    caches = [modifier for actor in clip_scene.actors for modifier in actor.object.modifiers]
    full_paths = [cache.filepath for cache in caches]
    for cache in caches:
        cache.filepath = f"//{Path(cache.filepath).name}"
    for image in bpy.data.images:  # our own, and a sky's, which is a file elsewhere
        if image.source in ("GENERATED", "FILE") and image.packed_file is None:
            image.pack()
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), copy=True, compress=True)
    except RuntimeError as error:
        raise RenderFailed(f"{folder / 'scene.blend'}: {error}") from None
    for cache, path in zip(caches, full_paths, strict=True):
        cache.filepath = path


def _paths_m(clips: Sequence[Clip]) -> tuple[np.ndarray, np.ndarray]:
    """Pelvis (N, 3) and camera (N, 3) of all clips that share a place, row by row [m]."""
    pelvis = [clip.motion.pelvis_m for clip in clips]
    camera = [camera_of(clip).centres_world_m for clip in clips]
    return np.concatenate(pelvis), np.concatenate(camera)


def _ways_m(config: RenderConfig, cast: Cast) -> dict[str, np.ndarray]:
    """Where each extra goes, by its name: a pelvis (T, 3), or the middle of a car [m]."""
    ways_m = [walker.pelvis_m for walker in cast.walkers] + [car.centres_m for car in cast.cars]
    return dict(zip(config.scene.extras.names, ways_m, strict=True))


def _sun_azimuth_rad(clip: Clip) -> float:
    """Sun from behind the camera, off to a side, as seen at the middle of the clip."""
    subject_m, camera_m = _paths_m([clip])
    x, y = (camera_m - subject_m)[len(camera_m) // 2, :2]
    return float(np.arctan2(y, x) + np.deg2rad(55))
