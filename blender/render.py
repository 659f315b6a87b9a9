# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a clip: one frame after another, each with its mask and passes, complete or absent."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np

from blender.clearance import measure_clearance
from blender.engine import as_output, new_compositor, set_up_render, traced, write_to_file
from blender.objects import MOVING_PASS
from blender.passes import add_surface_output, set_step, wants_surface, write_surface
from blender.scene import ClipScene, build_scene, save_blend
from blender.visibility import visible_joints
from gmrdata.film.render import EXTRAS_FOLDER, FRAME_LINE, RenderJob, frame_files
from gmrdata.film.render_outputs import CLEARANCE_FILE, project_joints
from gmrdata.film.scene import save_extras
from gmrdata.read.frames import write_image
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import CHARACTER_FILE, Clip, save_character, save_clip, save_joints
from gmrdata.values.errors import RenderFailed

WORK_FOLDER = ".unfinished"
SCENE_FOLDER = "scene"


def render(job: RenderJob, clip: Clip, body: BodyModel, wanted: CameraPath) -> None:
    """Fill `job.out_dir` with frames/, masks/, what the recipe asks for besides, and clip.npz."""
    config, n_frames = job.config, clip.motion.n_frames
    work_dir = job.out_dir / WORK_FOLDER
    shutil.rmtree(work_dir, ignore_errors=True)
    work_dir.mkdir(parents=True)
    scene_dir = job.out_dir / SCENE_FOLDER if config.blend else work_dir
    scene_dir.mkdir(exist_ok=True)
    clip_scene = build_scene(job, clip, body, wanted, scene_dir)
    scene, used = clip_scene.scene, clip_scene.camera
    if config.scene.backdrop is None:  # a backdrop was looked at when the scene was built
        _check_clearance(clip_scene, clip, job.out_dir)
    set_up_render(scene, job)
    if config.blend:  # without our outputs: whoever renders it would write to this folder
        save_blend(clip_scene, scene_dir)
    add_mask_output(scene, work_dir)
    tree = None
    if wants_surface(config):
        tree = add_surface_output(scene, clip_scene.actors, work_dir, config)
    for row in range(n_frames):
        files = frame_files(job.out_dir, config, row, n_frames)
        if not all(file.is_file() for file in files.values()):
            scene.frame_set(row)
            if "flow" in files:
                for actor in clip_scene.actors:
                    set_step(actor, row)
            _render_frame(
                scene, row, work_dir, files["frames"], files["masks"], config.jpeg_quality
            )
            if tree is not None:
                write_surface(scene, tree, work_dir, config, files, used, row)
        print(f"{FRAME_LINE} {row}", flush=True)  # noqa: T201 - the parent process reads it
    _write_truth(job, clip, body, clip_scene)
    shutil.rmtree(work_dir)


def _write_truth(job: RenderJob, clip: Clip, body: BodyModel, clip_scene: ClipScene) -> None:
    """Write clip.npz, when all that the recipe asks for besides is there."""
    config, used = job.config, clip_scene.camera
    rendered = Clip(clip.id, clip.motion, clip.valid, np.arange(clip.motion.n_frames), used)
    if config.joints:
        joints = project_joints(rendered, body)
        seen = visible_joints(
            clip_scene.scene, clip_scene.person, joints.world_m, used.centres_world_m
        )
        save_joints(job.out_dir / "joints.npz", replace(joints, visible=joints.in_frame & seen))
    save_extras(
        job.out_dir / EXTRAS_FOLDER, config.scene.extras.names, clip_scene.cast, rendered, body
    )
    if clip_scene.figure is not None:
        save_character(job.out_dir / CHARACTER_FILE, clip_scene.figure.record(used))
    save_clip(job.out_dir / "clip.npz", rendered, body.rest_pelvis_m(clip.motion.shape))


def _check_clearance(clip_scene: ClipScene, clip: Clip, out_dir: Path) -> None:
    """Write clearance.json; raises RenderFailed when the camera or the person touches a thing."""
    moving = {actor.name for actor in clip_scene.actors}
    still = [o for o in clip_scene.scene.objects if o.type == "MESH" and o.name not in moving]
    clearance = measure_clearance(still, clip_scene.camera.centres_world_m, clip.motion.pelvis_m)
    if clearance is not None:
        clearance.write(out_dir / CLEARANCE_FILE)


def add_mask_output(scene: Any, work_dir: Path) -> None:
    """Let the compositor write coverage.png: the share of each pixel that moves by itself."""
    aov = scene.view_layers[0].aovs.add()
    aov.name, aov.type = MOVING_PASS, "VALUE"
    tree, layers = new_compositor("masks")
    scene.compositing_node_group = tree
    coverage = layers.outputs[MOVING_PASS]
    write_to_file(tree, coverage, "FLOAT", work_dir / "coverage", ("PNG", "BW", "8"))


def _render_frame(
    scene: Any, row: int, work_dir: Path, frame: Path, mask: Path, jpeg_quality: int
) -> None:
    scene.cycles.seed = row
    scene.render.filepath = as_output(work_dir / "frame.bmp")
    bpy.ops.render.render(write_still=True)
    if scene.render.engine != "CYCLES":  # EEVEE's edges lie up to a pixel off
        with traced(scene):
            bpy.ops.render.render(write_still=False)
    picture = cv2.imread(str(work_dir / "frame.bmp"), cv2.IMREAD_COLOR)
    coverages = list(work_dir.glob("*coverage*.png"))
    if picture is None or len(coverages) != 1:
        raise RenderFailed(f"frame {row}: Blender wrote no picture or no mask to {work_dir}")
    coverage = cv2.imread(str(coverages[0]), cv2.IMREAD_GRAYSCALE)
    if coverage is None:
        raise RenderFailed(f"frame {row}: Blender wrote a mask that is no picture")
    coverages[0].unlink()
    # By OpenCV, which writes no dates.
    write_image(mask, np.where(coverage >= 128, 255, 0).astype(np.uint8))
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if frame.suffix == ".jpg" else []
    write_image(frame, picture, options)
