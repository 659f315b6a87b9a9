"""Runs in its own process: writes rigged characters with Blender's own exporters.

Usage: character_by_blender.py out.glb (or .fbx) ...; beside each lies its case, out.npz.  That has
vertices_m (V, 3), faces (F, 3), weights (V, B), joints_m (B, 3), names (B,), parents (B,), unit_m,
the metres of a unit of the armature, whose object is scaled by it, embed: whether an FBX file holds
its picture, and holes: whether each second stripe of the picture is a hole.  The character gets the
picture, and what a file may have besides: a camera, a lamp, a floor without a skin, and an
animation.
"""

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np


def link(name: str, data: Any) -> Any:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def make_rig(case: Any, names: list[str]) -> Any:
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
    return rig


def make_mesh(case: Any) -> Any:
    mesh = bpy.data.meshes.new("Body")
    mesh.from_pydata((case["vertices_m"] / float(case["unit_m"])).tolist(), [], case["faces"])
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    heights = case["vertices_m"][corners][:, 2]
    places = np.c_[np.full(len(heights), 0.5), heights % 1.0]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", places.astype(np.float32).ravel())
    return mesh


def striped_material(path: Path, holes: bool) -> Any:
    image = bpy.data.images.new("stripes", 8, 64, alpha=True)
    stripes = np.ones((64, 8, 4), np.float32)
    stripes[(np.arange(64) // 8) % 2 == 0, :, :3] = (0.1, 0.2, 0.7)
    if holes:
        stripes[(np.arange(64) // 8) % 2 == 0, :, 3] = 0.0
    image.pixels.foreach_set(stripes.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    material = bpy.data.materials.new("cloth")
    material.use_nodes = True
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    if holes:
        tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    return material


def add_skin(mesh: Any, rig: Any, names: list[str], weights: np.ndarray) -> None:
    body = link("Body", mesh)
    body.parent = rig
    body.modifiers.new("skin", "ARMATURE").object = rig
    for number, name in enumerate(names):
        group = body.vertex_groups.new(name=name)
        for vertex in np.flatnonzero(weights[:, number]):
            group.add([int(vertex)], float(weights[vertex, number]), "REPLACE")


def add_what_else_a_file_has(turning: Any) -> None:
    link("Camera", bpy.data.cameras.new("Camera"))
    link("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    floor = bpy.data.meshes.new("Floor")
    floor.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    link("Floor", floor)
    turning.rotation_mode = "XYZ"
    for frame in (1, 20):
        turning.rotation_euler = (0.0, 0.0, 0.1 * frame)
        turning.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(1)


def export(case: Any, out_path: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    names = [str(name) for name in case["names"]]
    rig, mesh = make_rig(case, names), make_mesh(case)
    picture_path, embed = out_path.with_name("stripes.png"), bool(case["embed"])
    mesh.materials.append(striped_material(picture_path, bool(case["holes"])))
    add_skin(mesh, rig, names, case["weights"])
    add_what_else_a_file_has(rig.pose.bones[names[0]])
    path = str(out_path)
    if out_path.suffix == ".fbx":
        said = {"path_mode": "COPY" if embed else "RELATIVE", "embed_textures": embed}
        bpy.ops.export_scene.fbx(filepath=path, add_leaf_bones=False, **said)
    else:
        said = {"export_format": "GLB", "export_cameras": True, "export_lights": True}
        bpy.ops.export_scene.gltf(filepath=path, **said)
    if embed:
        picture_path.unlink()


for word in sys.argv[1:]:
    export(np.load(Path(word).with_suffix(".npz")), Path(word))
