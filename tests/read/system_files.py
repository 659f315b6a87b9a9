"""Files of people in the world as WHAM, VIBE, GVHMR, TRAM and SLAHMR write them, of a true motion.

Made by what their scripts do, each in its own axes: y up in WHAM, GVHMR and TRAM, the camera's in
VIBE, the first camera's in SLAHMR.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.values.camera import CameraPath
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import invert
from gmrdata.world.compose import motion_in_camera
from tests.joblib_layout import joblib_bytes

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
Y_DOWN_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
SMPLX_PELVIS_M = np.array([0.0031, -0.3514, 0.0120])


def rotvecs(rotmats: np.ndarray) -> np.ndarray:
    """(T, ..., 3, 3) -> (T, ... * 3)."""
    found = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(found.reshape(len(rotmats), -1))


def turned(motion: Motion, rotmat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3, 3) and pelvis (T, 3) in other axes."""
    return rotmat @ motion.root_rotmats, motion.pelvis_m @ rotmat.T


def write_wham(
    path: Path, people: dict[int, tuple[Motion, np.ndarray]], rest_pelvis_m: np.ndarray
) -> Path:
    """Each person's motion, and the frames that its rows are."""
    found = {}
    for number, (motion, frames) in people.items():
        roots, pelvis_m = turned(motion, Y_UP_FROM_Z_UP)
        pose = np.concatenate([rotvecs(roots), rotvecs(motion.local_rotmats)], axis=1)
        found[np.int64(number)] = {
            "pose_world": pose,
            "trans_world": pelvis_m - rest_pelvis_m,
            "betas": np.tile(np.pad(motion.shape, (0, 10 - len(motion.shape))), (len(pose), 1)),
            "verts": np.zeros((len(pose), 5, 3), np.float32),
            "frame_ids": frames,
        }
    return _put(path, joblib_bytes(found))


def write_vibe(
    path: Path, motion: Motion, camera: CameraPath, frames: np.ndarray, rest_pelvis_m: np.ndarray
) -> Path:
    """The weak-perspective camera that puts SMPL's origin where it is before the camera: of a crop,
    and in the whole image as VIBE has it, by a box that is a tenth smaller than the crop."""
    seen = motion_in_camera(motion, camera.world_from_cam)
    origin_m = seen.pelvis_m - rest_pelvis_m
    centre_px, half_px = camera.intrinsics_px[:2, 2], np.array([camera.width_px, camera.height_px])
    px_per_m, half_px = camera.intrinsics_px[0, 0] / origin_m[:, 2:], half_px / 2
    middles_px = centre_px + px_per_m * (origin_m[:, :2] + [0.1, -0.2])
    sides_px = 1.8 * px_per_m
    crop = np.concatenate(
        [2 * px_per_m / (1.1 * sides_px), np.tile([-0.1, 0.2], (len(frames), 1))], 1
    )
    scales = crop[:, :1] * sides_px / (2 * half_px)
    person = {
        "pred_cam": crop,
        "orig_cam": np.c_[scales, (middles_px - half_px) / half_px / scales + crop[:, 1:]],
        "pose": np.concatenate([rotvecs(seen.root_rotmats), rotvecs(seen.local_rotmats)], axis=1),
        "betas": np.tile(motion.shape, (len(frames), 1)),
        "joints2d": None,
        "bboxes": np.c_[middles_px, sides_px, sides_px],
        "frame_ids": frames,
    }
    return _put(path, joblib_bytes({1: person}))


