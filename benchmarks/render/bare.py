"""Runs in its own process, without gmrdata: what Blender alone takes to render a saved scene.

Usage: bare.py scene.blend OUT_DIR JPEG_QUALITY.  Engine, samples and threads are those in the file;
the frames go to OUT_DIR/frames as JPEG, the masks to OUT_DIR/masks as PNG.
"""

import os
import sys

PROCESSORS = os.sched_getaffinity(0)
# As the stage does: with more processors in sight than threads, Blender's pool spins beside them.
os.sched_setaffinity(0, set(sorted(PROCESSORS)[:1]))
import bpy  # noqa: E402

os.sched_setaffinity(0, PROCESSORS)
blend, out_dir, quality = sys.argv[1], sys.argv[2], int(sys.argv[3])
bpy.ops.wm.open_mainfile(filepath=blend)
scene = bpy.context.scene
scene.render.filepath = f"{out_dir}/frames/"
scene.render.image_settings.file_format = "JPEG"
scene.render.image_settings.quality = quality
for node in scene.compositing_node_group.nodes:
    if node.bl_idname == "CompositorNodeOutputFile":
        node.directory = f"{out_dir}/masks/"
bpy.ops.render.render(animation=True)
