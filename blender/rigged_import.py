# SPDX-License-Identifier: GPL-3.0-or-later
"""A rigged character's file in Blender: its one skeleton, at rest, and what the skeleton moves."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import addon_utils
import bpy
import numpy as np

from gmrdata.values.errors import BadCharacter

_SCENE_SETTINGS = ("camera", "world", "frame_start", "frame_end", "frame_current")
_RENDER_SETTINGS = ("fps", "fps_base")
_KINDS = ("objects", "actions")


@dataclass(frozen=True, eq=False)
class Imported:
    """A character in the scene, at rest, until `removed_afterwards` ends."""

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
    settings = {name: getattr(scene, name) for name in _SCENE_SETTINGS}
    render_settings = {name: getattr(scene.render, name) for name in _RENDER_SETTINGS}
    try:
        _open(path)
        new = [thing for thing in bpy.data.objects if thing.name not in before["objects"]]
        armature, meshes = _skeleton_and_meshes(new, path)
        _put_at_rest(armature, meshes, new)
        _check_armature(armature, path)
        yield Imported(path, armature, meshes)
    finally:
        for name, value in settings.items():
            setattr(scene, name, value)
        for name, value in render_settings.items():
            setattr(scene.render, name, value)
        _remove_new(before)


def _open(path: Path) -> None:
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
        found = ", ".join(sorted(thing.type.lower() for thing in new)) or "nothing"
        raise BadCharacter(
            f"{path}: no skeleton moves a mesh of it (it has {found}); "
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
    if mesh.parent == armature and mesh.parent_type == "BONE":
        return str(mesh.parent_bone)
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
