"""Runs in its own process: tries odd .blend files as the place, and prints what is said of each.

Usage: odd_backdrops_by_blender.py folder font.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from blender.places.backdrop import add_backdrop
from gmrdata.film.scene import BackdropConfig
from gmrdata.values.errors import BadBackdrop

FOLDER = Path(sys.argv[1])


def textured_with(image: Any) -> Any:
    """A node tree that shows a picture on a mesh of the scene."""
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    add("Wall", mesh()).data.materials.append(material)
    return material.node_tree


def mesh() -> Any:
    found = bpy.data.meshes.new("wall")
    found.from_pydata([(0, 0, 0), (1, 0, 0), (1, 0, 1)], [], [(0, 1, 2)])
    return found


def add(name: str, data: Any) -> Any:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def plain() -> None:
    add("Wall", mesh())


def generated_picture() -> None:
    image = bpy.data.images.new("endless", 8, 8)
    image.generated_width = image.generated_height = 60_000
    textured_with(image)


def small_generated_picture() -> None:
    textured_with(bpy.data.images.new("checks", 8, 8))


def picture_beside() -> None:
    image = bpy.data.images.new("beside", 8, 8)
    image.filepath_raw, image.file_format = str(FOLDER / "beside.png"), "PNG"
    image.save()
    textured_with(image)


def device_as_picture() -> None:
    image = bpy.data.images.new("zeros", 8, 8)
    image.source, image.filepath = "FILE", "/dev/zero"
    textured_with(image)


def font() -> None:
    letters = bpy.data.curves.new("letters", "FONT")
    letters.font = bpy.data.fonts.load(sys.argv[2])
    add("Letters", letters)


def volume() -> None:
    fog = bpy.data.volumes.new("fog")
    fog.filepath = "//fog.vdb"
    add("Fog", fog)


def linked_library(name: str = "library.blend") -> None:
    library = FOLDER / "libraries" / name
    library.parent.mkdir(exist_ok=True)
    bpy.data.libraries.write(str(library), {add("Chair", mesh())})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Chair"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])


def library_of_the_same_name() -> None:
    linked_library("library_of_the_same_name.blend")


def light_profile() -> None:
    node = textured_with(bpy.data.images.new("checks", 8, 8)).nodes.new("ShaderNodeTexIES")
    node.mode, node.filepath, node.name = "EXTERNAL", "//lamp.ies", "profile"


def centimetres() -> None:
    plain()
    bpy.context.scene.unit_settings.system = "METRIC"
    bpy.context.scene.unit_settings.scale_length = 0.01


def said(make: Callable[[], None]) -> str:
    path = FOLDER / f"{make.__name__}.blend"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    make()
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        add_backdrop(bpy.context.scene, BackdropConfig(path=path))
    except BadBackdrop as error:
        return str(error)
    return ""


CASES = (plain, small_generated_picture, generated_picture, picture_beside, device_as_picture,
         font, volume, linked_library, library_of_the_same_name, light_profile,
         centimetres)  # fmt: skip
sys.stdout.write(f"\nANSWER {json.dumps({make.__name__: said(make) for make in CASES})}\n")
