"""Save a small .blend: a floor, two walls, a cube with a packed picture, a lamp, and mischief.

Arguments: the .blend to save, and a file that the mischief would write.
"""

import sys
from typing import Any

import bpy
import numpy as np

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def add_box(name: str, centre: tuple[float, float, float], half: tuple[float, float, float]) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((np.array(CORNERS) * half).tolist(), [], FACES)
    thing = bpy.data.objects.new(name, mesh)
    thing.location = centre
    bpy.context.scene.collection.objects.link(thing)
    return thing


def main(path: str, victim: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_box("Floor", (10, 20, 0.95), (10, 10, 0.05))  # its top is at z = 1
    add_box("WallNorth", (10, 24, 3), (10, 0.1, 2))
    add_box("WallEast", (16, 20, 3), (0.1, 10, 2))
    cube = add_box("Cube", (10, 22, 1.5), (0.5, 0.5, 0.5))
    image = bpy.data.images.new("checks", 8, 8)
    squares = np.indices((8, 8)).sum(axis=0) % 2
    image.pixels.foreach_set(np.dstack([squares] * 3 + [np.ones((8, 8))]).astype("f4").ravel())
    image.pack()
    material = bpy.data.materials.new("checks")
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    cube.data.materials.append(material)
    # What would run if the file were trusted, and what would move.
    cube["mischief"] = 0.0
    driver = cube.driver_add('["mischief"]').driver
    driver.type = "SCRIPTED"
    driver.expression = f"__import__('pathlib').Path({victim!r}).write_text('x') or 1.0"
    cube["script"] = text = bpy.data.texts.new("script.py")
    text.write(f"import pathlib; pathlib.Path({victim!r}).write_text('x')")
    text.use_module = True
    for frame, x in ((0, 10.0), (2, 13.0)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    cube.location.x = 10.0
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.data.energy, lamp.location = 800.0, (10, 18, 4)
    scene.collection.objects.link(lamp)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    bpy.ops.wm.save_as_mainfile(filepath=path, compress=False)


main(*sys.argv[1:])
