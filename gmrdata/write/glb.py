"""A world motion as GLB (glTF 2.0, Khronos Group 2021): the skinned body with an animated skeleton.

Viewers, Blender, Unity and three.js play it.  In it y is up.  glTF has four joints for each vertex
and no blend shapes of the pose: of the skin weights the four largest are kept, and the bulges that
SMPL adds to bent joints are not in it.
"""

from pathlib import Path

import numpy as np
import pygltflib as gltf
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion

JOINTS_PER_VERTEX = 4
SKIN_COLOUR = (0.55, 0.67, 0.83, 1.0)
_DTYPES = {gltf.UNSIGNED_BYTE: "<u1", gltf.UNSIGNED_INT: "<u4", gltf.FLOAT: "<f4"}
_TYPES = {(): gltf.SCALAR, (3,): gltf.VEC3, (4,): gltf.VEC4, (16,): gltf.MAT4}


def write_glb(path: Path, motion: Motion, body: BodyModel) -> None:
    """Write the body with its motion in a z-up world."""
    surface = gltf.PbrMetallicRoughness(
        baseColorFactor=list(SKIN_COLOUR), metallicFactor=0.0, roughnessFactor=0.9
    )
    document = gltf.GLTF2(
        asset=gltf.Asset(generator="gmrdata", extras={"source": motion.source}),
        scene=0,
        scenes=[gltf.Scene(nodes=[len(PARENTS), len(PARENTS) + 1])],
        materials=[gltf.Material(pbrMetallicRoughness=surface)],
        buffers=[gltf.Buffer(byteLength=0)],
    )
    document.set_binary_blob(b"")
    quaternions = _quaternions(motion)
    rest_joints_m = body.rest_joints_m(motion.shape)
    document.meshes = [_mesh(document, body, motion.shape)]
    document.nodes = _nodes(rest_joints_m, quaternions, motion.pelvis_m)
    inverse_bind = np.tile(np.eye(4), (len(PARENTS), 1, 1))
    inverse_bind[:, :3, 3] = -rest_joints_m
    columns = inverse_bind.swapaxes(1, 2).reshape(-1, 16)  # matrices stand column by column
    bind = _add(document, columns, gltf.FLOAT)
    joints = list(range(len(PARENTS)))
    document.skins = [gltf.Skin(joints=joints, inverseBindMatrices=bind, skeleton=0)]
    document.animations = [_animation(document, quaternions, motion)]
    document.buffers[0].byteLength = len(document.binary_blob())
    write_bytes(path, b"".join(document.save_to_bytes()))


def _add(document: gltf.GLTF2, array: np.ndarray, component: int, *, bounds: bool = False) -> int:
    """Append an array to the file's data; gives its accessor's number."""
    values = np.ascontiguousarray(array, dtype=_DTYPES[component])
    data = document.binary_blob()
    view = gltf.BufferView(buffer=0, byteOffset=len(data), byteLength=values.nbytes)
    columns = values.reshape(len(values), -1)
    accessor = gltf.Accessor(
        bufferView=len(document.bufferViews),
        componentType=component,
        count=len(values),
        type=_TYPES[values.shape[1:]],
        min=columns.min(0).tolist() if bounds else None,
        max=columns.max(0).tolist() if bounds else None,
    )
    document.set_binary_blob(data + values.tobytes() + bytes(-values.nbytes % 4))
    document.bufferViews.append(view)
    document.accessors.append(accessor)
    return len(document.accessors) - 1


def _quaternions(motion: Motion) -> np.ndarray:
    """(T, 24, 4) x, y, z, w of all joints; signs that never jump, so that players interpolate."""
    found = Rotation.from_matrix(motion.rotmats.reshape(-1, 3, 3)).as_quat()
    found = found.reshape(motion.n_frames, -1, 4)
    jumps = (found[1:] * found[:-1]).sum(-1, keepdims=True) < 0
    found[1:] *= np.cumprod(np.where(jumps, -1.0, 1.0), axis=0)
    return found


def _mesh(document: gltf.GLTF2, body: BodyModel, shape: np.ndarray) -> gltf.Mesh:
    import trimesh

    vertices_m = body.rest_vertices_m(shape)
    normals = trimesh.Trimesh(vertices_m, body.faces, process=False).vertex_normals
    joints = np.argsort(-body.skin_weights, axis=1, kind="stable")[:, :JOINTS_PER_VERTEX]
    weights = np.take_along_axis(body.skin_weights, joints, axis=1)
    shares = weights / weights.sum(axis=1, keepdims=True)
    attributes = gltf.Attributes(
        POSITION=_add(document, vertices_m, gltf.FLOAT, bounds=True),
        NORMAL=_add(document, normals, gltf.FLOAT),
        JOINTS_0=_add(document, np.where(weights > 0, joints, 0), gltf.UNSIGNED_BYTE),
        WEIGHTS_0=_add(document, shares, gltf.FLOAT),
    )
    faces = _add(document, body.faces.reshape(-1), gltf.UNSIGNED_INT)
    return gltf.Mesh(primitives=[gltf.Primitive(attributes=attributes, indices=faces, material=0)])


def _nodes(
    rest_joints_m: np.ndarray, quaternions: np.ndarray, pelvis_m: np.ndarray
) -> list[gltf.Node]:
    """24 joints in the tree's order as in the first frame, the z-up world, and the body."""
    nodes = []
    for joint, parent in enumerate(PARENTS):
        place_m = pelvis_m[0] if parent < 0 else rest_joints_m[joint] - rest_joints_m[parent]
        node = gltf.Node(name=JOINT_NAMES[joint], translation=place_m.tolist())
        node.rotation = quaternions[0, joint].tolist()
        node.children = [child for child, p in enumerate(PARENTS) if p == joint]
        nodes.append(node)
    y_up_from_z_up = Rotation.from_matrix(WORLD_FROM_REST.T).as_quat().tolist()
    nodes.append(gltf.Node(name="z_up_world", rotation=y_up_from_z_up, children=[0]))
    return [*nodes, gltf.Node(name="body", mesh=0, skin=0)]


def _animation(document: gltf.GLTF2, quaternions: np.ndarray, motion: Motion) -> gltf.Animation:
    times_s = _add(document, np.arange(motion.n_frames) / motion.fps_hz, gltf.FLOAT, bounds=True)
    outputs = [(joint, "rotation", quaternions[:, joint]) for joint in range(len(PARENTS))]
    outputs.append((0, "translation", motion.pelvis_m))
    animation = gltf.Animation(name="motion")
    for n, (node, path, values) in enumerate(outputs):
        output = _add(document, values, gltf.FLOAT)
        animation.samplers.append(gltf.AnimationSampler(input=times_s, output=output))
        target = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=n, target=target))
    return animation
