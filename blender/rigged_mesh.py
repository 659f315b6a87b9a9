# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes of a character as one bpy mesh, in the project's own matt paint."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender.light import Light
from blender.scene import repaint
from gmrdata.values.errors import BadCharacter

ACTIVE_UV = "active"
"""Name of the layer with the picture coordinates that each part uses where none is named."""


@dataclass(frozen=True, eq=False)
class Part:
    """One object of a character, in a pose."""

    object: Any
    """The bpy object."""
    mesh: Any
    """Its evaluated bpy mesh."""


def join(name: str, parts: Sequence[Part], path: Path, light: Light) -> Any:
    """One bpy mesh of all parts, vertices and faces one part after another.

    Args:
        name: The mesh's name.
        parts: The parts.
        path: The character's file, for messages.
        light: What falls on it.

    Raises:
        BadCharacter: it has no faces, or a picture that it names is not inside the file.
    """
    whole = bpy.data.meshes.new(name)
    vertices = [_take(part.mesh.vertices, "co", 3) for part in parts]
    firsts = np.cumsum([0, *(len(points) for points in vertices)])
    corners = [
        _take(part.mesh.loops, "vertex_index", 1, np.int32)[:, 0] + first
        for part, first in zip(parts, firsts, strict=False)
    ]
    first_corners = np.cumsum([0, *(len(c) for c in corners)])
    starts = [
        _take(part.mesh.polygons, "loop_start", 1, np.int32)[:, 0] + first
        for part, first in zip(parts, first_corners, strict=False)
    ]
    if not sum(len(s) for s in starts):
        raise BadCharacter(f"{path}: its meshes have no faces; export the character again")
    whole.vertices.add(firsts[-1])
    whole.loops.add(first_corners[-1])
    whole.polygons.add(sum(len(s) for s in starts))
    whole.vertices.foreach_set("co", np.concatenate(vertices).astype(np.float32).ravel())
    whole.loops.foreach_set("vertex_index", np.concatenate(corners).astype(np.int32))
    whole.polygons.foreach_set("loop_start", np.concatenate(starts).astype(np.int32))
    smooth = [_take(part.mesh.polygons, "use_smooth", 1, bool)[:, 0] for part in parts]
    whole.polygons.foreach_set("use_smooth", np.concatenate(smooth))
    _add_pictures_places(whole, parts)
    _add_colours(whole, parts)
    _add_materials(whole, parts, path, light)
    whole.update(calc_edges=True)
    return whole


def _take(items: Any, key: str, width: int, kind: Any = np.float32) -> np.ndarray:
    """(N, width) values of a key of all items."""
    values = np.zeros(len(items) * width, kind)
    items.foreach_get(key, values)
    return values.reshape(-1, width)


def _add_pictures_places(whole: Any, parts: Sequence[Part]) -> None:
    """UV layers by name, after one that holds each part's active one."""
    names = sorted({layer.name for part in parts for layer in part.mesh.uv_layers})
    if not names:
        return
    for name in [ACTIVE_UV, *(name for name in names if name != ACTIVE_UV)][:8]:
        values = []
        for part in parts:
            layers = part.mesh.uv_layers
            active = next((layer for layer in layers if layer.active_render), None)
            layer = active if name == ACTIVE_UV else layers.get(name)
            nothing = np.zeros((len(part.mesh.loops), 2), np.float32)
            values.append(nothing if layer is None else _take(layer.uv, "vector", 2))
        whole.uv_layers.new(name=name).uv.foreach_set("vector", np.concatenate(values).ravel())
    whole.uv_layers[ACTIVE_UV].active_render = True


def _add_colours(whole: Any, parts: Sequence[Part]) -> None:
    """Colour attributes by name, per corner; white where a part has none."""
    for name in sorted({colour.name for part in parts for colour in part.mesh.color_attributes}):
        values = []
        for part in parts:
            colours = part.mesh.color_attributes.get(name)
            if colours is None:
                values.append(np.ones((len(part.mesh.loops), 4), np.float32))
            elif colours.domain == "POINT":
                corners = _take(part.mesh.loops, "vertex_index", 1, np.int32)[:, 0]
                values.append(_take(colours.data, "color", 4)[corners])
            else:
                values.append(_take(colours.data, "color", 4))
        layer = whole.color_attributes.new(name, "FLOAT_COLOR", "CORNER")
        layer.data.foreach_set("color", np.concatenate(values).ravel())


def _add_materials(whole: Any, parts: Sequence[Part], path: Path, light: Light) -> None:
    """Each face's material, repainted."""
    number_of: dict[str, int] = {}
    numbers = []
    for part in parts:
        slot_of_face = _take(part.mesh.polygons, "material_index", 1, np.int32)[:, 0]
        number_of_slot = np.zeros(slot_of_face.max(initial=0) + 1, np.int32)
        for slot in np.unique(slot_of_face):
            slots = part.object.material_slots
            material = slots[slot].material if slot < len(slots) else None
            name = material.name if material else ""
            if name not in number_of:
                number_of[name] = len(number_of)
                whole.materials.append(_painted(material, path, light))
            number_of_slot[slot] = number_of[name]
        numbers.append(number_of_slot[slot_of_face])
    whole.polygons.foreach_set("material_index", np.concatenate(numbers))


def _painted(material: Any, path: Path, light: Light) -> Any:
    """A file's material, or grey for None, as a matt one with the same colours and holes."""
    if material is None:
        material = bpy.data.materials.new("plain")
    tree = material.node_tree
    if tree is None:  # before Blender 5.0
        material.use_nodes = True
        tree = material.node_tree
    colour, alpha = _colour_socket(material, tree), _alpha_socket(tree)
    used = _upstream(colour.node) + (_upstream(alpha.node) if alpha else [])
    for node in [node for node in tree.nodes if node not in used]:
        tree.nodes.remove(node)
    for node in tree.nodes:
        image = getattr(node, "image", None)
        if image is not None and (image.packed_file is None or not image.size[0]):
            raise BadCharacter(
                f"{path}: its picture {image.name!r} is not inside the file, or can't be read; "
                "export it with pictures embedded, best as one .glb"
            )
    repaint(material, colour, light, alpha)
    return material


def _colour_socket(material: Any, tree: Any) -> Any:
    """The node output that has the surface's base colour."""
    shaders = [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]
    if shaders:
        base = shaders[0].inputs["Base Color"]
        if base.is_linked:
            return base.links[0].from_socket
        constant = tuple(base.default_value)
    else:  # unlit, or made in another way
        pictures = [node for node in tree.nodes if node.type == "TEX_IMAGE"]
        if pictures:
            return pictures[0].outputs["Color"]
        constant = tuple(material.diffuse_color)
    plain = tree.nodes.new("ShaderNodeRGB")
    plain.outputs["Color"].default_value = constant
    return plain.outputs["Color"]


def _alpha_socket(tree: Any) -> Any:
    """The node output that has the surface's opacity, where it is not the same everywhere."""
    for node in tree.nodes:
        if node.type == "BSDF_PRINCIPLED" and node.inputs["Alpha"].is_linked:
            return node.inputs["Alpha"].links[0].from_socket
    return None


def _upstream(node: Any) -> list[Any]:
    """A node and all that it depends on."""
    found, todo = [], [node]
    while todo:
        now = todo.pop()
        if now not in found:
            found.append(now)
            todo += [link.from_node for socket in now.inputs for link in socket.links]
    return found
