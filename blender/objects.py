# SPDX-License-Identifier: GPL-3.0-or-later
"""A place as Blender objects: meshes, materials, lamp and sky."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np

from blender.light import Light, add_lamp, add_sky, add_sun, reflect_light
from blender.places.layout import Mesh, Yard, ground_mesh, mesh_of
from gmrdata.values.errors import RenderFailed

MOVING_PASS = "moving"
"""Name of the pass that is 1 where something moves by itself: a person, a car."""
CUT_OUT = "cut out"
"""Name of the node that is 1 where a material with holes is, 0 in the holes."""


def build_yard(
    scene: Any, yard: Yard, light: Light, hdri_path: Path | None, rng: np.random.Generator
) -> None:
    """Add ground, things, sky and lamp to an empty bpy scene.

    Args:
        scene: The bpy scene.
        yard: What to build.
        light: What falls on it.
        hdri_path: A file to show as the sky instead of the yard's own.
        rng: Chooses the shapes of foliage.

    Raises:
        RenderFailed: Blender can't read the file of the sky.
    """
    ground = ground_mesh(yard.ground_centre_m, yard.ground_side_m)
    add_mesh(scene, "ground", ground, picture_material("ground", yard.ground, light))
    materials: dict[int, Any] = {}  # the parts of a bench or a car share a picture
    for number, thing in enumerate(yard.things):
        name = f"thing{number:03d}"
        if id(thing.picture) not in materials:
            materials[id(thing.picture)] = picture_material(name, thing.picture, light)
        add_mesh(scene, name, mesh_of(thing, rng), materials[id(thing.picture)])
    if light.kind == "sun":
        add_sun(scene, light.azimuth_rad)
    if yard.lamp_m is not None:
        add_lamp(scene, yard.lamp_m, yard.ground_side_m**2)
    if hdri_path is not None:
        add_sky(scene, load_sky(hdri_path))
    elif yard.sky is not None:
        add_sky(scene, image_of("sky", yard.sky))


def load_sky(path: Path) -> Any:
    """A Blender image of a file.

    Raises:
        RenderFailed: there is no picture in it.
    """
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        raise RenderFailed(f"{path}: Blender can't read this sky ({error})") from None
    if not image.size[0]:
        raise RenderFailed(
            f"{path}: Blender finds no picture in this sky; give an equirectangular .hdr or .exr"
        )
    return image


def add_mesh(scene: Any, name: str, mesh: Mesh, material: Any) -> None:
    """Make an object of a mesh."""
    add_object(scene, name, bpy_mesh(name, mesh, [material]))


def bpy_mesh(name: str, mesh: Mesh, materials: Sequence[Any]) -> Any:
    """A mesh as Blender's, with materials, of which all faces have the first."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh.vertices_m.tolist(), [], mesh.faces.tolist())
    data.uv_layers.new(name="uv").data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
    data.polygons.foreach_set("use_smooth", np.full(len(mesh.faces), mesh.smooth))
    for material in materials:
        data.materials.append(material)
    data.update()
    return data


def add_object(scene: Any, name: str, mesh: Any) -> Any:
    """Put a bpy mesh into the scene, seen by the camera and casting shadows; gives its object.

    Cycles follows one diffuse bounce even when told not to; hidden from it, surfaces cost a third
    less time and add no grain.
    """
    thing = bpy.data.objects.new(name, mesh)
    thing.visible_diffuse = False
    scene.collection.objects.link(thing)
    return thing


def image_of(name: str, picture: np.ndarray) -> Any:
    """A Blender image from (H, W, 3) sRGB values with row 0 at the top."""
    height, width = picture.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False)
    image.colorspace_settings.name = "sRGB"
    pixels = cv2.cvtColor(picture.astype(np.float32, copy=False), cv2.COLOR_RGB2RGBA)  # alpha 1
    image.pixels.foreach_set(cv2.flip(pixels, 0, dst=pixels).ravel())
    image.update()
    return image


def picture_material(name: str, picture: np.ndarray, light: Light) -> Any:
    """A matt surface with a picture."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    # The emission stands for the sky's light; the surfaces must not be sampled as lamps.
    material.cycles.emission_sampling = "NONE"
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image_of(name, picture)
    texture.interpolation = "Linear"
    _shade(tree, texture.outputs["Color"], light)
    return material


def moving_picture_material(name: str, picture: np.ndarray, light: Light) -> Any:
    """A matt surface with a picture, marked as moving."""
    material = picture_material(name, picture, light)
    mark(material.node_tree, MOVING_PASS, 1.0)
    return material


def repaint(material: Any, colour: Any, light: Light, alpha: Any = None) -> None:
    """Make a material matt and mark it as moving.

    Args:
        material: The bpy material.
        colour: The output of one of its nodes that has the colour.
        light: What falls on it.
        alpha: The output that has the opacity; where it is below one half there is nothing.
    """
    material.cycles.emission_sampling = "NONE"
    tree = material.node_tree
    _shade(tree, colour, light)
    mark(tree, MOVING_PASS, 1.0)
    if alpha is not None:
        _cut_out(tree, alpha)


def _cut_out(tree: Any, alpha: Any) -> None:
    """Let there be nothing where opacity is below one half, neither in the picture nor in passes.

    Cycles adds up what a pass gets from all surfaces that a ray goes through.
    """
    nodes, links = tree.nodes, tree.links
    there = nodes.new("ShaderNodeMath")
    there.name, there.operation = CUT_OUT, "GREATER_THAN"
    there.inputs[1].default_value = 0.5
    links.new(alpha, there.inputs[0])
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    surface = output.inputs["Surface"].links[0].from_socket
    mix, nothing = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeBsdfTransparent")
    links.new(there.outputs[0], mix.inputs[0])
    links.new(nothing.outputs[0], mix.inputs[1])
    links.new(surface, mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    for node in nodes:
        if node.bl_idname == "ShaderNodeOutputAOV":
            links.new(there.outputs[0], node.inputs["Value"])


def mark(tree: Any, pass_name: str, value: float = 0.0) -> Any:
    """Let a material's pixels have a value in a pass; gives the node."""
    node = tree.nodes.new("ShaderNodeOutputAOV")
    node.aov_name = pass_name
    node.inputs["Value"].default_value = value
    return node


def _shade(tree: Any, colour: Any, light: Light) -> None:
    """Diffuse reflection of the lamp, and of what comes from all round."""
    nodes, links = tree.nodes, tree.links
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    links.new(colour, diffuse.inputs["Color"])
    emission = nodes.new("ShaderNodeEmission")
    links.new(reflect_light(tree, colour, light), emission.inputs["Color"])
    both = nodes.new("ShaderNodeAddShader")
    links.new(diffuse.outputs[0], both.inputs[0])
    links.new(emission.outputs[0], both.inputs[1])
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(both.outputs[0], output.inputs["Surface"])
