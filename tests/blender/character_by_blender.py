"""Runs in its own process: writes a rigged character with Blender's own exporters.

Usage: character_by_blender.py case.npz out.glb (or .fbx).  The case has vertices_m (V, 3), faces
(F, 3), weights (V, B), joints_m (B, 3), names (B,), parents (B,), unit_m, the metres of a unit of
the armature, whose object is scaled by it, embed: whether an FBX file holds its picture, and holes:
whether each second stripe of the picture is a hole.  The character gets the picture, and what a
file may have besides: a camera, a lamp, a floor without a skin, and an animation.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

case, out_path = np.load(sys.argv[1]), Path(sys.argv[2])
names = [str(name) for name in case["names"]]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def link(name: str, data: object) -> object:
    thing = bpy.data.objects.new(name, data)
    scene.collection.objects.link(thing)
    return thing


unit_m = float(case["unit_m"])
rig = link("Armature", bpy.data.armatures.new("Armature"))
rig.scale = (unit_m,) * 3
bpy.context.view_layer.objects.active = rig
bpy.ops.object.mode_set(mode="EDIT")
for name, joint_m in zip(names, case["joints_m"], strict=True):
    bone = rig.data.edit_bones.new(name)
    bone.head = joint_m / unit_m
    bone.tail = (joint_m + np.array([0.01, 0.03, 0.04])) / unit_m  # bones' axes mean nothing
for name, parent in zip(names, case["parents"], strict=True):
    if parent >= 0:
        rig.data.edit_bones[name].parent = rig.data.edit_bones[names[parent]]
bpy.ops.object.mode_set(mode="OBJECT")

mesh = bpy.data.meshes.new("Body")
mesh.from_pydata((case["vertices_m"] / unit_m).tolist(), [], case["faces"].tolist())
mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
corners = np.empty(len(mesh.loops), np.int32)
mesh.loops.foreach_get("vertex_index", corners)
heights = case["vertices_m"][corners][:, 2]
places = np.c_[np.full(len(heights), 0.5), heights % 1.0]
mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", places.astype(np.float32).ravel())
image = bpy.data.images.new("stripes", 8, 64, alpha=True)
stripes = np.ones((64, 8, 4), np.float32)
stripes[(np.arange(64) // 8) % 2 == 0, :, :3] = (0.1, 0.2, 0.7)
if case["holes"]:
    stripes[(np.arange(64) // 8) % 2 == 0, :, 3] = 0.0
image.pixels.foreach_set(stripes.ravel())
image.filepath_raw, image.file_format = str(out_path.with_name("stripes.png")), "PNG"
image.save()
material = bpy.data.materials.new("cloth")
material.use_nodes = True
texture = material.node_tree.nodes.new("ShaderNodeTexImage")
texture.image = image
shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
if case["holes"]:
    material.node_tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
mesh.materials.append(material)

body = link("Body", mesh)
body.parent = rig
body.modifiers.new("skin", "ARMATURE").object = rig
for number, name in enumerate(names):
    group = body.vertex_groups.new(name=name)
    for vertex in np.flatnonzero(case["weights"][:, number]):
        group.add([int(vertex)], float(case["weights"][vertex, number]), "REPLACE")

link("Camera", bpy.data.cameras.new("Camera"))
link("Lamp", bpy.data.lights.new("Lamp", "POINT"))
floor = bpy.data.meshes.new("Floor")
floor.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
link("Floor", floor)
turning = rig.pose.bones[names[0]]
turning.rotation_mode = "XYZ"
for frame in (1, 20):
    turning.rotation_euler = (0.0, 0.0, 0.1 * frame)
    turning.keyframe_insert("rotation_euler", frame=frame)
scene.frame_set(1)

if out_path.suffix == ".fbx":
    bpy.ops.export_scene.fbx(
        filepath=str(out_path),
        path_mode="COPY" if case["embed"] else "RELATIVE",
        embed_textures=bool(case["embed"]),
        add_leaf_bones=False,
    )
else:
    bpy.ops.export_scene.gltf(
        filepath=str(out_path), export_format="GLB", export_cameras=True, export_lights=True
    )
if case["embed"]:
    out_path.with_name("stripes.png").unlink()
