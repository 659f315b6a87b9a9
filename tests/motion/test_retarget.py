"""Retargeting: known answers on made-up skeletons, and directions on CMU's."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.files import read_motion
from gmrdata.motion.rest_pose import LIMBS
from gmrdata.read.amc import read_amc
from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import SourceMotion
from gmrdata.values.body import JOINT, JOINT_NAMES, WORLD_FROM_REST, BodyModel
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.joint_names import MIXAMO, find_joints
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_deg

SOLE_M = -1.195
"""The small body's lowest vertex in its rest frame."""


def _angles(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-60, 60, (5, 24, 3))


def _expected_rotmats(angles_deg: np.ndarray) -> np.ndarray:
    rotmats = Rotation.from_euler("ZXY", angles_deg.reshape(-1, 3), degrees=True).as_matrix()
    return rotmats.reshape(*angles_deg.shape[:2], 3, 3)


def test_a_bodys_own_skeleton_keeps_its_rotations_and_path(write_person, small_body, tmp_path):
    angles_deg, pelvis_m = _angles(1), np.random.default_rng(2).normal(size=(5, 3))
    path = write_person(tmp_path / "own.bvh", small_body, angles_deg, pelvis_m)
    motion = read_motion(path, small_body, ground=False)
    expected = _expected_rotmats(angles_deg)
    np.testing.assert_allclose(motion.local_rotmats, expected[:, 1:], atol=1e-9)
    np.testing.assert_allclose(motion.root_rotmats, WORLD_FROM_REST @ expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(motion.pelvis_m, pelvis_m @ WORLD_FROM_REST.T, atol=1e-9)
    assert motion.frame == "world" and motion.body == "small" and motion.fps_hz == 100.0
    assert motion.source.startswith("own.bvh: 100 Hz (header), 0.01 m per unit (centimetres)")


@pytest.mark.parametrize("axes", [np.eye(3), WORLD_FROM_REST, [[0, 0, -1], [0, 1, 0], [1, 0, 0]]])
@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig1_", ""])
def test_a_t_pose_stands_on_the_floor_in_whatever_axes_and_names(
    write_person, small_body, tmp_path, axes, prefix
):
    axes = np.array(axes, dtype=float)
    still = np.zeros((20, 24, 3))
    path = write_person(
        tmp_path / "t.bvh", small_body, still, np.zeros((20, 3)), prefix=prefix, axes_from_rest=axes
    )
    motion = read_motion(path, small_body, ground=True)
    identities = np.broadcast_to(np.eye(3), (20, 23, 3, 3))
    np.testing.assert_allclose(motion.local_rotmats, identities, atol=1e-12)
    np.testing.assert_allclose(
        motion.root_rotmats, np.broadcast_to(WORLD_FROM_REST, (20, 3, 3)), atol=1e-12
    )
    height_m = small_body.rest_joints_m(np.zeros(10))[0, 1] - SOLE_M
    np.testing.assert_allclose(motion.pelvis_m[:, 2], height_m, atol=2e-3)


def test_another_size_only_scales_the_path(write_person, small_body, tmp_path):
    angles_deg, pelvis_m = _angles(1), np.random.default_rng(2).normal(size=(5, 3))
    path = write_person(tmp_path / "own.bvh", small_body, angles_deg, pelvis_m)
    tall = np.eye(10)[0] * 2.5  # 10 % larger
    own, larger = (read_motion(path, small_body, shape=s, ground=False) for s in (None, tall))
    np.testing.assert_allclose(larger.local_rotmats, own.local_rotmats, atol=1e-12)
    np.testing.assert_allclose(larger.pelvis_m, own.pelvis_m * 1.1, atol=1e-12)
    np.testing.assert_array_equal(larger.shape, tall)
    assert "path x 1.1000" in larger.source


def test_a_map_of_ones_own_and_a_skeleton_with_less_joints(write_person, small_body, tmp_path):
    names = [f"bone{i}" for i in range(24)]
    joint_map = dict(zip(names, JOINT_NAMES, strict=True))
    angles_deg = _angles(3)
    path = write_person(tmp_path / "own.bvh", small_body, angles_deg, np.zeros((5, 3)), names=names)
    with pytest.raises(BadMotionFile, match=r"be pelvis.*bone0.*--joint-map; joints are pelvis"):
        read_motion(path, small_body)
    for unmapped in ("spine2", "left_collar"):
        del joint_map[f"bone{JOINT[unmapped]}"]
    yaml_file = tmp_path / "map.yaml"
    yaml_file.write_text("".join(f"{name}: {joint}\n" for name, joint in joint_map.items()))
    motion = read_motion(path, small_body, joint_map=yaml_file, ground=False)
    expected = _expected_rotmats(angles_deg)
    # A joint that is not mapped holds still, and its child takes over its turn.
    np.testing.assert_allclose(
        motion.local_rotmats[:, JOINT["spine2"] - 1], np.stack([np.eye(3)] * 5), atol=1e-9
    )
    both = expected[:, JOINT["spine2"]] @ expected[:, JOINT["spine3"]]
    np.testing.assert_allclose(motion.local_rotmats[:, JOINT["spine3"] - 1], both, atol=1e-9)


@pytest.mark.parametrize(
    ("joint_map", "words"),
    [
        ({"bone0": "hips"}, "speaks of hips; SMPL's joints are pelvis"),
        ({"nobody": "pelvis"}, "names nobody, which the file does not have. It has: a"),
        ({"a": "pelvis", "b": "pelvis"}, "names pelvis more than once"),
        ({"a": "pelvis"}, "no joint is known to be left_hip"),
    ],
)
def test_wrong_maps(joint_map, words):
    with pytest.raises(BadMotionFile, match=words):
        find_joints(["a", "b"], [-1, 0], joint_map, Path("a.bvh"))


def test_a_wrong_unit_is_told(write_person, small_body, tmp_path):
    path = write_person(
        tmp_path / "metres.bvh", small_body, np.zeros((2, 24, 3)), np.zeros((2, 3)), cm_per_unit=100
    )
    with pytest.raises(BadMotionFile, match=r"metres\.bvh: .* legs are 0\.008.* m long.*--unit-m"):
        read_motion(path, small_body, unit_m=0.01)
    assert read_motion(path, small_body, unit_m=1.0).n_frames == 2


def _limb_errors_deg(source: SourceMotion, motion: Motion, body: BodyModel) -> np.ndarray:
    """(T, 8) angle between the bones of a source (y up) and of the body (z up)."""
    joints = find_joints(source.names, source.parents, None, Path("x"))
    source_m = source.posed()[1] @ WORLD_FROM_REST.T
    body_m = motion_joints_m(body, motion)
    errors = []
    for start, end in LIMBS:
        a = source_m[:, joints[end]] - source_m[:, joints[start]]
        errors.append(angles_deg(a, body_m[:, end] - body_m[:, start]))
    return np.stack(errors, axis=1)


@pytest.mark.parametrize(
    "file", ["bvh/02_03.bvh", "amc/05_01.amc", "bvh/16_32.bvh", "amc/14_06.amc"]
)
def test_limbs_point_as_the_subjects_do(cmu_dir, small_body, file):
    path = cmu_dir / file
    source = read_bvh(path) if path.suffix == ".bvh" else read_amc(path)
    motion = read_motion(path, small_body, ground=False)
    errors_deg = _limb_errors_deg(source, motion, small_body)
    # Elbow to wrist: CMU's wrist bone only rolls, but its direction is rounded in the files.
    assert errors_deg.max() < 0.05


def test_palms_arms_and_head_of_a_quiet_stander(cmu_dir, small_body):
    motion = read_motion(cmu_dir / "bvh" / "16_32.bvh", small_body)  # walks off after 0.5 s
    joints_m = motion_joints_m(small_body, motion)[:60]
    front = motion.root_rotmats[0] @ [0, 0, 1]
    assert front[2] == pytest.approx(0, abs=0.2)
    assert ((joints_m[:, JOINT["head"]] - joints_m[:, JOINT["pelvis"]])[:, 2] > 0.5).all()
    # The left hip lies to the left of the right one, seen along the front.
    left = np.cross([0, 0, 1], front)
    assert ((joints_m[:, JOINT["left_hip"]] - joints_m[:, JOINT["right_hip"]]) @ left > 0.1).all()
    # Hands hang below the elbows, and the head is level within 15 degrees.
    for side in ("left", "right"):
        hand, elbow = joints_m[:, JOINT[f"{side}_hand"]], joints_m[:, JOINT[f"{side}_elbow"]]
        assert (hand[:, 2] < elbow[:, 2] - 0.1).all()
    rotmats = np.concatenate([motion.root_rotmats[:60, None], motion.local_rotmats[:60]], axis=1)
    head_up = rotmats[:, 0]
    for joint in ("spine1", "spine2", "spine3", "neck", "head"):
        head_up = head_up @ rotmats[:, JOINT[joint]]
    tilt_deg = np.rad2deg(np.arccos(head_up[:, 2, 1]))
    assert np.median(tilt_deg) < 15


def test_the_map_names_each_joint_of_the_tree():
    assert sorted(MIXAMO.values()) == sorted(JOINT_NAMES)
