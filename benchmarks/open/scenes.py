"""Motions through scenes and recordings: written, and read by OpenUSD, pygltflib and rerun."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT_NAMES, BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_rad, rigid
from gmrdata.write.glb import write_glb
from gmrdata.write.recording import write_recording
from gmrdata.write.take import Performer, Take
from gmrdata.write.usd import write_usd
from tests.write.rerun_files import Recorded

WIDTH_PX, HEIGHT_PX = 640, 480


def usd(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    """The joints' own transforms, as UsdSkel works them out."""
    from pxr import Usd, UsdSkel

    write_usd(folder / "motion.usdc", _take(motion, body))
    stage, cache = Usd.Stage.Open(str(folder / "motion.usdc")), UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/World/person"), Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/World/person/skeleton"))
    rows = range(round(stage.GetEndTimeCode()) + 1)
    local = np.array([query.ComputeJointLocalTransforms(row) for row in rows]).swapaxes(-1, -2)
    turned = Rotation.from_matrix(local[..., :3, :3].reshape(-1, 3, 3)).as_matrix()
    found = _moved(motion, turned.reshape(len(local), -1, 3, 3), local[:, 0, :3, 3])
    return replace(found, fps_hz=stage.GetTimeCodesPerSecond())


def glb(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    """The file has times in single precision: its rate is the motion's if they are its times."""
    write_glb(folder / "motion.glb", motion, body)
    document = pygltflib.GLTF2().load(str(folder / "motion.glb"))
    tracks: dict[tuple[str, str], np.ndarray] = {}
    times_s = np.zeros(0)
    for channel in document.animations[0].channels:
        sampler = document.animations[0].samplers[channel.sampler]
        times_s = _array(document, sampler.input)[:, 0]
        node = document.nodes[channel.target.node].name
        tracks[node, channel.target.path] = _array(document, sampler.output)
    quaternions = np.stack([tracks[name, "rotation"] for name in JOINT_NAMES], axis=1)
    turned = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()
    turned = turned.reshape(*quaternions.shape[:2], 3, 3)
    found = _moved(motion, turned, tracks["pelvis", "translation"])
    expected_s = np.arange(motion.n_frames) / motion.fps_hz
    on_time = np.array_equal(times_s, expected_s.astype(np.float32))
    return replace(found, fps_hz=motion.fps_hz if on_time else np.nan)


def recording(motion: Motion, body: BodyModel, folder: Path) -> dict[str, float]:
    """How far the joints of a recording, and the turns of a camera that goes with the pelvis, are
    from those that were written; a recording has no joint angles."""
    take = _take(motion, body)
    write_recording(folder / "motion.rrd", [take])
    found = Recorded(folder / "motion.rrd")
    by_frame = found.values("world/result/person/joints", "Points3D:positions")
    cameras = found.transforms("world/result/camera")
    assert take.camera is not None and list(by_frame) == list(range(motion.n_frames))
    joints_m = np.array(list(by_frame.values()))
    off_m = np.linalg.norm(joints_m - motion_joints_m(body, motion), axis=-1)
    rotmats = np.stack([cameras[row][:3, :3] for row in range(motion.n_frames)])
    turned_rad = angles_rad(take.camera.world_from_cam[:, :3, :3].swapaxes(-1, -2) @ rotmats)
    return {
        "round_trip_mm_max": 1000.0 * float(off_m.max()),
        "round_trip_deg_max": float(np.rad2deg(turned_rad.max())),
    }


def _take(motion: Motion, body: BodyModel) -> Take:
    world_from_cam = rigid(motion.root_rotmats, motion.pelvis_m)
    everywhere = np.ones(motion.n_frames, dtype=bool)
    intrinsics_px = intrinsics_from_fov(60.0, WIDTH_PX, HEIGHT_PX)
    camera = CameraPath(intrinsics_px, WIDTH_PX, HEIGHT_PX, world_from_cam, everywhere)
    return Take("result", (Performer("person", motion, body, everywhere),), camera)


def _moved(motion: Motion, rotmats: np.ndarray, pelvis_m: np.ndarray) -> Motion:
    """The motion with other rotations (T, 24, 3, 3) and another path (T, 3) [m]."""
    local, root = rotmats[:, 1:], rotmats[:, 0]
    return replace(motion, local_rotmats=local, root_rotmats=root, pelvis_m=pelvis_m)


def _array(document: Any, number: int) -> np.ndarray:
    accessor = document.accessors[number]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    start = document.bufferViews[accessor.bufferView].byteOffset
    blob = document.binary_blob()
    return np.frombuffer(blob, "<f4", accessor.count * columns, start).reshape(-1, columns)
