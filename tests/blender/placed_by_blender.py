"""Runs in its own process: where a backdrop that is shifted and turned has its things.

Usage: placed_by_blender.py folder.  Things hang on the camera, on each other, on constraints and on
instances; walls are hidden in the viewport, or in the picture.
"""

import json
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from blender.places.backdrop import add_backdrop
from gmrdata.film.scene import BackdropConfig
from gmrdata.values.transforms import about_z

PATH = Path(sys.argv[1]) / "place.blend"
ORIGIN_M, YAW_DEG = (3.0, 2.0, 0.2), 90.0


def add(name: str, place_m: Any, data: Any = None, group: Any = None) -> Any:
    """A square metre of wall that faces x, or what is given."""
    if data is None:
        data = bpy.data.meshes.new(name)
        corners = [(0, y, z) for y, z in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
        data.from_pydata(corners, [], [(0, 1, 2, 3)])
    thing = bpy.data.objects.new(name, data)
    thing.location = place_m
    (group or bpy.context.scene.collection).objects.link(thing)
    return thing


def new_group(name: str) -> Any:
    group = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(group)
    return group


def constrained(name: str, place_m: Any, kind: str, **said: Any) -> None:
    constraint = add(name, place_m).constraints.new(kind)
    for key, value in said.items():
        setattr(constraint, key, value)


def make() -> None:
    table = add("Table", (3, 4, 0.4))
    table.scale, table.rotation_euler = (1, 2, 1), (0, 0, 0.5)
    leaning = add("ParentedToTable", (0, 0, 0.5))  # sheared by the table's scale
    leaning.parent, leaning.rotation_euler = table, (0.7, 0, 0)
    constrained("ChildOf", (0, 0, 0.45), "CHILD_OF", target=table)
    constrained("Copy", (0, 0, 0), "COPY_LOCATION", target=table)
    constrained("Limited", (2, 2, -1), "LIMIT_LOCATION", use_min_z=True, min_z=0.5)
    camera = add("Camera", (5, -5, 3), bpy.data.cameras.new("Camera"))
    lamp = add("LampOnCamera", (0, 0.5, 0), bpy.data.lights.new("Lamp", "POINT"))
    lamp.parent = camera
    source = new_group("chairs")  # switched off, and shown by an instance
    add("Chair", (1, 0, 0), group=source)
    bpy.context.view_layer.layer_collection.children["chairs"].exclude = True
    instance = bpy.data.objects.new("instance", None)
    instance.location, instance.instance_type = (6, 1, 0), "COLLECTION"
    instance.instance_collection = source
    bpy.context.scene.collection.objects.link(instance)
    shown, not_shown = new_group("shown"), new_group("not shown")
    add("Shown", (8, 0, 1), group=shown)
    add("NotShown", (10, 0, 1), group=not_shown)
    shown.hide_viewport, not_shown.hide_render = True, True
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    material.node_tree.nodes.new("ShaderNodeTexCoord").object = table
    table.data.materials.append(material)


def worlds() -> dict[str, np.ndarray]:
    """(4, 4) of each mesh and lamp as it is shown."""
    return {
        each.object.name: np.array(each.matrix_world)
        for each in bpy.context.evaluated_depsgraph_get().object_instances
        if each.object.type in ("MESH", "LIGHT")
    }


def met(from_m: Any) -> str | None:
    """What a ray of a metre meets in the direction of the file's x axis, from a place in it."""
    turn = about_z(-np.deg2rad(YAW_DEG))
    hit, _, _, _, thing, _ = bpy.context.scene.ray_cast(
        bpy.context.evaluated_depsgraph_get(),
        Vector(turn @ (np.array(from_m) - ORIGIN_M)),
        Vector(turn[:, 0]),
        distance=1.0,
    )
    return str(thing.name) if hit else None


bpy.ops.wm.read_factory_settings(use_empty=True)
make()
saved = worlds()
saved.pop("NotShown")  # in the viewport, not in the picture
bpy.ops.wm.save_as_mainfile(filepath=str(PATH), compress=False)
bpy.ops.wm.read_factory_settings(use_empty=True)
add_backdrop(bpy.context.scene, BackdropConfig(path=PATH, origin_m=ORIGIN_M, yaw_deg=YAW_DEG))
ours = np.eye(4)
ours[:3, :3] = about_z(-np.deg2rad(YAW_DEG))
ours[:3, 3] = ours[:3, :3] @ -np.array(ORIGIN_M)
found = worlds()
found.pop("Shown", None)  # not in the viewport, but in the picture
(axes,) = [
    node.object for node in bpy.data.materials["paint"].node_tree.nodes if node.type == "TEX_COORD"
]
answer = {
    "should": {name: (ours @ world).tolist() for name, world in saved.items()},
    "found": {name: world.tolist() for name, world in found.items()},
    "axes": np.array(axes.matrix_world).tolist(),
    "should_axes": (ours @ saved["Table"]).tolist(),
    "hidden in the viewport": met((7.5, 0, 1)),
    "not rendered": met((9.5, 0, 1)),
}
sys.stdout.write(f"\nANSWER {json.dumps(answer)}\n")
