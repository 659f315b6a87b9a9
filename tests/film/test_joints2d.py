"""Joints in the image: inside, outside, behind, and their file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.camera_moves import look_at
from gmrdata.film.render_outputs import project_joints
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, load_joints, save_joints
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid


def filmed(body: BodyModel) -> Clip:
    """Row 0: the pelvis in the middle, 1 m ahead. Row 1: the camera has its back to the person."""
    root = np.tile([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (2, 1, 1))
    motion = Motion(
        np.tile(np.eye(3), (2, 23, 1, 1)),
        root,
        np.tile([0.0, 0.0, 0.95], (2, 1)),
        np.zeros(body.n_shape),
        10.0,
        body.name,
        "neutral",
        "world",
        "standing",
    )
    centres_m = np.array([[1.0, 0.0, 0.95], [1.0, 0.0, 0.95]])
    targets_m = np.array([[0.0, 0.0, 0.95], [2.0, 0.0, 0.95]])
    camera = CameraPath(
        intrinsics_from_fov(60, 64, 36),
        64,
        36,
        rigid(look_at(centres_m, targets_m), centres_m),
        np.ones(2, dtype=bool),
    )
    return Clip("two", motion, np.ones(2, dtype=bool), np.arange(2), camera)


def test_places_in_the_camera_and_the_image(small_body: BodyModel) -> None:
    joints = project_joints(filmed(small_body), small_body)
    pelvis = JOINT["pelvis"]
    np.testing.assert_allclose(joints.world_m[0, pelvis], [0, 0, 0.95], atol=1e-9)
    np.testing.assert_allclose(joints.camera_m[0, pelvis], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(joints.camera_m[1, pelvis], [0, 0, -1], atol=1e-9)
    np.testing.assert_allclose(joints.image_px[0, pelvis], [32, 18], atol=1e-9)
    # 9 cm to the left of someone who faces the camera is to the right in the image.
    focal_px = 32 / np.tan(np.deg2rad(30))
    left_hip_px = [32 + 0.09 * focal_px, 18 + 0.05 * focal_px]
    np.testing.assert_allclose(joints.image_px[0, JOINT["left_hip"]], left_hip_px, atol=1e-6)
    assert joints.in_frame[0, pelvis] and not joints.in_frame[0, JOINT["head"]]
    assert np.isnan(joints.image_px[1, pelvis]).all() and not joints.in_frame[1].any()


def test_a_clip_without_a_camera(small_body: BodyModel) -> None:
    with pytest.raises(BadMotionFile, match="two has no camera"):
        project_joints(replace(filmed(small_body), camera=None), small_body)


def test_the_file(small_body: BodyModel, tmp_path: Path) -> None:
    path = tmp_path / "joints.npz"
    joints = project_joints(filmed(small_body), small_body)
    save_joints(path, joints)
    first, read = path.read_bytes(), load_joints(path)
    for name in ("world_m", "camera_m", "image_px", "in_frame", "visible"):
        np.testing.assert_array_equal(getattr(read, name), getattr(joints, name))
    save_joints(path, read)
    assert path.read_bytes() == first
    write_npz(path, {"joints_px": joints.image_px})
    with pytest.raises(BadMotionFile, match="joints_world_m"):
        load_joints(path)
    with pytest.raises(MissingInput, match="gone.npz"):
        load_joints(tmp_path / "gone.npz")
