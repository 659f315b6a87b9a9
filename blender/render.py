# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a clip: one frame after another, each with its mask and passes, complete or absent."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np

from blender.camera import make_camera, place_camera, read_back
from blender.light import Light
from blender.passes import add_surface_output, set_step, wants_surface, write_surface
from blender.person import add_person, pose_person
from blender.places.courtyard import courtyard
from blender.places.park import park
from blender.places.room import room
from blender.places.street import street
from blender.scene import PERSON_PASS, build_yard
from blender.visibility import visible_joints
from gmrdata.body.forward import motion_vertices_m
from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, save_clip
from gmrdata.errors import RenderFailed
from gmrdata.geometry.camera import CameraPath
from gmrdata.joints2d import project_joints, save_joints
from gmrdata.render import FRAME_LINE, RenderJob, frame_files
from gmrdata.store import atomic_path

WORK_FOLDER = ".unfinished"
PLACES = {"courtyard": courtyard, "street": street, "park": park, "room": room}


def render(job: RenderJob, clip: Clip, body: BodyModel, wanted: CameraPath) -> None:
    """Fill `job.out_dir` with frames/, masks/, what the recipe asks for besides, and clip.npz."""
    config, motion = job.config, clip.motion
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    # Separate streams, so that a change of the clothes leaves the yard as it is.
    yard_rng, mesh_rng, person_rng = (
        np.random.default_rng(seed) for seed in np.random.SeedSequence(config.scene.seed).spawn(3)
    )
    camera = make_camera(scene, wanted)
    used = read_back(scene, camera, wanted)
    paths_m = motion.pelvis_m, wanted.centres_world_m
    light = Light(config.scene.lit_by, _sun_azimuth_rad(*paths_m))
    yard = PLACES[config.scene.kind](*paths_m, yard_rng)
    build_yard(scene, yard, light, config.scene.hdri_path, mesh_rng)
    vertices_m = motion_vertices_m(body, motion)
    person = add_person(scene, body, motion.shape, vertices_m[0], light, person_rng)
    work_dir = job.out_dir / WORK_FOLDER
    shutil.rmtree(work_dir, ignore_errors=True)
    work_dir.mkdir(parents=True)
    set_up_cycles(scene, job)
    add_mask_output(scene, work_dir)
    tree = add_surface_output(scene, person, work_dir, config) if wants_surface(config) else None
    for row in range(motion.n_frames):
        files = frame_files(job.out_dir, config, row, motion.n_frames)
        if not all(file.is_file() for file in files.values()):
            place_camera(camera, used.world_from_cam[row])
            pose_person(person, vertices_m[row])
            if "flow" in files:
                set_step(person, vertices_m[row + 1] - vertices_m[row])
            _render_frame(
                scene, row, work_dir, files["frames"], files["masks"], config.jpeg_quality
            )
            if tree is not None:
                write_surface(scene, tree, work_dir, config, files, used, row)
        print(f"{FRAME_LINE} {row}", flush=True)  # noqa: T201 - the parent process reads it
    shutil.rmtree(work_dir)
    rendered = Clip(clip.id, motion, clip.valid, np.arange(motion.n_frames), used)
    if config.joints:
        joints = project_joints(rendered, body)
        seen = visible_joints(scene, person, body, vertices_m, joints.world_m, used.centres_world_m)
        save_joints(job.out_dir / "joints.npz", replace(joints, visible=joints.in_frame & seen))
    save_clip(job.out_dir / "clip.npz", rendered, body.rest_pelvis_m(motion.shape))


def set_up_cycles(scene: Any, job: RenderJob) -> None:
    """Cycles on the CPU, without anything that differs from run to run."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device = "CPU"
    cycles.samples = job.config.samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_light_tree = False  # one lamp
    cycles.max_bounces = 0  # the sky's light is in the materials
    render.use_persistent_data = True
    render.threads_mode = "FIXED"
    render.threads = job.threads
    render.use_compositing = True
    render.use_sequencer = False
    scene.view_settings.view_transform = "Standard"
    # Uncompressed, since it is read back at once.
    render.image_settings.file_format = "BMP"
    render.image_settings.color_mode = "RGB"


def add_mask_output(scene: Any, work_dir: Path) -> None:
    """Let the compositor write the share of each pixel that the person covers, as coverage.png."""
    aov = scene.view_layers[0].aovs.add()
    aov.name, aov.type = PERSON_PASS, "VALUE"
    tree = bpy.data.node_groups.new("masks", "CompositorNodeTree")
    scene.compositing_node_group = tree
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.links.new(layers.outputs["Image"], tree.nodes.new("NodeGroupOutput").inputs[0])
    files = tree.nodes.new("CompositorNodeOutputFile")
    files.directory, files.file_name = str(work_dir), ""
    files.file_output_items.new("FLOAT", "coverage")
    files.save_as_render = False
    files.format.media_type = "IMAGE"
    files.format.file_format = "PNG"
    files.format.color_mode, files.format.color_depth = "BW", "8"
    tree.links.new(layers.outputs[PERSON_PASS], files.inputs[0])


def _render_frame(
    scene: Any, row: int, work_dir: Path, frame: Path, mask: Path, jpeg_quality: int
) -> None:
    scene.cycles.seed = row
    scene.frame_set(row)
    scene.render.filepath = str(work_dir / "frame.bmp")
    bpy.ops.render.render(write_still=True)
    picture = cv2.imread(str(work_dir / "frame.bmp"), cv2.IMREAD_COLOR)
    coverages = list(work_dir.glob("*coverage*.png"))
    if picture is None or len(coverages) != 1:
        raise RenderFailed(f"frame {row}: Blender wrote no picture or no mask to {work_dir}")
    coverage = cv2.imread(str(coverages[0]), cv2.IMREAD_GRAYSCALE)
    coverages[0].unlink()
    _write_image(mask, np.where(coverage >= 128, 255, 0).astype(np.uint8), [])
    _write_image(frame, picture, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])


def _write_image(path: Path, pixels: np.ndarray, options: list[int]) -> None:
    """Encode with OpenCV, which writes no dates, and put the file in place when it is complete."""
    _, encoded = cv2.imencode(path.suffix, pixels, options)
    with atomic_path(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def _sun_azimuth_rad(subject_m: np.ndarray, camera_m: np.ndarray) -> float:
    """Sun from behind the camera, off to a side, as seen at the middle of the clip."""
    x, y = (camera_m - subject_m)[len(camera_m) // 2, :2]
    return float(np.arctan2(y, x) + np.deg2rad(55))
