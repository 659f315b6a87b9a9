# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m blender.preview job.json [--parent PID]`: a few small frames of a clip, in a hurry."""

import sys
import tempfile
from pathlib import Path
from typing import Any

from blender.__main__ import camera_of, import_bpy, parse, read_job, run
from gmrdata.film.render import FRAME_LINE, PreviewJob
from gmrdata.read.body_file import read_body
from gmrdata.values.clip import load_clip

SKY = (0.55, 0.68, 0.80)
PERSON = (0.10, 0.25, 0.75, 1.0)
"""Workbench shows no vertex colours beside pictures; so the person stands out."""


def preview(job_path: Path) -> None:
    """Render the frames that the job file names to `frames/`, numbered from 0."""
    job = read_job(job_path, PreviewJob)
    clip, body = load_clip(job.render.clip_path), read_body(job.render.body_path)
    wanted = camera_of(job.render, clip, body)
    import_bpy(job.render.threads)
    import bpy

    from blender.engine import as_output, set_up_cycles, set_up_output
    from blender.scene import build_scene

    with tempfile.TemporaryDirectory(prefix="gmrdata-") as work_dir:
        clip_scene = build_scene(job.render, clip, body, wanted, Path(work_dir))
        scene = clip_scene.scene
        set_up_output(scene, job.render.threads)
        scene.render.resolution_percentage = job.percent
        scene.render.image_settings.file_format = "JPEG"
        if job.engine == "workbench":
            _set_up_workbench(scene, clip_scene.actors)
        else:
            set_up_cycles(scene, job.render.config.model_copy(update={"samples": 1}))
            scene.render.engine = "CYCLES"
            scene.view_settings.view_transform = "Standard"
        for number, row in enumerate(job.rows):
            scene.frame_set(row)
            scene.render.filepath = as_output(job.render.out_dir / f"frames/{number:05d}.jpg")
            bpy.ops.render.render(write_still=True)
            print(f"{FRAME_LINE} {number}", flush=True)  # noqa: T201 - the parent reads it


def _set_up_workbench(scene: Any, actors: Any) -> None:
    """Flat light, each thing with its picture."""
    import bpy

    scene.render.engine = "BLENDER_WORKBENCH"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = 0.8  # its lamps are dim
    scene.display.render_aa = "FXAA"
    shading = scene.display.shading
    shading.light, shading.color_type = "STUDIO", "TEXTURE"
    for material in bpy.data.materials:
        if material.node_tree is not None:
            for node in material.node_tree.nodes:
                if node.type == "TEX_IMAGE":
                    material.node_tree.nodes.active = node
    for actor in actors:
        for material in actor.mesh.materials:
            material.diffuse_color = PERSON
    if scene.world is None:
        scene.world = bpy.data.worlds.new("sky")
    scene.world.color = SKY


if __name__ == "__main__":
    sys.exit(run(lambda: preview(parse(sys.argv[1:]))))
