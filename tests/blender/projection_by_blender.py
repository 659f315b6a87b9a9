"""Runs in its own process: project points with Blender's own function, print them as JSON [px].

Usage: projection_by_blender.py cameras.npz ..., each with arrays intrinsics_px, size_px,
world_from_cam (N, 4, 4) and points_world_m (N, P, 3).
"""

import json
import sys
from typing import Any

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from blender.camera import animate_camera, make_camera, read_back
from gmrdata.values.camera import CameraPath


def answer(path: str) -> dict[str, Any]:
    arrays = np.load(path)
    width_px, height_px = (int(v) for v in arrays["size_px"])
    transforms = arrays["world_from_cam"]
    wanted = CameraPath(
        arrays["intrinsics_px"],
        width_px,
        height_px,
        transforms,
        np.ones(len(transforms), dtype=bool),
    )
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = make_camera(scene, wanted)
    animate_camera(camera, transforms)
    used = read_back(scene, camera, wanted)
    points_px = []
    for row, points_m in enumerate(arrays["points_world_m"]):
        scene.frame_set(row)
        views = [world_to_camera_view(scene, camera, Vector(p)) for p in points_m]
        # Blender's view coordinates are 0..1 from the lower left corner.
        points_px.append([[v.x * width_px, (1 - v.y) * height_px] for v in views])
    return {
        "points_px": points_px,
        "intrinsics_px": used.intrinsics_px.tolist(),
        "world_from_cam": used.world_from_cam.tolist(),
    }


sys.stdout.write("\nANSWER " + json.dumps([answer(path) for path in sys.argv[1:]]) + "\n")
