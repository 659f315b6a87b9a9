# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has no noise of its own.

Cycles at a few samples a pixel is grainy where light is sampled over the whole sky, and grain that
changes with each frame spoils the matching of features.  So the light of the sky, or of a room's
walls, is computed exactly, as an emission that depends on the surface's direction, and only one
lamp without size is traced, for its shadows.
"""

from dataclasses import dataclass
from typing import Any, Literal

import bpy
import numpy as np

SUN_ELEVATION_RAD = np.deg2rad(47.0)
SUN_STRENGTH = 3.6
LAMP_W_PER_M2 = 7.5
"""Power of a room's lamp for each square metre of floor."""
HAZE_TILT_RAD = np.deg2rad(35.0)
"""Angle from the zenith to the brightest part of an overcast sky."""

Kind = Literal["sun", "overcast", "indoor", "traced"]
"""`traced`: a file's own lamps and sky light everything, and no light is in the materials."""

REFLECTED = {
    "sun": ((0.43, 0.50, 0.63), (0.27, 0.22, 0.17)),
    "overcast": ((1.16, 1.20, 1.26), (0.24, 0.23, 0.22)),
    "indoor": ((0.62, 0.58, 0.52), (0.50, 0.44, 0.37)),
    "traced": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
}
"""Colours of what falls on a surface that faces the brightest part, and that faces away from it."""


@dataclass(frozen=True, eq=False)
class Light:
    """One kind of light, as it falls on a place."""

    kind: Kind
    azimuth_rad: float
    """Where the sun is, seen from the subject [rad]."""

    @property
    def above(self) -> np.ndarray:
        """(3,) what a surface reflects that faces the brightest part."""
        return np.array(REFLECTED[self.kind][0])

    @property
    def below(self) -> np.ndarray:
        """(3,) what a surface reflects that faces away from it."""
        return np.array(REFLECTED[self.kind][1])

    @property
    def brightest(self) -> np.ndarray:
        """(3,) unit vector to the brightest part of the sky or room: the zenith but for haze."""
        tilt = HAZE_TILT_RAD if self.kind == "overcast" else 0.0
        side = np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])
        return np.sin(tilt) * side + np.cos(tilt) * np.array([0.0, 0.0, 1.0])


def reflect_light(tree: Any, colour: Any, light: Light) -> Any:
    """Nodes for what a matt surface reflects of all light but the lamp's; gives the colour."""
    nodes, links = tree.nodes, tree.links
    geometry = nodes.new("ShaderNodeNewGeometry")
    facing = nodes.new("ShaderNodeVectorMath")
    facing.operation = "DOT_PRODUCT"
    links.new(geometry.outputs["Normal"], facing.inputs[0])
    facing.inputs[1].default_value = light.brightest
    incoming = nodes.new("ShaderNodeVectorMath")
    incoming.operation = "MULTIPLY_ADD"
    incoming.inputs[1].default_value = (light.above - light.below) / 2
    incoming.inputs[2].default_value = (light.above + light.below) / 2
    links.new(facing.outputs["Value"], incoming.inputs[0])
    reflected = nodes.new("ShaderNodeVectorMath")
    reflected.operation = "MULTIPLY"
    links.new(incoming.outputs["Vector"], reflected.inputs[0])
    links.new(colour, reflected.inputs[1])
    return reflected.outputs["Vector"]


def add_sun(scene: Any, azimuth_rad: float) -> None:
    """Add a sun, clear and sharp."""
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.color = SUN_STRENGTH, (1.0, 0.93, 0.82)
    lamp.angle = 0.0  # sharp shadows have no grain
    sun = bpy.data.objects.new("sun", lamp)
    # A lamp shines along its -z: tilt it from the zenith, then turn it to the azimuth.
    sun.rotation_euler = (0.0, np.pi / 2 - SUN_ELEVATION_RAD, azimuth_rad)
    scene.collection.objects.link(sun)


def add_lamp(scene: Any, place_m: np.ndarray, floor_m2: float) -> None:
    """Add a room's lamp, at a place (3,) [m], as bright as the floor is large."""
    lamp = bpy.data.lights.new("lamp", "POINT")
    lamp.energy, lamp.color = LAMP_W_PER_M2 * floor_m2, (1.0, 0.90, 0.76)
    lamp.shadow_soft_size = 0.0
    bulb = bpy.data.objects.new("lamp", lamp)
    bulb.location = tuple(place_m)
    scene.collection.objects.link(bulb)


def add_sky(scene: Any, image: Any) -> None:
    """Show an equirectangular bpy image behind everything."""
    world = bpy.data.worlds.new("sky")
    scene.world = world
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    background = nodes.new("ShaderNodeBackground")
    links.new(texture.outputs["Color"], background.inputs["Color"])
    output = nodes.new("ShaderNodeOutputWorld")
    links.new(background.outputs[0], output.inputs["Surface"])
    # Seen by the camera only: as a light it would be sampled, and grainy.
    world.cycles.sampling_method = "NONE"
    world.cycles_visibility.diffuse = False
