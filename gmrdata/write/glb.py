"""A world motion as GLB (glTF 2.0, Khronos Group 2021): the skinned body with an animated skeleton.

Viewers, Blender, Unity and three.js play it.  In it y is up.  glTF has four joints for each vertex
and no blend shapes of the pose: of the skin weights the four largest are kept, and the bulges that
SMPL adds to bent joints are not in it.  Nor can its camera have a principal point off the middle;
the camera's `extras` have the whole calibration matrix.
"""

from pathlib import Path

import numpy as np
import pygltflib as gltf
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
_DTYPES = {gltf.UNSIGNED_BYTE: "<u1", gltf.UNSIGNED_INT: "<u4", gltf.FLOAT: "<f4"}
_TYPES = {(): gltf.SCALAR, (3,): gltf.VEC3, (4,): gltf.VEC4, (16,): gltf.MAT4}


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
    rows = np.flatnonzero(shown)
    quaternions, pelvis_m = quaternions_xyzw(motion.rotmats[rows]), motion.pelvis_m[rows]
    rest_joints_m = body.rest_joints_m(motion.shape)
    document.meshes = [_mesh(document, body, motion.shape)]
    document.nodes = _nodes(rest_joints_m, quaternions, pelvis_m)
    inverse_bind = np.tile(np.eye(4), (len(PARENTS), 1, 1))
    inverse_bind[:, :3, 3] = -rest_joints_m
    columns = inverse_bind.swapaxes(1, 2).reshape(-1, 16)  # matrices stand column by column
    bind = _add(document, columns, gltf.FLOAT)
    joints = list(range(len(PARENTS)))
    document.skins = [gltf.Skin(joints=joints, inverseBindMatrices=bind, skeleton=0)]
    tracks: list[Track] = [(j, "rotation", rows, quaternions[:, j]) for j in joints]
    tracks.append((0, "translation", rows, pelvis_m))
    if camera is not None and camera.has_camera.any():
        tracks += _film(document, camera)
    document.animations = [_animation(document, tracks, motion.fps_hz)]
    document.buffers[0].byteLength = len(document.binary_blob())
    return b"".join(document.save_to_bytes())


def _film(document: gltf.GLTF2, camera: CameraPath) -> list[Track]:
    """Add the camera and its node in the z-up world; gives what moves it."""
    (fx_px, _, _), (_, fy_px, _), _ = camera.intrinsics_px.tolist()
    half_width, half_height = camera.width_px / fx_px / 2, camera.height_px / fy_px / 2
    perspective = gltf.Perspective(
        yfov=2 * float(np.arctan(half_height)),
        aspectRatio=half_width / half_height,
        znear=NEAREST_M,
    )
    size_px = [camera.width_px, camera.height_px]
    extras = {"intrinsics_px": camera.intrinsics_px.tolist(), "size_px": size_px}
    document.cameras = [gltf.Camera(type="perspective", perspective=perspective, extras=extras)]
    rows = np.flatnonzero(camera.has_camera)
    quaternions = quaternions_xyzw(camera.world_from_cam[rows, None, :3, :3] @ GLTF_FROM_OPENCV)
    centres_m = camera.centres_world_m[rows]
    node = gltf.Node(name="camera", camera=0, translation=centres_m[0].tolist())
    node.rotation = quaternions[0, 0].tolist()
    number = len(document.nodes)
    document.nodes.append(node)
    document.nodes[len(PARENTS)].children.append(number)
    return [(number, "rotation", rows, quaternions[:, 0]), (number, "translation", rows, centres_m)]


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


def _animation(document: gltf.GLTF2, tracks: list[Track], fps_hz: float) -> gltf.Animation:
    animation, times = gltf.Animation(name="motion"), dict[bytes, int]()
    for n, (node, path, rows, values) in enumerate(tracks):
        if rows.tobytes() not in times:
            times[rows.tobytes()] = _add(document, rows / fps_hz, gltf.FLOAT, bounds=True)
        output = _add(document, values, gltf.FLOAT)
        sampler = gltf.AnimationSampler(input=times[rows.tobytes()], output=output)
        animation.samplers.append(sampler)
        target = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=n, target=target))
    return animation
