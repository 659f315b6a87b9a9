"""Trajectories for evo and its kin: TUM's and KITTI's text forms; and GEM-X's camera file.

TUM (https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats): a line
`time[s] tx ty tz qx qy qz qw` per pose.  KITTI (http://www.cvlibs.net/datasets/kitti/eval_odometry):
a line per frame, the upper 3x4 of its transform row by row, without times.  Both map coordinates of
the moving thing to the world.  GEM-X (https://github.com/NVlabs/GEM-X, `scripts/demo`) reads
`preprocess/camera.pt`: one tensor (L, 4, 4) for the L frames of the video, cam_from_world in
OpenCV's axes; it takes the first camera as the origin itself.
"""

import io
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import write_bytes, write_text
from gmrdata.values.transforms import invert

DIGITS = 12  # significant; evo reads them as float64


def write_tum(path: Path, world_from_body: np.ndarray, times_s: np.ndarray) -> None:
    """Write poses (N, 4, 4) [m] at times (N,) [s]; BadMotionFile where one is not finite."""
    _require_poses(path, world_from_body)
    quats = Rotation.from_matrix(world_from_body[:, :3, :3]).as_quat()
    rows = np.concatenate([times_s[:, None], world_from_body[:, :3, 3], quats], axis=1)
    write_text(path, "# time[s] tx ty tz qx qy qz qw\n" + _lines(rows))


def write_kitti(path: Path, world_from_body: np.ndarray) -> None:
    """Write poses (N, 4, 4) [m], one for each frame; BadMotionFile where one is not finite."""
    _require_poses(path, world_from_body)
    write_text(path, _lines(world_from_body[:, :3].reshape(-1, 12)))


def write_gem_x(path: Path, world_from_cam: np.ndarray) -> None:
    """Write `camera.pt` of cameras (L, 4, 4) [m], as float32; opens with `weights_only`."""
    import torch

    _require_poses(path, world_from_cam)
    archive = io.BytesIO()
    torch.save(torch.from_numpy(invert(world_from_cam).astype(np.float32)), archive)
    write_bytes(path, archive.getbuffer())


def _require_poses(path: Path, world_from_body: np.ndarray) -> None:
    if not len(world_from_body):
        raise BadMotionFile(f"{path}: no poses to write")
    if bad := np.flatnonzero(~np.isfinite(world_from_body).all(axis=(1, 2))).tolist():
        raise BadMotionFile(f"{path}: pose {bad[0]} is not finite")


def _lines(rows: np.ndarray) -> str:
    return "".join(" ".join(f"{x:.{DIGITS}g}" for x in row) + "\n" for row in rows.tolist())
