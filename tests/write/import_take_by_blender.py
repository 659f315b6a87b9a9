"""Runs in its own process: import a USD file and a GLB with Blender's own importers.

Usage: import_take_by_blender.py take.usdc take.glb fps out.npz row...
Saves of the USD file `joints_m` (rows, 24, 3) of the bones of the armature, in the order of
`names`, `vertices_m` (rows, V, 3) of the skinned body, and of the camera `world_from_camera`
(rows, 4, 4) in Blender's axes and its `lens_mm`, `sensor_mm`, `shift`; and of the GLB's camera
`glb_world_from_camera`, `glb_lens_mm`, `glb_sensor_mm`.
"""

import sys
from typing import Any

import bpy
import numpy as np

usd, glb, fps, out, *numbers = sys.argv[1:]
rows = [int(number) for number in numbers]
found: dict[str, Any] = {}


def only(kind: str) -> bpy.types.Object:
    (one,) = (one for one in bpy.data.objects if one.type == kind)
    return one


def evaluated(one: bpy.types.Object) -> bpy.types.Object:
    return one.evaluated_get(bpy.context.evaluated_depsgraph_get())


def vertices_m(body: bpy.types.Object) -> np.ndarray:
    mesh = evaluated(body).to_mesh()
    flat = np.empty(3 * len(mesh.vertices))
    mesh.vertices.foreach_get("co", flat)
    world_from_body = np.array(evaluated(body).matrix_world)
    return flat.reshape(-1, 3) @ world_from_body[:3, :3].T + world_from_body[:3, 3]


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=usd)
armature, body, camera = only("ARMATURE"), only("MESH"), only("CAMERA")
moving: dict[str, list[Any]] = {"joints_m": [], "vertices_m": [], "world_from_camera": []}
for row in rows:
    bpy.context.scene.frame_set(row)
    heads = [list(armature.matrix_world @ bone.head) for bone in armature.pose.bones]
    moving["joints_m"].append(heads)
    moving["vertices_m"].append(vertices_m(body))
    moving["world_from_camera"].append(np.array(evaluated(camera).matrix_world))
found |= moving
found["names"] = [bone.name for bone in armature.pose.bones]
found["lens_mm"] = camera.data.lens
found["sensor_mm"] = [camera.data.sensor_width, camera.data.sensor_height]
found["shift"] = [camera.data.shift_x, camera.data.shift_y]

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = int(fps)
bpy.ops.import_scene.gltf(filepath=glb)
camera = only("CAMERA")
found["glb_world_from_camera"] = []
for row in rows:
    bpy.context.scene.frame_set(row)
    found["glb_world_from_camera"].append(np.array(evaluated(camera).matrix_world))
found["glb_lens_mm"], found["glb_sensor_mm"] = camera.data.lens, camera.data.sensor_height
np.savez(out, **found)
