# SPDX-License-Identifier: GPL-3.0-or-later
"""The person as a Blender mesh that is given new vertices for each frame."""

from typing import Any

import bpy
import numpy as np

from blender.clothes import vertex_colours
from blender.light import Light
from blender.scene import add_object, person_material
from gmrdata.body.model import BodyModel

COLOURS = "colours"


def add_person(
    scene: Any,
    body: BodyModel,
    shape: np.ndarray,
    vertices_m: np.ndarray,
    light: Light,
    rng: np.random.Generator,
) -> Any:
    """Add the body, dressed, in the pose of (V, 3) vertices [m]; gives its bpy mesh."""
    mesh = bpy.data.meshes.new("person")
    mesh.from_pydata(vertices_m.tolist(), [], body.faces.tolist())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(body.faces), dtype=bool))
    attribute = mesh.color_attributes.new(COLOURS, "FLOAT_COLOR", "POINT")
    colours = np.ones((len(vertices_m), 4), np.float32)
    colours[:, :3] = vertex_colours(body, shape, rng)
    attribute.data.foreach_set("color", colours.ravel())
    mesh.materials.append(person_material("person", COLOURS, light))
    mesh.update()
    add_object(scene, "person", mesh)
    return mesh


def pose_person(mesh: Any, vertices_m: np.ndarray) -> None:
    """Move the mesh's vertices to (V, 3) places in the world [m]."""
    mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices_m, dtype=np.float32).ravel())
    mesh.update()
