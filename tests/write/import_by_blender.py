"""Runs in its own process: import a GLB and a BVH with Blender's own importers, save what moves.

Usage: import_by_blender.py body.glb motion.bvh fps out.npz row...
Saves `vertices_m` (rows, V, 3) of the skinned body and `joints_m` (rows, 24, 3) of the BVH's bones
in the order of `names`, in Blender's z-up world.
"""

import sys

import bpy
import numpy as np

glb, bvh, fps, out, *numbers = sys.argv[1:]
rows = [int(number) for number in numbers]

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = int(fps)
bpy.ops.import_scene.gltf(filepath=glb)
body = bpy.data.objects["body"]
vertices_m = []
for row in rows:
    bpy.context.scene.frame_set(row)
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    flat = np.empty(3 * len(mesh.vertices))
    mesh.vertices.foreach_get("co", flat)
    world_from_body = np.array(evaluated.matrix_world)
    vertices_m.append(flat.reshape(-1, 3) @ world_from_body[:3, :3].T + world_from_body[:3, 3])

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath=bvh, global_scale=0.01, frame_start=1)
(armature,) = bpy.data.objects
names = [bone.name for bone in armature.pose.bones]
joints_m = []
for row in rows:
    bpy.context.scene.frame_set(row + 1)
    heads = [armature.matrix_world @ bone.head for bone in armature.pose.bones]
    joints_m.append([list(head) for head in heads])
np.savez(out, vertices_m=vertices_m, joints_m=joints_m, names=names)
