"""Passes and joints in the image through their files."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmrdata.film.render_outputs import (
    project_joints,
    read_depth,
    read_flow,
    read_instances,
    read_normals,
    write_depth,
    write_flow,
    write_instances,
    write_normals,
)
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.clip import Clip, load_joints, save_joints
from gmrdata.values.errors import BadFrames, BadMotionFile, MissingInput
from gmrdata.values.files import write_npz
from tests.blender.jobs import camera_at, facing_x
from tests.motions import bare_clip

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_what_is_written_is_read(seed, tmp_path_factory):
    path = tmp_path_factory.mktemp("passes") / "00000.png"
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.05, 65.5, (5, 7))
    write_depth(path, depth_m)
    assert np.abs(read_depth(path) - depth_m).max() <= 0.0005 + 1e-9
    normals = rng.normal(size=(5, 7, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    write_normals(path, normals)
    assert np.abs(read_normals(path) - normals).max() <= 1 / 65535 + 1e-9
    flow_px = rng.uniform(-511, 511, (5, 7, 2))
    write_flow(path, flow_px)
    assert np.abs(read_flow(path) - flow_px).max() <= 1 / 128 + 1e-9
    instances = rng.integers(0, 256, (5, 7))
    write_instances(path, instances)
    assert read_instances(path).dtype == np.uint8
    np.testing.assert_array_equal(read_instances(path), instances)


def test_pixels_without_a_value(tmp_path):
    path = tmp_path / "00000.png"
    write_depth(path, np.array([[1.0, np.inf, np.nan, 65.6, 1000.0]]))
    np.testing.assert_array_equal(read_depth(path), [[1.0, np.inf, np.inf, np.inf, np.inf]])
    write_normals(path, np.array([[[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]]))
    np.testing.assert_allclose(read_normals(path)[0], [[0, 0, -1], [0, 0, 0]], atol=1e-4)
    write_flow(path, np.array([[[1.5, -2.25], [np.nan, np.nan], [0.0, 513.0]]]))
    nan = np.nan
    np.testing.assert_array_equal(read_flow(path)[0], [[1.5, -2.25], [nan, nan], [nan, nan]])


def test_the_stored_numbers_are_those_that_the_format_names(tmp_path):
    path = tmp_path / "00000.png"
    write_depth(path, np.array([[2.0004]]))
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[2000]]
    write_normals(path, np.array([[[1.0, 0.0, -1.0]]]))
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[[0, 32768, 65535]]]
    write_flow(path, np.array([[[1.0, -2.0]]]))  # KITTI: u, v, valid in red, green, blue
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[[1, 32640, 32832]]]


def test_other_images_are_refused(tmp_path):
    path = tmp_path / "00000.png"
    with pytest.raises(BadFrames, match="00000.png: missing"):
        read_depth(path)
    cv2.imwrite(str(path), np.zeros((3, 3), np.uint8))
    with pytest.raises(BadFrames, match="16-bit"):
        read_depth(path)
    cv2.imwrite(str(path), np.zeros((3, 3), np.uint16))
    for read in (read_flow, read_normals):
        with pytest.raises(BadFrames, match="16-bit"):
            read(path)
    for wrong in (path, tmp_path / "absent.png"):
        with pytest.raises(BadFrames, match="8-bit"):
            read_instances(wrong)


def filmed(body: BodyModel) -> Clip:
    """Row 0: the pelvis in the middle, 1 m ahead. Row 1: the camera has its back to the person."""
    motion = facing_x(body, [[0.0, 0.0, 0.95]] * 2)
    targets_m = [[0.0, 0.0, 0.95], [2.0, 0.0, 0.95]]
    camera = camera_at([[1.0, 0.0, 0.95]] * 2, targets_m, (64, 36))
    return replace(bare_clip("two", motion), camera=camera)


def test_places_in_the_camera_and_the_image(small_body):
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


def test_a_clip_without_a_camera(small_body):
    with pytest.raises(BadMotionFile, match="two has no camera"):
        project_joints(replace(filmed(small_body), camera=None), small_body)


def test_the_file(small_body, tmp_path):
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
