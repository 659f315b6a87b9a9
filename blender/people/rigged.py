# SPDX-License-Identifier: GPL-3.0-or-later
"""A rigged character in place of the body: brought in, driven by the motion, and measured."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from blender.light import Light
from blender.people.rigged_import import CharacterPart, Imported, carrier, imported, join
from blender.people.rigged_pose import (
    HIPS,
    RestPose,
    bone_rotations,
    check_rest,
    hips_m,
    joint_turns,
    of_feet,
    size_of,
)
from gmrdata.film.character import Character, find_bones, joint_of_bone
from gmrdata.motion.rest_pose import joints_of
from gmrdata.values.body import JOINT, N_JOINTS, BodyModel
from gmrdata.values.camera import CameraPath, in_frame
from gmrdata.values.clip import CharacterRecord
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m


@dataclass(frozen=True, eq=False)
class Figure:
    """A character that moves as the body does."""

    mesh: Any
    """Its bpy mesh."""
    vertices_m: np.ndarray
    """(T, V, 3) float32, world [m]."""
    joint_of_face: np.ndarray
    """(F,) joint that each face moves with."""
    joints_m: np.ndarray
    """(T, 24, 3) its joints, world [m]; NaN where it has no bone."""
    residual_m: np.ndarray
    """(T, 24, 3) the same less the body's [m]."""
    bones: tuple[str, ...]
    """24 names of bones, empty where there is none."""
    scale: float
    """By how much its file was enlarged."""

    def record(self, camera: CameraPath) -> CharacterRecord:
        """What is stored beside the clip, for the camera that films it."""
        return CharacterRecord(
            self.joints_m,
            self.residual_m,
            in_frame(camera, self.vertices_m),
            self.bones,
            self.scale,
        )


def bring_in(
    name: str, character: Character, body: BodyModel, motion: Motion, light: Light
) -> Figure:
    """Read a character's file and let it do what the body does in a motion.

    Nothing of it but the mesh and its materials stays in Blender.

    Args:
        name: Name of the mesh to make.
        character: The character; its files were checked by `Character.inputs`.
        body: The body.
        motion: Its motion, world frame.
        light: What falls on the character.

    Raises:
        BadCharacter: the file can't be read, or has no skeleton that fits.
    """
    path = character.path
    with imported(path) as puppet:
        names, parents = puppet.bone_names, puppet.bone_parents
        bones = find_bones(names, parents, character.joint_map, path)
        weights = _weights(puppet, joint_of_bone(bones, parents))
        parts = [CharacterPart(thing, _evaluated(thing)) for thing in puppet.meshes]
        mesh = join(name, parts, path, light)
        joints_m, vertices_m, scale = _driven(
            puppet, bones, weights, body, motion, keep_size=character.scale == "keep"
        )
    return Figure(
        mesh=mesh,
        vertices_m=vertices_m,
        joint_of_face=_joint_of_face(mesh, weights),
        joints_m=joints_m,
        residual_m=joints_m - motion_joints_m(body, motion),
        bones=tuple(names[bones[j]] if j in bones else "" for j in range(N_JOINTS)),
        scale=scale,
    )


def _driven(
    puppet: Imported,
    bones: Mapping[int, int],
    weights: np.ndarray,
    body: BodyModel,
    motion: Motion,
    *,
    keep_size: bool,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Joints (T, 24, 3) and vertices (T, V, 3) in the world [m], and the scale."""
    parents = puppet.bone_parents
    rest = _rest_pose(puppet, bones, np.concatenate(_vertices(puppet)), weights)
    axes = check_rest(rest, keep_size, str(puppet.path))
    rotations = bone_rotations(
        joint_turns(rest, axes, body, motion),
        joint_of_bone(bones, parents),
        parents,
        puppet.armature_from_bone,
        puppet.world_from_armature,
    )
    size = size_of(rest, axes, body, motion.shape, keep_size)
    wanted_m = hips_m(size, motion_joints_m(body, motion))
    joints_m = np.empty((motion.n_frames, N_JOINTS, 3))
    vertices_m = np.empty((motion.n_frames, len(weights), 3), np.float32)
    for row, (heads, vertices) in enumerate(_play(puppet, rotations, motion.n_frames)):
        joints = joints_of(heads, bones)
        hips = joints[list(HIPS)].mean(axis=0)
        joints_m[row] = size.scale * (joints - hips) + wanted_m[row]
        vertices_m[row] = size.scale * (vertices - hips) + wanted_m[row]
    return joints_m, vertices_m, size.scale


def _rest_pose(
    puppet: Imported, bones: Mapping[int, int], vertices: np.ndarray, weights: np.ndarray
) -> RestPose:
    heads, parents = _heads(puppet), puppet.bone_parents
    toe_tips = np.full((2, 3), np.nan)
    for row, joint in enumerate((JOINT["left_foot"], JOINT["right_foot"])):
        if joint in bones and bones[joint] in parents:
            toe_tips[row] = heads[parents.index(bones[joint])] - heads[bones[joint]]
    return RestPose(joints_of(heads, bones), toe_tips, vertices[of_feet(weights)])


def _play(
    puppet: Imported, rotations: Mapping[int, np.ndarray], n_frames: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Heads of the bones (B, 3) and vertices (V, 3) of each frame, in the file's world."""
    pose_bones = [puppet.armature.pose.bones[name] for name in puppet.bone_names]
    for row in range(n_frames):
        for bone, quaternions in rotations.items():
            pose_bones[bone].rotation_quaternion = quaternions[row]
        bpy.context.view_layer.update()
        yield _heads(puppet), np.concatenate(_vertices(puppet))


def _heads(puppet: Imported) -> np.ndarray:
    """(B, 3) where the bones start, in the file's world."""
    posed = puppet.armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    heads = np.array([posed[name].head for name in puppet.bone_names], dtype=np.float64)
    world = puppet.world_from_armature
    return np.asarray(heads @ world[:3, :3].T + world[:3, 3])


def _evaluated(thing: Any) -> Any:
    """An object's mesh, deformed."""
    return thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def _vertices(puppet: Imported) -> list[np.ndarray]:
    """(V, 3) of each mesh as it is now, in the file's world."""
    graph = bpy.context.evaluated_depsgraph_get()
    placed = []
    for thing in puppet.meshes:
        now = thing.evaluated_get(graph)
        points = np.empty(3 * len(now.data.vertices), np.float32)
        now.data.vertices.foreach_get("co", points)
        world = np.array(now.matrix_world, dtype=np.float64)
        placed.append(points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
    return placed


def _weights(puppet: Imported, joints: list[int]) -> np.ndarray:
    """(V, 24) share of each joint in each vertex of all meshes; zeros where no bone has a share."""
    joint_of = dict(zip(puppet.bone_names, joints, strict=True))
    tables = []
    for thing in puppet.meshes:
        vertices = _evaluated(thing).vertices
        weights = np.zeros((len(vertices), N_JOINTS))
        if bone := carrier(thing, puppet.armature):
            weights[:, joint_of[bone]] = 1.0
        else:
            group_joints = [joint_of.get(group.name) for group in thing.vertex_groups]
            for number, vertex in enumerate(vertices):
                for share in vertex.groups:
                    joint = group_joints[share.group]
                    if joint is not None:
                        weights[number, joint] += share.weight
        tables.append(weights)
    return np.concatenate(tables)


def _joint_of_face(mesh: Any, weights: np.ndarray) -> np.ndarray:
    """(F,) joint with the largest share in a face."""
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    starts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    return np.asarray(np.add.reduceat(weights[corners], starts, axis=0).argmax(axis=1))
