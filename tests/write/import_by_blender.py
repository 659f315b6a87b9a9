"""Runs in its own process: import GLB, BVH and USD files with Blender's own importers.

Usage: import_by_blender.py body.glb motion.bvh take.usdc take.glb fps out.npz row...
Saves in Blender's z-up world: of body.glb `glb_vertices_m` (rows, V, 3) of the skinned body; of
the BVH `bvh_joints_m` (rows, 24, 3), the bones in the order of `bvh_names`; of USD `joints_m`,
`names` and `vertices_m` likewise, and of its camera `world_from_camera` (rows, 4, 4) in Blender's
axes and its `lens_mm`, `sensor_mm`, `shift`; of take.glb's camera `glb_world_from_camera`,
`glb_lens_mm`, `glb_sensor_mm`.
"""

import sys
from typing import Any

import bpy
import numpy as np

body_glb, bvh, usd, take_glb, fps, out, *numbers = sys.argv[1:]
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


def joints_m(armature: bpy.types.Object) -> list[list[float]]:
    return [list(armature.matrix_world @ bone.head) for bone in armature.pose.bones]


def afresh() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = int(fps)


def at_rows(first_frame: int = 0) -> Any:
    for row in rows:
        bpy.context.scene.frame_set(row + first_frame)
        yield row


afresh()
bpy.ops.import_scene.gltf(filepath=body_glb)
found["glb_vertices_m"] = [vertices_m(bpy.data.objects["body"]) for _ in at_rows()]

afresh()
bpy.ops.import_anim.bvh(filepath=bvh, global_scale=0.01, frame_start=1)
(armature,) = bpy.data.objects
found["bvh_names"] = [bone.name for bone in armature.pose.bones]
found["bvh_joints_m"] = [joints_m(armature) for _ in at_rows(1)]

afresh()
bpy.ops.wm.usd_import(filepath=usd)
armature, body, camera = only("ARMATURE"), only("MESH"), only("CAMERA")
moving: dict[str, list[Any]] = {"joints_m": [], "vertices_m": [], "world_from_camera": []}
for _ in at_rows():
    moving["joints_m"].append(joints_m(armature))
    moving["vertices_m"].append(vertices_m(body))
    moving["world_from_camera"].append(np.array(evaluated(camera).matrix_world))
found |= moving
found["names"] = [bone.name for bone in armature.pose.bones]
found["lens_mm"] = camera.data.lens
found["sensor_mm"] = [camera.data.sensor_width, camera.data.sensor_height]
found["shift"] = [camera.data.shift_x, camera.data.shift_y]

afresh()
bpy.ops.import_scene.gltf(filepath=take_glb)
camera = only("CAMERA")
found["glb_world_from_camera"] = [np.array(evaluated(camera).matrix_world) for _ in at_rows()]
found["glb_lens_mm"], found["glb_sensor_mm"] = camera.data.lens, camera.data.sensor_height
np.savez(out, **found)
