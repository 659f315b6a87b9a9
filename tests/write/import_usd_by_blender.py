"""Runs in its own process: import a USD file with Blender's own importer, save what moves.

Usage: import_usd_by_blender.py take.usdc out.npz row...
Saves `joints_m` (rows, 24, 3) of the bones of the armature, in the order of `names`, `vertices_m`
(rows, V, 3) of the skinned body, and of the camera object `world_from_camera` (rows, 4, 4) in
Blender's axes and its `lens_mm`, `sensor_mm`, `shift`.
"""

import sys

import bpy
import numpy as np

usd, out, *numbers = sys.argv[1:]
rows = [int(number) for number in numbers]

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=usd)
armature = next(one for one in bpy.data.objects if one.type == "ARMATURE")
body = next(one for one in bpy.data.objects if one.type == "MESH")
camera = next(one for one in bpy.data.objects if one.type == "CAMERA")
joints_m, vertices_m, world_from_camera = [], [], []
for row in rows:
    bpy.context.scene.frame_set(row)
    graph = bpy.context.evaluated_depsgraph_get()
    joints_m.append([list(armature.matrix_world @ bone.head) for bone in armature.pose.bones])
    evaluated = body.evaluated_get(graph)
    flat = np.empty(3 * len(evaluated.to_mesh().vertices))
    evaluated.to_mesh().vertices.foreach_get("co", flat)
    world_from_body = np.array(evaluated.matrix_world)
    vertices_m.append(flat.reshape(-1, 3) @ world_from_body[:3, :3].T + world_from_body[:3, 3])
    world_from_camera.append(np.array(camera.evaluated_get(graph).matrix_world))
np.savez(
    out,
    joints_m=joints_m,
    vertices_m=vertices_m,
    names=[bone.name for bone in armature.pose.bones],
    world_from_camera=world_from_camera,
    lens_mm=camera.data.lens,
    sensor_mm=[camera.data.sensor_width, camera.data.sensor_height],
    shift=[camera.data.shift_x, camera.data.shift_y],
    fps_hz=bpy.context.scene.render.fps / bpy.context.scene.render.fps_base,
)
