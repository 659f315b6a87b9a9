"""Runs in its own process: a plain script that sets up the scene anew for each frame.

Usage: anew.py job.json N_FRAMES.  The job lays the place out for its whole clip.  One process and
one import serve all frames, which is milder than a Blender start for each, and only the frame's own
pose is computed; the scene is built with the stage's own code.
"""

import sys
from dataclasses import replace
from pathlib import Path

from blender.__main__ import import_bpy, read_job
from gmrdata.film.render import RenderJob
from gmrdata.motion.resample import slice_motion
from gmrdata.read.body_file import read_body
from gmrdata.values.clip import camera_of, load_clip

job = read_job(Path(sys.argv[1]), RenderJob)
clip, body = load_clip(job.clip_path), read_body(job.body_path)
import_bpy(job.threads)

import bpy  # noqa: E402

from blender.engine import set_up_render  # noqa: E402
from blender.render import add_mask_output  # noqa: E402
from blender.scene import build_scene  # noqa: E402

job.out_dir.mkdir(parents=True)
for row in range(int(sys.argv[2])):
    camera = replace(
        camera_of(clip),
        world_from_cam=camera_of(clip).world_from_cam[[row]],
        has_camera=camera_of(clip).has_camera[[row]],
    )
    alone = replace(clip, motion=slice_motion(clip.motion, row, row + 1))
    scene = build_scene(job, alone, body, camera, job.out_dir).scene
    set_up_render(scene, job)
    add_mask_output(scene, job.out_dir)
    scene.frame_set(0)
    scene.cycles.seed = row
    scene.render.image_settings.file_format = "JPEG"
    scene.render.filepath = str(job.out_dir / f"{row:05d}.jpg")
    bpy.ops.render.render(write_still=True)
