"""Files of local poses as the estimators write them, by the sources that the readers name."""

import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.values.body import N_LOCAL
from tests.joblib_layout import joblib_bytes


def some_poses(n_frames: int, n_joints: int = 24, seed: int = 0) -> np.ndarray:
    """(T, 3 * n_joints) float32 axis-angle that changes smoothly [rad]."""
    rng = np.random.default_rng(seed)
    start, step = rng.normal(0, 0.3, (2, 3 * n_joints))
    times = np.arange(n_frames)[:, None] / 30
    return (start + 0.5 * np.sin(2 * times + step)).astype(np.float32)


def rotmats(poses: np.ndarray) -> np.ndarray:
    """(T, 3 * J) -> (T, J, 3, 3)."""
    flat = Rotation.from_rotvec(poses.reshape(-1, 3).astype(np.float64)).as_matrix()
    return flat.reshape(len(poses), -1, 3, 3)


def vibe_person(n_frames: int, frame_ids: Sequence[int] | None = None, seed: int = 0) -> dict:
    """One person of `vibe_output.pkl`."""
    frames = np.arange(n_frames) if frame_ids is None else np.asarray(frame_ids)
    return {
        "pred_cam": np.ones((n_frames, 3), np.float32),
        "orig_cam": np.ones((n_frames, 4), np.float32),
        "verts": np.zeros((n_frames, 5, 3), np.float32),
        "pose": some_poses(n_frames, seed=seed),
        "betas": np.linspace(0, 1, 10 * n_frames, dtype=np.float32).reshape(n_frames, 10),
        "joints2d": None,
        "bboxes": np.ones((n_frames, 4)),
        "frame_ids": frames,
    }


def write_vibe(path: Path, people: Mapping[Any, Mapping[str, Any]]) -> Path:
    """`vibe_output.pkl`."""
    path.write_bytes(joblib_bytes({key: dict(person) for key, person in people.items()}))
    return path


def write_wham(path: Path, people: Mapping[int, int]) -> Path:
    """`wham_output.pkl` of people with so many frames each: a defaultdict, numpy's ints as keys."""
    results: defaultdict[Any, dict[str, Any]] = defaultdict(dict)
    for person, n_frames in people.items():
        results[np.int64(person)] |= {
            "pose": some_poses(n_frames, seed=person),
            "trans": np.zeros((n_frames, 3), np.float32),
            "pose_world": some_poses(n_frames, seed=person + 1),
            "trans_world": np.zeros((n_frames, 3), np.float32),
            "betas": np.full((n_frames, 10), person, np.float32),
            "verts": np.zeros((n_frames, 5, 3), np.float32),
            "frame_ids": np.arange(n_frames),
        }
    path.write_bytes(joblib_bytes(results))
    return path


def phalp_frame(
    time: int, poses: Mapping[int, np.ndarray], unseen: Sequence[int] = (), shot: int = 0
) -> dict[str, Any]:
    """One frame of PHALP's file: each track's rotations (23, 3, 3), and which are not seen."""
    return {
        "time": time,
        "shot": shot,
        "frame_path": f"img/{time + 1:06d}.jpg",
        "tid": list(poses),
        "bbox": [np.ones(4) for _ in poses],
        "tracked_ids": [track for track in poses if track not in unseen],
        "tracked_bbox": [np.ones(4) for track in poses if track not in unseen],
        "tracked_time": [3 if track in unseen else 0 for track in poses],
        "conf": [np.float32(0.9) for _ in poses],
        "class_name": [np.int64(0) for _ in poses],
        "annotations": [[] for _ in poses],
        "mask": [[{"size": [4, 4], "counts": "04L3"}] for _ in poses],
        "size": [[480, 640] for _ in poses],
        "smpl": [
            {
                "global_orient": np.eye(3, dtype=np.float32)[None],
                "body_pose": pose.astype(np.float32),
                "betas": np.full(10, 0.5, np.float32),
            }
            for pose in poses.values()
        ],
    }


def write_phalp(path: Path, frames: Sequence[dict[str, Any]]) -> Path:
    """PHALP's results: packed with zlib."""
    content = {frame["frame_path"]: frame for frame in frames}
    path.write_bytes(zlib.compress(joblib_bytes(content), 3))
    return path


def phalp_poses(n_frames: int, seed: int = 0) -> np.ndarray:
    """(T, 23, 3, 3)."""
    return rotmats(some_poses(n_frames, N_LOCAL, seed))


def write_gvhmr(path: Path, n_frames: int, n_joints: int = 21) -> Path:
    """`hmr4d_results.pt`."""
    shared = {
        "body_pose": torch.from_numpy(some_poses(n_frames, n_joints)),
        "betas": torch.ones(n_frames, 10),
        "global_orient": torch.zeros(n_frames, 3),
        "transl": torch.zeros(n_frames, 3),
        "left_hand_pose": None,
    }
    torch.save(
        {
            "smpl_params_global": shared,
            "smpl_params_incam": dict(shared),
            "K_fullimg": torch.eye(3).repeat(n_frames, 1, 1),
            "net_outputs": {"static_conf_logits": torch.zeros(1, n_frames, 6)},
        },
        path,
    )
    return path
