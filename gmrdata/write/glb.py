"""A world motion as GLB (glTF 2.0, Khronos Group 2021): the skinned body with an animated skeleton.

trimesh reads and writes meshes of GLB but no skins and no animations, so the file is laid out here.
Viewers, Blender, Unity and three.js play it.  In it y is up.  glTF has four joints for each vertex
and no blend shapes of the pose: of the skin weights the four largest are kept, and the bulges that
SMPL adds to bent joints are not in it.
"""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.files import atomic_path
from gmrdata.values.motion import Motion

BYTE, INDEX, FLOAT = 5121, 5125, 5126
_TYPES = {BYTE: "<u1", INDEX: "<u4", FLOAT: "<f4"}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (16,): "MAT4"}
JOINTS_PER_VERTEX = 4
SKIN_COLOUR = (0.55, 0.67, 0.83, 1.0)


@dataclass
class _Buffer:
    """The file's arrays while it is being put together."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, array: np.ndarray, component: int, *, bounds: bool = False) -> int:
        """Append an array; gives its accessor's number."""
        values = np.ascontiguousarray(array, dtype=_TYPES[component])
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": component,
            "count": len(values),
            "type": _SHAPES[values.shape[1:]],
        }
        if bounds:
            columns = values.reshape(len(values), -1)
            accessor |= {"min": columns.min(0).tolist(), "max": columns.max(0).tolist()}
        self.data += values.tobytes() + bytes(-values.nbytes % 4)
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def write_glb(path: Path, motion: Motion, body: BodyModel) -> None:
    """Write the body with its motion.

    Args:
        motion: In a z-up world.
    """
    buffer = _Buffer()
    quaternions = _quaternions(motion)
    mesh = _mesh(buffer, body, motion.shape)
    rest_joints_m = body.rest_joints_m(motion.shape)
    inverse_bind = np.tile(np.eye(4), (len(PARENTS), 1, 1))
    inverse_bind[:, :3, 3] = -rest_joints_m
    columns = inverse_bind.swapaxes(1, 2).reshape(-1, 16)  # matrices stand column by column
    tree = {
        "asset": {"version": "2.0", "generator": "gmrdata", "extras": {"source": motion.source}},
        "scene": 0,
        "scenes": [{"nodes": [len(PARENTS), len(PARENTS) + 1]}],
        "nodes": _nodes(rest_joints_m, quaternions, motion.pelvis_m),
        "meshes": [mesh],
        "materials": [_material()],
        "skins": [
            {
                "joints": list(range(len(PARENTS))),
                "inverseBindMatrices": buffer.add(columns, FLOAT),
                "skeleton": 0,
            }
        ],
        "animations": [_animation(buffer, quaternions, motion)],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    with atomic_path(path) as temporary:
        temporary.write_bytes(_container(tree, bytes(buffer.data)))


def _quaternions(motion: Motion) -> np.ndarray:
    """(T, 24, 4) x, y, z, w of all joints; signs that never jump, so that players interpolate."""
    rotmats = motion.rotmats
    found = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_quat()
    found = found.reshape(motion.n_frames, -1, 4)
    jumps = (found[1:] * found[:-1]).sum(-1, keepdims=True) < 0
    found[1:] *= np.cumprod(np.where(jumps, -1.0, 1.0), axis=0)
    return found


def _mesh(buffer: _Buffer, body: BodyModel, shape: np.ndarray) -> dict[str, Any]:
    import trimesh

    vertices_m = body.rest_vertices_m(shape)
    normals = trimesh.Trimesh(vertices_m, body.faces, process=False).vertex_normals
    joints = np.argsort(-body.skin_weights, axis=1, kind="stable")[:, :JOINTS_PER_VERTEX]
    weights = np.take_along_axis(body.skin_weights, joints, axis=1)
    attributes = {
        "POSITION": buffer.add(vertices_m, FLOAT, bounds=True),
        "NORMAL": buffer.add(normals, FLOAT),
        "JOINTS_0": buffer.add(np.where(weights > 0, joints, 0), BYTE),
        "WEIGHTS_0": buffer.add(weights / weights.sum(axis=1, keepdims=True), FLOAT),
    }
    faces = buffer.add(body.faces.reshape(-1), INDEX)
    return {"primitives": [{"attributes": attributes, "indices": faces, "material": 0}]}


def _material() -> dict[str, Any]:
    surface = {"baseColorFactor": SKIN_COLOUR, "metallicFactor": 0.0, "roughnessFactor": 0.9}
    return {"pbrMetallicRoughness": surface}


def _nodes(
    rest_joints_m: np.ndarray, quaternions: np.ndarray, pelvis_m: np.ndarray
) -> list[dict[str, Any]]:
    """24 joints in the tree's order as in the first frame, the z-up world, and the body."""
    nodes: list[dict[str, Any]] = []
    for joint, parent in enumerate(PARENTS):
        place_m = pelvis_m[0] if parent < 0 else rest_joints_m[joint] - rest_joints_m[parent]
        node = {
            "name": JOINT_NAMES[joint],
            "translation": place_m.tolist(),
            "rotation": quaternions[0, joint].tolist(),
        }
        children = [child for child, p in enumerate(PARENTS) if p == joint]
        nodes.append(node | ({"children": children} if children else {}))
    y_up_from_z_up = Rotation.from_matrix(WORLD_FROM_REST.T).as_quat().tolist()
    nodes.append({"name": "z_up_world", "rotation": y_up_from_z_up, "children": [0]})
    nodes.append({"name": "body", "mesh": 0, "skin": 0})
    return nodes


def _animation(buffer: _Buffer, quaternions: np.ndarray, motion: Motion) -> dict[str, Any]:
    times = buffer.add(np.arange(motion.n_frames) / motion.fps_hz, FLOAT, bounds=True)
    outputs = [(joint, "rotation", quaternions[:, joint]) for joint in range(len(PARENTS))]
    outputs.append((0, "translation", motion.pelvis_m))
    return {
        "name": "motion",
        "samplers": [
            {"input": times, "output": buffer.add(values, FLOAT), "interpolation": "LINEAR"}
            for _, _, values in outputs
        ],
        "channels": [
            {"sampler": n, "target": {"node": node, "path": path}}
            for n, (node, path, _) in enumerate(outputs)
        ],
    }


def _container(tree: dict[str, Any], data: bytes) -> bytes:
    """The file: a header, the JSON filled up with blanks, the arrays."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
