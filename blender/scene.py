# SPDX-License-Identifier: GPL-3.0-or-later
"""The yard as Blender objects, with light that has no noise of its own.

Cycles at a few samples a pixel is grainy where light is sampled over the whole sky, and grain that
changes with each frame spoils the matching of features.  So the sky's light is computed exactly, as
an emission that depends on the surface's direction, and only the sun is traced, for its shadows.
"""

from typing import Any

import bpy
import numpy as np

from blender.layout import Yard
from blender.meshes import Mesh, ground_mesh, mesh_of

PERSON_PASS = "person"
SUN_ELEVATION_RAD = np.deg2rad(47.0)
SUN_STRENGTH = 3.6
SKY_LIGHT = (0.43, 0.50, 0.63)
GROUND_LIGHT = (0.27, 0.22, 0.17)


def build_yard(scene: Any, yard: Yard, sun_azimuth_rad: float, rng: np.random.Generator) -> None:
    """Add ground, things, sky and sun to an empty bpy scene."""
    ground = ground_mesh(yard.ground_centre_m, yard.ground_side_m)
    add_mesh(scene, "ground", ground, picture_material("ground", yard.ground))
    for number, thing in enumerate(yard.things):
        name = f"thing{number:03d}"
        add_mesh(scene, name, mesh_of(thing, rng), picture_material(name, thing.picture))
    _add_sun(scene, sun_azimuth_rad)
    _add_sky(scene, yard.sky)


def add_mesh(scene: Any, name: str, mesh: Mesh, material: Any) -> None:
    """Make an object of a mesh."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh.vertices_m.tolist(), [], mesh.faces.tolist())
    data.uv_layers.new(name="uv").data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
    data.polygons.foreach_set("use_smooth", np.full(len(mesh.faces), mesh.smooth))
    data.materials.append(material)
    data.update()
    add_object(scene, name, data)


def add_object(scene: Any, name: str, mesh: Any) -> None:
    """Put a bpy mesh into the scene, seen by the camera and casting shadows.

    Cycles follows one diffuse bounce even when told not to; hidden from it, surfaces cost a third
    less time and add no grain.
    """
    thing = bpy.data.objects.new(name, mesh)
    thing.visible_diffuse = False
    scene.collection.objects.link(thing)


def image_of(name: str, picture: np.ndarray) -> Any:
    """A Blender image from (H, W, 3) sRGB values with row 0 at the top."""
    height, width = picture.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False)
    image.colorspace_settings.name = "sRGB"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = picture[::-1]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def picture_material(name: str, picture: np.ndarray) -> Any:
    """A matt surface with a picture."""
    material, tree = _empty_material(name)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image_of(name, picture)
    texture.interpolation = "Linear"
    _shade(tree, texture.outputs["Color"])
    return material


def person_material(name: str, attribute: str) -> Any:
    """A matt surface with colours from a vertex attribute; its pixels are marked as a person."""
    material, tree = _empty_material(name)
    colour = tree.nodes.new("ShaderNodeAttribute")
    colour.attribute_name = attribute
    _shade(tree, colour.outputs["Color"])
    mark = tree.nodes.new("ShaderNodeOutputAOV")
    mark.aov_name = PERSON_PASS
    mark.inputs["Value"].default_value = 1.0
    return material


def _empty_material(name: str) -> tuple[Any, Any]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5.0
        material.use_nodes = True
    material.node_tree.nodes.clear()
    # The emission stands for the sky's light; the surfaces must not be sampled as lamps.
    material.cycles.emission_sampling = "NONE"
    return material, material.node_tree


def _shade(tree: Any, colour: Any) -> None:
    """Diffuse reflection of the sun, of half a sphere of sky, and of half a sphere of ground."""
    nodes, links = tree.nodes, tree.links
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    links.new(colour, diffuse.inputs["Color"])
    geometry = nodes.new("ShaderNodeNewGeometry")
    split = nodes.new("ShaderNodeSeparateXYZ")
    links.new(geometry.outputs["Normal"], split.inputs[0])
    light = nodes.new("ShaderNodeVectorMath")
    light.operation = "MULTIPLY_ADD"
    sky, ground = np.array(SKY_LIGHT), np.array(GROUND_LIGHT)
    light.inputs[1].default_value = (sky - ground) / 2
    light.inputs[2].default_value = (sky + ground) / 2
    links.new(split.outputs["Z"], light.inputs[0])
    reflected = nodes.new("ShaderNodeVectorMath")
    reflected.operation = "MULTIPLY"
    links.new(light.outputs["Vector"], reflected.inputs[0])
    links.new(colour, reflected.inputs[1])
    emission = nodes.new("ShaderNodeEmission")
    links.new(reflected.outputs["Vector"], emission.inputs["Color"])
    both = nodes.new("ShaderNodeAddShader")
    links.new(diffuse.outputs[0], both.inputs[0])
    links.new(emission.outputs[0], both.inputs[1])
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(both.outputs[0], output.inputs["Surface"])


def _add_sun(scene: Any, azimuth_rad: float) -> None:
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.color = SUN_STRENGTH, (1.0, 0.93, 0.82)
    lamp.angle = 0.0  # sharp shadows have no grain
    sun = bpy.data.objects.new("sun", lamp)
    # A lamp shines along its -z: tilt it from the zenith, then turn it to the azimuth.
    sun.rotation_euler = (0.0, np.pi / 2 - SUN_ELEVATION_RAD, azimuth_rad)
    scene.collection.objects.link(sun)


def _add_sky(scene: Any, picture: np.ndarray) -> None:
    world = bpy.data.worlds.new("sky")
    scene.world = world
    if world.node_tree is None:  # before Blender 5.0
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = image_of("sky", picture)
    background = nodes.new("ShaderNodeBackground")
    links.new(texture.outputs["Color"], background.inputs["Color"])
    output = nodes.new("ShaderNodeOutputWorld")
    links.new(background.outputs[0], output.inputs["Surface"])
    # Seen by the camera only: as a light it would be sampled, and grainy.
    world.cycles.sampling_method = "NONE"
    world.cycles_visibility.diffuse = False
