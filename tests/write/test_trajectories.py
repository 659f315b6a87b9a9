"""Trajectories, opened by evo and by torch's safe loader."""

import numpy as np
import pytest
import torch
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

from gmrdata.values import transforms
from gmrdata.values.errors import BadMotionFile
from gmrdata.write.cameras import write_gem_x, write_kitti, write_tum


def some_poses(n: int) -> np.ndarray:
    rng = np.random.default_rng(4)
    rotmats = Rotation.from_rotvec(rng.normal(0, 2, (n, 3))).as_matrix()
    return transforms.rigid(rotmats, rng.normal(0, 50, (n, 3)))


def test_evo_reads_tum_and_kitti_trajectories(tmp_path):
    poses, times_s = some_poses(40), np.arange(40) / 30 + 100.0
    write_tum(tmp_path / "tum.txt", poses, times_s)
    write_kitti(tmp_path / "kitti.txt", poses)
    tum = file_interface.read_tum_trajectory_file(tmp_path / "tum.txt")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "kitti.txt")
    for read in (tum, kitti):
        assert np.abs(np.array(read.poses_se3) - poses).max() < 1e-9
    np.testing.assert_allclose(tum.timestamps, times_s, atol=1e-9)


def test_torch_reads_gem_x_cameras_without_running_anything(tmp_path):
    poses = some_poses(12)
    write_gem_x(tmp_path / "camera.pt", poses)
    cam_from_world = torch.load(tmp_path / "camera.pt", weights_only=True)
    assert cam_from_world.shape == (12, 4, 4) and cam_from_world.dtype == torch.float32
    assert np.abs(cam_from_world.numpy() @ poses - np.eye(4)).max() < 2e-5


@pytest.mark.parametrize("writer", [write_kitti, write_gem_x])
def test_a_pose_that_is_not_finite_is_an_error_and_leaves_no_file(writer, tmp_path):  # type: ignore[no-untyped-def]
    poses = some_poses(5)
    poses[3, 0, 3] = np.nan
    with pytest.raises(BadMotionFile, match="pose 3 is not finite"):
        writer(tmp_path / "out", poses)
    with pytest.raises(BadMotionFile, match="no poses"):
        writer(tmp_path / "out", poses[:0])
    assert not list(tmp_path.iterdir())
