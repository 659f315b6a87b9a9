# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes of a character as one bpy mesh, in the project's own matt paint.

A rigged character's file in Blender: its one skeleton, at rest, and what the skeleton moves.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import addon_utils
import bpy
import numpy as np

from blender.engine import kept
from blender.light import Light
from blender.objects import repaint
from gmrdata.film.character import linked_files
from gmrdata.values.errors import BadCharacter

_SCENE_SETTINGS = ("camera", "world", "frame_start", "frame_end", "frame_current")
_RENDER_SETTINGS = ("fps", "fps_base")
_KINDS = ("objects", "actions")


@dataclass(frozen=True, eq=False)
class Imported:
    """A character in the scene, at rest, until `imported` ends."""

    path: Path
    """Its file."""
    armature: Any
    """The bpy object of its skeleton."""
    meshes: tuple[Any, ...]
    """The bpy objects that the skeleton moves, by name."""

    @property
    def bone_names(self) -> list[str]:
        """Names of the bones."""
        return [bone.name for bone in self.armature.data.bones]

    @property
    def bone_parents(self) -> list[int]:
        """Index of each bone's parent, -1 for none."""
        names = self.bone_names
        bones = self.armature.data.bones
        return [names.index(bone.parent.name) if bone.parent else -1 for bone in bones]

    @property
    def world_from_armature(self) -> np.ndarray:
        """(4, 4) transform of the armature object, which may scale."""
        return np.array(self.armature.matrix_world, dtype=np.float64)

    @property
    def armature_from_bone(self) -> np.ndarray:
        """(B, 4, 4) the bones at rest, in the armature's own units."""
        return np.array([bone.matrix_local for bone in self.armature.data.bones], dtype=np.float64)


@contextmanager
def imported(path: Path) -> Iterator[Imported]:
    """Open a character's file in the present scene, and take it out again afterwards.

    Meshes and materials that were made from it meanwhile stay.  The scene's own settings, which
    importers change, stay as they are.  Cameras, lights and animations of the file are dropped.

    Raises:
        BadCharacter: Blender can't read it, or it has no skeleton that moves a mesh, or several.
    """
    scene = bpy.context.scene
    before = {kind: {item.name for item in getattr(bpy.data, kind)} for kind in _KINDS}
    try:
        with kept(scene, *_SCENE_SETTINGS), kept(scene.render, *_RENDER_SETTINGS):
            _open(path)
            new = [thing for thing in bpy.data.objects if thing.name not in before["objects"]]
            armature, meshes = _skeleton_and_meshes(new, path)
            _put_at_rest(armature, meshes, new)
            _check_armature(armature, path)
            yield Imported(path, armature, meshes)
    finally:
        _remove_new(before)


def _open(path: Path) -> None:
    linked_files(path)  # raises where it names a file outside its folder
    try:
        if path.suffix.lower() == ".fbx":
            bpy.ops.wm.fbx_import(filepath=str(path), use_anim=False)
        else:
            addon_utils.enable("io_scene_gltf2", default_set=False)
            bpy.ops.import_scene.gltf(
                filepath=str(path),
                merge_vertices=True,  # glTF splits vertices along the seams of pictures
                disable_bone_shape=True,
                import_scene_extras=False,
                import_scene_as_collection=False,
                import_select_created_objects=False,
            )
    except RuntimeError as error:
        said = str(error).strip().splitlines()
        why = said[-1] if said else "no reason given"
        raise BadCharacter(
            f"{path}: Blender can't read this character ({why}); export it again"
        ) from None


def _skeleton_and_meshes(new: list[Any], path: Path) -> tuple[Any, tuple[Any, ...]]:
    """The armature that moves meshes, and the meshes that it moves."""
    meshes = sorted((thing for thing in new if thing.type == "MESH"), key=lambda mesh: mesh.name)
    armatures = sorted({skin.name for mesh in meshes if (skin := _skin(mesh)) is not None})
    if not armatures:
        kinds = ", ".join(sorted(thing.type.lower() for thing in new)) or "nothing"
        raise BadCharacter(
            f"{path}: no skeleton moves a mesh of it (it has {kinds}); "
            "export the character with its armature and skin"
        )
    if len(armatures) > 1:
        raise BadCharacter(
            f"{path}: has the skeletons {', '.join(armatures)}, and one is needed; "
            "export one character alone"
        )
    armature = bpy.data.objects[armatures[0]]
    return armature, tuple(mesh for mesh in meshes if carrier(mesh, armature) is not None)


