"""Runs in its own process, without gmrdata: where Blender itself sees points of a saved scene.

Usage: views.py scene.blend points.npy answer.npy, with points (T, P, 3) in the world [m]; the
answer is (T, P, 2) pixels from the upper left corner.
"""

import sys

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
size_px = scene.render.resolution_x, scene.render.resolution_y
answer = []
for row, points_m in enumerate(np.load(sys.argv[2])):
    scene.frame_set(row)
    views = [world_to_camera_view(scene, scene.camera, Vector(point)) for point in points_m]
    answer.append([[view.x * size_px[0], (1 - view.y) * size_px[1]] for view in views])
np.save(sys.argv[3], answer)
