"""The rotations, size and place of a character's skeleton, on arrays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from blender.people.rigged_pose import (
    HIPS,
    RestPose,
    bone_rotations,
    check_rest,
    hips_m,
    joint_turns,
    of_feet,
    size_of,
)
from gmrdata.motion.rest_pose import LIMBS, joints_of
from gmrdata.values.body import JOINT, PARENTS, BodyModel
from gmrdata.values.errors import BadCharacter
from gmrdata.values.skinning import global_rotmats, motion_joints_m
from tests.motions import random_motion

N_FRAMES = 4
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
MOST_RAD = {"hip": 0.2, "knee": 0.2, "shoulder": 0.9, "elbow": 0.9}


def random_rest(body: BodyModel, seed: int, unit: float, file_from_rest: np.ndarray) -> RestPose:
    """The body with limbs of other lengths and directions, in a file's axes and unit."""
    rng = np.random.default_rng(seed)
    rest_m, joints = body.joints_template_m, np.zeros((24, 3))
    for joint in range(1, 24):
        parent = PARENTS[joint]
        bone = rng.uniform(0.8, 1.2) * (rest_m[joint] - rest_m[parent])
        if (parent, joint) in LIMBS:
            name = next(part for part in MOST_RAD if parent in _sides(part))
            axis = rng.normal(size=3)
            turn = MOST_RAD[name] * rng.uniform() * axis / np.linalg.norm(axis)
            bone = Rotation.from_rotvec(turn).apply(bone)
        joints[joint] = joints[parent] + bone
    feet = joints[[JOINT["left_ankle"], JOINT["right_ankle"]]] - [0.0, 0.1, 0.0]
    unknown = np.full((2, 3), np.nan)
    return RestPose(
        unit * joints @ file_from_rest.T + 3.0, unknown, unit * feet @ file_from_rest.T + 3.0
    )


def _sides(part: str) -> tuple[int, int]:
    return JOINT[f"left_{part}"], JOINT[f"right_{part}"]


AXES = st.sampled_from([np.eye(3), Z_UP, Z_UP @ np.diag([-1.0, 1.0, -1.0]), Z_UP[[1, 2, 0]]])


@given(st.integers(0, 10_000), AXES, st.sampled_from([1.0, 100.0]))
def test_limbs_point_where_the_bodys_do(small_body, seed, axes, unit):
    motion = random_motion(np.random.default_rng(seed), N_FRAMES, 0.7, shape=np.zeros(10))
    rest = random_rest(small_body, seed, unit, axes)
    found = check_rest(rest, False, "someone.glb")
    np.testing.assert_allclose(found, axes, atol=1e-12)
    turns = joint_turns(rest, found, small_body, motion)
    np.testing.assert_allclose(
        turns @ turns.swapaxes(-1, -2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-9
    )
    true_m = motion_joints_m(small_body, motion)
    for start, end in LIMBS:
        mine = turns[:, start] @ (rest.joints[end] - rest.joints[start])
        bodys_m = true_m[:, end] - true_m[:, start]
        cross = np.cross(mine, bodys_m) / unit
        assert np.abs(cross).max() < 1e-9 and ((mine * bodys_m).sum(axis=1) > 0).all()


@given(st.integers(0, 10_000))
def test_pose_bones_add_up_to_the_turns(seed):
    """With a bone for each joint, one more in each forearm, and a scaled, turned armature."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(N_FRAMES * 24, random_state=seed).as_matrix()
    turns = turns.reshape(N_FRAMES, 24, 3, 3)
    joints = [*range(24), JOINT["left_elbow"]]
    parents = [*PARENTS, JOINT["left_elbow"]]
    armature_from_bone = np.tile(np.eye(4), (25, 1, 1))
    armature_from_bone[:, :3, :3] = Rotation.random(25, random_state=seed + 1).as_matrix()
    armature_from_bone[:, :3, 3] = rng.normal(size=(25, 3))
    world_from_armature = np.eye(4)
    axes = Rotation.random(random_state=seed + 2).as_matrix()
    world_from_armature[:3, :3] = 0.01 * axes
    rotations = bone_rotations(turns, joints, parents, armature_from_bone, world_from_armature)
    assert 24 not in rotations  # it moves with its parent
    rest = armature_from_bone[:, :3, :3]
    local = np.empty((N_FRAMES, 25, 3, 3))
    for bone, parent in enumerate(parents):
        basis = np.eye(3)
        if bone in rotations:
            basis = Rotation.from_quat(rotations[bone], scalar_first=True).as_matrix()
        from_parent = rest[bone] if parent < 0 else rest[parent].T @ rest[bone]
        local[:, bone] = from_parent @ basis  # as Blender composes a pose
    posed = axes @ global_rotmats(parents, local)
    expected = turns[:, joints] @ (axes @ rest)
    np.testing.assert_allclose(posed, expected, atol=1e-9)


def test_sizes(small_body):
    rest_m = small_body.joints_template_m
    body_feet_m = small_body.template_m[of_feet(small_body.skin_weights)]
    unknown = np.full((2, 3), np.nan)
    thick = body_feet_m - [0.0, 0.03, 0.0]  # soles 3 cm thicker
    large = RestPose(200 * rest_m, unknown, 200 * thick)
    shape = np.zeros(small_body.n_shape)
    size = size_of(large, np.eye(3), small_body, shape, keep_size=False)
    assert size.scale == pytest.approx(1 / 200) and size.leg_ratio == pytest.approx(1)
    assert size.ankle_m - size.body_ankle_m == pytest.approx(0.03)
    motion = random_motion(np.random.default_rng(1), N_FRAMES, shape=shape)
    joints_m = motion_joints_m(small_body, motion)
    middle_m = joints_m[:, HIPS].mean(axis=1)
    np.testing.assert_allclose(
        hips_m(size, joints_m), middle_m + np.array([0, 0, 0.03]), atol=1e-12
    )
    child = RestPose(0.5 * rest_m, unknown, 0.5 * body_feet_m)
    kept = size_of(child, np.eye(3), small_body, shape, keep_size=True)
    assert kept.scale == 1.0 and kept.leg_ratio == pytest.approx(0.5)
    np.testing.assert_allclose(hips_m(kept, joints_m), middle_m * [1, 1, 0.5], atol=1e-12)


def test_what_is_no_standing_person_of_human_size_is_refused(small_body):
    rest = random_rest(small_body, 0, 100.0, Z_UP)
    with pytest.raises(BadCharacter, match=r"a\.glb: its legs are .* m long.*scale: legs"):
        check_rest(rest, True, "a.glb")
    leaning = Rotation.from_euler("x", 50, degrees=True).apply(rest.joints)
    with pytest.raises(BadCharacter, match=r"a\.glb: at rest it is not a person standing"):
        check_rest(replace(rest, joints=leaning), False, "a.glb")
    stump = np.array(rest.joints)
    stump[JOINT["left_wrist"]] = stump[JOINT["left_elbow"]]
    with pytest.raises(BadCharacter, match=r"bones of left_elbow and left_wrist start at the same"):
        check_rest(replace(rest, joints=stump), False, "a.glb")


def test_joints_without_a_bone_are_unknown():
    heads = np.arange(12.0).reshape(2, 2, 3)
    joints = joints_of(heads, {JOINT["pelvis"]: 1, JOINT["head"]: 0})
    np.testing.assert_array_equal(joints[:, JOINT["pelvis"]], heads[:, 1])
    np.testing.assert_array_equal(joints[:, JOINT["head"]], heads[:, 0])
    assert np.isnan(joints).sum() == 2 * 22 * 3