def carrier(mesh: Any, armature: Any) -> str | None:
    """How an armature moves an object: "" by its skin, a bone's name: with it; None: not at all."""
    if _skin(mesh) == armature:
        return ""
    thing = mesh
    while thing.parent is not None:  # plain nodes and other meshes may stand between
        if thing.parent == armature and thing.parent_type == "BONE":
            return str(thing.parent_bone)
        thing = thing.parent
    return None


def _skin(mesh: Any) -> Any:
    """The armature that deforms a mesh, if any."""
    skins = [mod.object for mod in mesh.modifiers if mod.type == "ARMATURE" and mod.object]
    return skins[0] if skins else None


def _put_at_rest(armature: Any, meshes: tuple[Any, ...], new: list[Any]) -> None:
    """No animation, constraints or shape keys: the skeleton in its rest pose and the mesh as bound.

    From here on a bone does what its rotation says.
    """
    for thing in new:
        thing.animation_data_clear()
        thing.constraints.clear()
    for mesh in meshes:
        mesh.hide_viewport = False
        keys = mesh.data.shape_keys
        if keys is not None:
            keys.animation_data_clear()
            for block in keys.key_blocks:
                block.value = 0.0
    armature.data.animation_data_clear()
    armature.data.pose_position = "POSE"
    armature.hide_viewport = False
    for bone in armature.pose.bones:
        for constraint in list(bone.constraints):
            bone.constraints.remove(constraint)
        bone.rotation_mode = "QUATERNION"
        bone.location, bone.scale = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
        bone.rotation_quaternion = (1.0, 0.0, 0.0, 0.0)
        bone.bone.use_inherit_rotation = True
        bone.bone.bbone_segments = 1
    bpy.context.view_layer.update()


def _check_armature(armature: Any, path: Path) -> None:
    """See that the armature object only turns, moves and scales evenly."""
    axes = np.array(armature.matrix_world, dtype=np.float64)[:3, :3]
    gram = axes.T @ axes
    even = np.abs(gram - gram[0, 0] * np.eye(3)).max() <= 1e-4 * gram[0, 0]
    if not even or np.linalg.det(axes) <= 0:
        raise BadCharacter(
            f"{path}: its skeleton is mirrored or scaled unevenly; apply the transforms of all "
            "objects and export it again"
        )


def _remove_new(before: dict[str, set[str]]) -> None:
    """Remove the objects that the file brought, what they are made of, and its animations."""
    new = [thing for thing in bpy.data.objects if thing.name not in before["objects"]]
    made_of = {thing.data.as_pointer(): thing.data for thing in new if thing.data is not None}
    actions = [action for action in bpy.data.actions if action.name not in before["actions"]]
    bpy.data.batch_remove([*new, *actions])
    bpy.data.batch_remove([data for data in made_of.values() if data.users == 0])


CLEAR = "clear"
"""Name of the node that has the opacity of a material of which nothing can be seen."""
ACTIVE_UV = "active"
"""Name of the layer with the picture coordinates that each part uses where none is named."""


@dataclass(frozen=True, eq=False)
class CharacterPart:
    """One object of a character, in a pose."""

    object: Any
    """The bpy object."""
    mesh: Any
    """Its evaluated bpy mesh."""


def join(name: str, parts: Sequence[CharacterPart], path: Path, light: Light) -> Any:
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


def _add_pictures_places(whole: Any, parts: Sequence[CharacterPart]) -> None:
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


def _add_colours(whole: Any, parts: Sequence[CharacterPart]) -> None:
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


def _add_materials(whole: Any, parts: Sequence[CharacterPart], path: Path, light: Light) -> None:
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
    if all(CLEAR in material.node_tree.nodes for material in whole.materials):
        raise BadCharacter(
            f"{path}: nothing of it can be seen, as all its materials have an opacity below one "
            "half; export it with opaque ones"
        )
    whole.polygons.foreach_set("material_index", np.concatenate(numbers))


def _painted(material: Any, path: Path, light: Light) -> Any:
    """A file's material, or grey for None, as a matt one with the same colours and holes."""
    if material is None:
        material = bpy.data.materials.new("plain")
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
    """The node output that has the surface's opacity, where that may be below one half."""
    shaders = [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]
    for alpha in (shader.inputs["Alpha"] for shader in shaders):
        if alpha.is_linked:
            return alpha.links[0].from_socket
        if alpha.default_value < 0.5:  # of a visor, or the like
            clear = tree.nodes.new("ShaderNodeValue")
            clear.name, clear.outputs[0].default_value = CLEAR, alpha.default_value
            return clear.outputs[0]
    return None


def _upstream(node: Any) -> list[Any]:
    """A node and all that it depends on."""
    nodes, todo = [], [node]
    while todo:
        now = todo.pop()
        if now not in nodes:
            nodes.append(now)
            todo += [link.from_node for socket in now.inputs for link in socket.links]
    return nodes