def write_gvhmr(path: Path, motion: Motion, cam_rotmats: np.ndarray) -> Path:
    """`cam_rotmats` (T, 3, 3): cam_from_world of the camera that saw it."""
    roots, pelvis_m = turned(motion, Y_UP_FROM_Z_UP)
    shared = {
        "body_pose": torch.from_numpy(rotvecs(motion.local_rotmats)[:, :63]),
        "betas": torch.ones(motion.n_frames, 10),
        "global_orient": torch.from_numpy(rotvecs(roots)),
        "transl": torch.from_numpy(pelvis_m - SMPLX_PELVIS_M),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    seen = shared | {"global_orient": torch.from_numpy(rotvecs(cam_rotmats @ motion.root_rotmats))}
    torch.save({"smpl_params_global": shared, "smpl_params_incam": seen, "net_outputs": {}}, path)
    return path


def write_tram(
    folder: Path, motion: Motion, camera: CameraPath, frames: np.ndarray, rest_pelvis_m: np.ndarray
) -> Path:
    """`camera.npy` and one track; the camera's frames are numbered from 0."""
    seen = motion_in_camera(motion, camera.world_from_cam)
    n_cameras = int(frames.max()) + 1
    world_from_cam = np.tile(np.eye(4), (n_cameras, 1, 1))
    world_from_cam[frames, :3, :3] = Y_UP_FROM_Z_UP @ camera.world_from_cam[:, :3, :3]
    # In a world of its own.
    world_from_cam[frames, :3, 3] = camera.centres_world_m @ Y_UP_FROM_Z_UP.T + [3.0, 1.0, 2.0]
    rotmats = np.concatenate([seen.root_rotmats[:, None], seen.local_rotmats], axis=1)
    people = {
        "pred_cam": torch.ones(len(frames), 3),
        "pred_shape": torch.from_numpy(np.tile(motion.shape, (len(frames), 1))),
        "pred_rotmat": torch.from_numpy(rotmats),
        "pred_trans": torch.from_numpy(seen.pelvis_m - rest_pelvis_m)[:, None],
        "frame": torch.from_numpy(frames),
    }
    cameras = {
        "world_cam_R": world_from_cam[:, :3, :3],
        "world_cam_T": world_from_cam[:, :3, 3],
        "img_focal": np.float64(1000.0),
        "img_center": np.zeros(2),
    }
    (folder / "hps").mkdir(parents=True, exist_ok=True)
    np.save(folder / "camera.npy", cameras)  # type: ignore[arg-type]  # as TRAM does
    np.save(folder / "hps" / "hps_track_0.npy", people)  # type: ignore[arg-type]
    return folder


def write_slahmr(
    folder: Path,
    people: dict[int, Motion],
    camera: CameraPath,
    rest_pelvis_m: np.ndarray,
    *,
    first_image: int = 0,
    before: int = 0,
) -> Path:
    """A run: `track_info.json`, and `motion_chunks` with results of two steps.

    The rows begin `before` images after the first one of SLAHMR's interval, which is `first_image`.
    """
    rows = [turned(motion, Y_DOWN_FROM_Z_UP) for motion in people.values()]
    n_frames = len(rows[0][0])
    axes = np.eye(4)
    axes[:3, :3] = Y_DOWN_FROM_Z_UP
    cam_from_world = invert(axes @ camera.world_from_cam)
    shapes = [np.pad(motion.shape, (0, 16 - len(motion.shape))) for motion in people.values()]
    arrays = {
        "trans": np.stack([pelvis_m - rest_pelvis_m for _, pelvis_m in rows]),
        "root_orient": np.stack([rotvecs(roots) for roots, _ in rows]),
        "pose_body": np.stack([rotvecs(one.local_rotmats)[:, :63] for one in people.values()]),
        "betas": np.stack(shapes),
        "cam_R": np.stack([cam_from_world[:, :3, :3]] * len(rows)),
        "cam_t": np.stack([cam_from_world[:, :3, 3]] * len(rows)),
        "world_scale": np.ones((1, 1)),
        "floor_plane": np.array([[0.0, -1.0, 0.0]]),
    }
    (folder / "motion_chunks").mkdir(parents=True, exist_ok=True)
    for step, name in ((20, "world"), (40, "world"), (40, "prior")):
        shown = arrays | ({"trans": 0 * arrays["trans"]} if step == 20 else {})
        np.savez(folder / "motion_chunks" / f"x_{step:06d}_{name}_results.npz", **shown)
    seen = [False] * before + [True] * n_frames
    info: dict[str, Any] = {
        "tracks": {str(id): {"index": n, "vis_mask": seen} for n, id in enumerate(people)},
        "meta": {
            "seq_interval": [before, before + n_frames],
            "data_interval": [first_image, first_image + before + n_frames],
        },
    }
    (folder / "track_info.json").write_text(json.dumps(info))
    return folder


def write_amass(path: Path, motion: Motion, rest_pelvis_m: np.ndarray, **more: Any) -> Path:
    roots = motion.root_rotmats
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {
        "poses": np.concatenate([rotvecs(roots), rotvecs(motion.local_rotmats)], axis=1),
        "trans": motion.pelvis_m - rest_pelvis_m,
        "betas": motion.shape,
        "gender": "neutral",
        "mocap_framerate": motion.fps_hz,
    }
    np.savez(path, **arrays | more)
    return path


def _put(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
