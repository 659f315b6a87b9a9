"""A world motion as GLB (glTF 2.0, Khronos Group 2021): the skinned body with an animated skeleton.

Viewers, Blender, Unity and three.js play it.  In it y is up.  glTF has four joints for each vertex
and no blend shapes of the pose: of the skin weights the four largest are kept, and the bulges that
SMPL adds to bent joints are not in it.  Nor can its camera have a principal point off the middle;
the camera's `extras` have the whole calibration matrix.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion
from gmrdata.write.take import Performer, Take, check_take, quaternions_xyzw

JOINTS_PER_VERTEX = 4
SKIN_COLOUR = (0.55, 0.67, 0.83, 1.0)
GLTF_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
"""A camera of glTF looks along -z and has y up."""
NEAREST_M = 0.01
Track = tuple[int, str, np.ndarray, np.ndarray]
"""An animated node: its number, "rotation" or "translation", the rows, and the values there."""
UNSIGNED_BYTE, UNSIGNED_INT, FLOAT = 5121, 5125, 5126
_DTYPES = {UNSIGNED_BYTE: "<u1", UNSIGNED_INT: "<u4", FLOAT: "<f4"}
_TYPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (16,): "MAT4"}
_JSON_CHUNK, _DATA_CHUNK = 0x4E4F534A, 0x004E4942  # "JSON", "BIN"


@dataclass
class _Document:
    """A file in the making: its JSON, and its data, to which the accessors lead."""

    json: dict[str, Any]
    data: bytearray = field(default_factory=bytearray)

    def bytes(self) -> bytes:
        """The file: a header, then each chunk with its size, filled up to whole words."""
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text, chunks = text + b" " * (-len(text) % 4), b""
        for kind, chunk in ((_JSON_CHUNK, text), (_DATA_CHUNK, self.data)):
            chunks += np.array([len(chunk), kind], "<u4").tobytes() + chunk
        return b"glTF" + np.array([2, 12 + len(chunks)], "<u4").tobytes() + chunks


def write_glb(
    path: Path,
    motion: Motion,
    body: BodyModel,
    *,
    shown: np.ndarray | None = None,
    camera: CameraPath | None = None,
) -> None:
    """Write what `glb_bytes` makes."""
    write_bytes(path, glb_bytes(motion, body, shown=shown, camera=camera))


def glb_bytes(
    motion: Motion,
    body: BodyModel,
    *,
    shown: np.ndarray | None = None,
    camera: CameraPath | None = None,
) -> bytes:
    """The body with its motion in a z-up world, and the camera that films it.

    Frames that are not `shown` (T,), and those without a camera, have no sample: what plays the
    file moves straight on over them.
    """
    shown = np.ones(motion.n_frames, dtype=bool) if shown is None else shown
    check_take(Take("glb", (Performer(motion.source, motion, body, shown),), camera))
    colour = {"baseColorFactor": SKIN_COLOUR, "metallicFactor": 0.0, "roughnessFactor": 0.9}
    document = _Document(
        {
            "asset": {
                "version": "2.0",
                "generator": "gmrdata",
                "extras": {"source": motion.source},
            },
            "scene": 0,
            "scenes": [{"nodes": [len(PARENTS), len(PARENTS) + 1]}],
            "materials": [{"pbrMetallicRoughness": colour}],
            "accessors": [],
            "bufferViews": [],
        }
    )
    parts = document.json
    rows = np.flatnonzero(shown)
    quaternions, pelvis_m = quaternions_xyzw(motion.rotmats[rows]), motion.pelvis_m[rows]
    rest_joints_m = body.rest_joints_m(motion.shape)
    parts["meshes"] = [_mesh(document, body, motion.shape)]
    parts["nodes"] = _nodes(rest_joints_m, quaternions, pelvis_m)
    inverse_bind = np.tile(np.eye(4), (len(PARENTS), 1, 1))
    inverse_bind[:, :3, 3] = -rest_joints_m
    columns = inverse_bind.swapaxes(1, 2).reshape(-1, 16)  # matrices stand column by column
    bind = _add(document, columns, FLOAT)
    joints = list(range(len(PARENTS)))
    parts["skins"] = [{"joints": joints, "inverseBindMatrices": bind, "skeleton": 0}]
    tracks: list[Track] = [(j, "rotation", rows, quaternions[:, j]) for j in joints]
    tracks.append((0, "translation", rows, pelvis_m))
    if camera is not None and camera.has_camera.any():
        tracks += _film(document, camera)
    parts["animations"] = [_animation(document, tracks, motion.fps_hz)]
    parts["buffers"] = [{"byteLength": len(document.data)}]
    return document.bytes()


def _film(document: _Document, camera: CameraPath) -> list[Track]:
    """Add the camera and its node in the z-up world; gives what moves it."""
    (fx_px, _, _), (_, fy_px, _), _ = camera.intrinsics_px.tolist()
    half_width, half_height = camera.width_px / fx_px / 2, camera.height_px / fy_px / 2
    perspective = {
        "yfov": 2 * float(np.arctan(half_height)),
        "aspectRatio": half_width / half_height,
        "znear": NEAREST_M,
    }
    size_px = [camera.width_px, camera.height_px]
    extras = {"intrinsics_px": camera.intrinsics_px.tolist(), "size_px": size_px}
    kind = {"type": "perspective", "perspective": perspective}
    document.json["cameras"] = [kind | {"extras": extras}]
    rows = np.flatnonzero(camera.has_camera)
    quaternions = quaternions_xyzw(camera.world_from_cam[rows, None, :3, :3] @ GLTF_FROM_OPENCV)
    centres_m = camera.centres_world_m[rows]
    node = {"name": "camera", "camera": 0, "translation": centres_m[0].tolist()}
    nodes = document.json["nodes"]
    number = len(nodes)
    nodes.append(node | {"rotation": quaternions[0, 0].tolist()})
    nodes[len(PARENTS)]["children"].append(number)
    return [(number, "rotation", rows, quaternions[:, 0]), (number, "translation", rows, centres_m)]


def _add(document: _Document, array: np.ndarray, component: int, *, bounds: bool = False) -> int:
    """Append an array to the file's data; gives its accessor's number."""
    values = np.ascontiguousarray(array, dtype=_DTYPES[component])
    views, accessors = document.json["bufferViews"], document.json["accessors"]
    accessor: dict[str, Any] = {"bufferView": len(views), "componentType": component}
    accessor |= {"count": len(values), "type": _TYPES[values.shape[1:]]}
    if bounds:
        columns = values.reshape(len(values), -1)
        accessor |= {"min": columns.min(0).tolist(), "max": columns.max(0).tolist()}
    place = {"byteOffset": len(document.data), "byteLength": values.nbytes}
    views.append({"buffer": 0} | place)
    accessors.append(accessor)
    document.data += values.tobytes() + bytes(-values.nbytes % 4)
    return len(accessors) - 1


def _mesh(document: _Document, body: BodyModel, shape: np.ndarray) -> dict[str, Any]:
    import trimesh

    vertices_m = body.rest_vertices_m(shape)
    normals = trimesh.Trimesh(vertices_m, body.faces, process=False).vertex_normals
    joints = np.argsort(-body.skin_weights, axis=1, kind="stable")[:, :JOINTS_PER_VERTEX]
    weights = np.take_along_axis(body.skin_weights, joints, axis=1)
    shares = weights / weights.sum(axis=1, keepdims=True)
    attributes = {
        "POSITION": _add(document, vertices_m, FLOAT, bounds=True),
        "NORMAL": _add(document, normals, FLOAT),
        "JOINTS_0": _add(document, np.where(weights > 0, joints, 0), UNSIGNED_BYTE),
        "WEIGHTS_0": _add(document, shares, FLOAT),
    }
    faces = _add(document, body.faces.reshape(-1), UNSIGNED_INT)
    return {"primitives": [{"attributes": attributes, "indices": faces, "material": 0}]}


def _nodes(
    rest_joints_m: np.ndarray, quaternions: np.ndarray, pelvis_m: np.ndarray
) -> list[dict[str, Any]]:
    """24 joints in the tree's order as in the first frame, the z-up world, and the body."""
    nodes: list[dict[str, Any]] = []
    for joint, parent in enumerate(PARENTS):
        place_m = pelvis_m[0] if parent < 0 else rest_joints_m[joint] - rest_joints_m[parent]
        node: dict[str, Any] = {"name": JOINT_NAMES[joint], "translation": place_m.tolist()}
        node["rotation"] = quaternions[0, joint].tolist()
        if children := [child for child, p in enumerate(PARENTS) if p == joint]:
            node["children"] = children
        nodes.append(node)
    y_up_from_z_up = Rotation.from_matrix(WORLD_FROM_REST.T).as_quat().tolist()
    nodes.append({"name": "z_up_world", "rotation": y_up_from_z_up, "children": [0]})
    return [*nodes, {"name": "body", "mesh": 0, "skin": 0}]


def _animation(document: _Document, tracks: list[Track], fps_hz: float) -> dict[str, Any]:
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    times = dict[bytes, int]()
    for n, (node, path, rows, values) in enumerate(tracks):
        if rows.tobytes() not in times:
            times[rows.tobytes()] = _add(document, rows / fps_hz, FLOAT, bounds=True)
        output = _add(document, values, FLOAT)
        at = times[rows.tobytes()]
        samplers.append({"input": at, "interpolation": "LINEAR", "output": output})
        channels.append({"sampler": n, "target": {"node": node, "path": path}})
    return {"name": "motion", "samplers": samplers, "channels": channels}
