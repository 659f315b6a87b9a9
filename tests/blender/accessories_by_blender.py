"""Runs in its own process: by what each mesh of a character is moved, as JSON.

Usage: accessories_by_blender.py out.glb.  The character has a hat on a bone, a badge on the hat,
and glasses on a plain node on the bone; a shoe lies on the floor, which the skeleton doesn't move.
"""

import json
import sys
from pathlib import Path
from typing import Any

import bpy

from blender.people.rigged_import import carrier, imported


def link(name: str, data: Any, parent: Any = None) -> Any:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    thing.parent = parent
    return thing


def square(name: str, parent: Any = None) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [], [(0, 1, 2, 3)])
    return link(name, mesh, parent)


def on_head(thing: Any) -> Any:
    thing.parent, thing.parent_type, thing.parent_bone = rig, "BONE", "Head"
    return thing


path = Path(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
rig = link("Armature", bpy.data.armatures.new("Armature"))
bpy.context.view_layer.objects.active = rig
bpy.ops.object.mode_set(mode="EDIT")
bone = rig.data.edit_bones.new("Head")
bone.head, bone.tail = (0, 0, 1), (0, 0, 1.1)
bpy.ops.object.mode_set(mode="OBJECT")
body = square("Body", rig)
body.modifiers.new("skin", "ARMATURE").object = rig
body.vertex_groups.new(name="Head").add([0, 1, 2, 3], 1.0, "REPLACE")
square("Badge", on_head(square("Hat")))
square("Glasses", on_head(link("node", None)))
square("Shoe", square("Floor"))
bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB")
bpy.ops.wm.read_factory_settings(use_empty=True)
with imported(path) as puppet:
    names = {thing.name for thing in bpy.data.objects if thing.type == "MESH"}
    taken = {mesh.name: carrier(mesh, puppet.armature) for mesh in puppet.meshes}
answer = {"taken": taken, "left": sorted(names - taken.keys())}
sys.stdout.write(f"\nANSWER {json.dumps(answer)}\n")
