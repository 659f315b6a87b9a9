"""The forward pass that every body shares."""

import dataclasses
import gc
import weakref

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from gmrdata.values import skinning as skin
from gmrdata.values.body import JOINT, MIRRORED, PARENTS, BodyModel
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.values.skinning_torch import place, posed_vertices
from tests.motions import random_motion
from tests.torch_joints import posed_joints

seeds = st.integers(0, 2**32 - 1)
FLIP = np.array([-1.0, 1.0, 1.0])


def random_rotmats(rng: np.random.Generator, *batch: int) -> np.ndarray:
    quaternions = rng.normal(size=(*batch, 4))
    return Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix().reshape(*batch, 3, 3)


def random_pose(rng: np.random.Generator, *batch: int) -> tuple[Tensor, Tensor]:
    return torch.as_tensor(rng.normal(size=(*batch, 10))), torch.as_tensor(
        random_rotmats(rng, *batch, 23)
    )


def with_pose_dirs(body: BodyModel, rng: np.random.Generator) -> BodyModel:
    return dataclasses.replace(
        body, pose_dirs_m=0.01 * rng.normal(size=(len(body.template_m), 3, 207))
    )


def test_identity_pose_gives_the_template_from_the_pelvis(small_body):
    shape, local = torch.zeros(10).double(), torch.eye(3).double().expand(23, 3, 3)
    vertices_m = posed_vertices(small_body, shape, local).numpy()
    joints_m, rotations = posed_joints(small_body, shape, local)
    pelvis_m = small_body.joints_template_m[0]
    np.testing.assert_allclose(vertices_m, small_body.template_m - pelvis_m, atol=1e-14)
    np.testing.assert_allclose(joints_m, small_body.joints_template_m - pelvis_m, atol=1e-14)
    assert torch.equal(rotations, torch.eye(3).double().expand(24, 3, 3))


@settings(max_examples=20)
@given(seed=seeds)
def test_joints_are_vertices_of_a_body_skinned_to_one_joint_each(seed, small_body):
    skeleton = dataclasses.replace(
        small_body,
        template_m=small_body.joints_template_m,
        shape_dirs_m=small_body.joint_shape_dirs_m,
        skin_weights=np.eye(24),
    )
    shape, local = random_pose(np.random.default_rng(seed), 2)
    joints_m, _ = posed_joints(skeleton, shape, local)
    torch.testing.assert_close(posed_vertices(skeleton, shape, local), joints_m, atol=1e-12, rtol=0)
    assert torch.equal(joints_m[:, 0], torch.zeros(2, 3).double())


@settings(max_examples=20)
@given(seed=seeds)
def test_bones_keep_their_length_and_rotations_chain(seed, small_body):
    shape, local = random_pose(np.random.default_rng(seed))
    joints_m, rotations = posed_joints(small_body, shape, local)
    rest_m = small_body.rest_joints_m(shape.numpy())
    for joint in range(1, 24):
        parent = PARENTS[joint]
        bone_m = np.linalg.norm(rest_m[joint] - rest_m[parent])
        assert np.linalg.norm(joints_m[joint] - joints_m[parent]) == pytest.approx(bone_m)
        torch.testing.assert_close(rotations[joint], rotations[parent] @ local[joint - 1])


def test_a_raised_left_arm_moves_the_left_arm_only(small_body):
    local = torch.eye(3).double().repeat(23, 1, 1)
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    local[JOINT["left_shoulder"] - 1] = torch.as_tensor(quarter)
    joints_m, _ = posed_joints(small_body, torch.zeros(10), local)
    rest_m = small_body.joints_template_m - small_body.joints_template_m[0]
    arm = [JOINT[f"left_{name}"] for name in ("elbow", "wrist", "hand")]
    shoulder_m = rest_m[JOINT["left_shoulder"]]
    expected_m = rest_m.copy()
    expected_m[arm] = shoulder_m + (rest_m[arm] - shoulder_m) @ quarter.T
    np.testing.assert_allclose(joints_m, expected_m, atol=1e-12)
    assert joints_m[arm[2], 1] > joints_m[JOINT["head"], 1]


@settings(max_examples=20)
@given(seed=seeds)
def test_mirrored_pose_gives_the_mirrored_body(seed, small_body):
    """About the body's own middle plane, which need not pass through the rest frame's origin."""
    _, local = random_pose(np.random.default_rng(seed))
    flip = torch.as_tensor(np.diag(FLIP))
    mirrored = flip @ local[[joint - 1 for joint in MIRRORED[1:]]] @ flip
    joints_m, _ = posed_joints(small_body, torch.zeros(10), local)
    mirrored_m, _ = posed_joints(small_body, torch.zeros(10), mirrored)
    np.testing.assert_allclose(mirrored_m, (joints_m.numpy() * FLIP)[list(MIRRORED)], atol=1e-12)
    vertices_m = posed_vertices(small_body, torch.zeros(10), local).numpy()
    mirrored_vertices_m = posed_vertices(small_body, torch.zeros(10), mirrored).numpy()
    # The boxes' corners come in another order, so the clouds are compared by their centre.
    np.testing.assert_allclose(
        mirrored_vertices_m.mean(axis=0), vertices_m.mean(axis=0) * FLIP, atol=1e-12
    )


@settings(max_examples=20)
@given(seed=seeds)
def test_placing_is_rigid_and_puts_the_pelvis_where_it_is_told(seed, small_body):
    rng = np.random.default_rng(seed)
    shape, local = random_pose(rng, 3)
    root, pelvis_m = (
        torch.as_tensor(random_rotmats(rng, 3)),
        torch.as_tensor(rng.normal(size=(3, 3))),
    )
    joints_m, _ = posed_joints(small_body, shape, local)
    placed_m = place(root, pelvis_m, joints_m)
    torch.testing.assert_close(placed_m[:, 0], pelvis_m)
    torch.testing.assert_close(
        torch.cdist(placed_m, placed_m), torch.cdist(joints_m, joints_m), atol=1e-6, rtol=0
    )
    # Turning and shifting the frame of reference does the same to the result.
    turn, shift_m = torch.as_tensor(random_rotmats(rng)), torch.as_tensor(rng.normal(size=3))
    again_m = place(turn @ root, pelvis_m @ turn.T + shift_m, joints_m)
    torch.testing.assert_close(again_m, placed_m @ turn.T + shift_m)


def test_pose_blend_shapes_add_before_skinning(small_body):
    """One entry of one rotation, read off its direction (Loper et al. 2015, eq. 9)."""
    body = with_pose_dirs(small_body, np.random.default_rng(1))
    assert body.pose_dirs_m is not None
    knee = JOINT["left_knee"]
    local = torch.eye(3).double().repeat(23, 1, 1)
    # Not a rotation on purpose: a single entry, which shows the order of the 207 directions.
    local[knee - 1, 0, 2] = 1.0
    above = np.flatnonzero(small_body.skin_weights[:, JOINT["head"]] == 1.0)
    moved_m = posed_vertices(body, torch.zeros(10), local) - posed_vertices(
        small_body, torch.zeros(10), local
    )
    np.testing.assert_allclose(
        moved_m[above], body.pose_dirs_m[above, :, 9 * (knee - 1) + 2], atol=1e-12
    )


@pytest.mark.parametrize("posed", [False, True])
def test_float32_agrees_with_float64(small_body, posed):
    rng = np.random.default_rng(3)
    body = with_pose_dirs(small_body, rng) if posed else small_body
    shape, local = random_pose(rng, 4)
    exact_m = posed_vertices(body, shape, local)
    single_m = posed_vertices(body, shape.float(), local.float())
    assert (exact_m.dtype, single_m.dtype) == (torch.float64, torch.float32)
    torch.testing.assert_close(single_m.double(), exact_m, atol=3e-6, rtol=0)


def test_batches_broadcast_and_agree_with_single_poses(small_body):
    shape, local = random_pose(np.random.default_rng(4), 2, 3)
    together_m = posed_vertices(small_body, shape[:, :1], local)
    assert together_m.shape == (2, 3, len(small_body.template_m), 3)
    for i, j in np.ndindex(2, 3):
        alone_m = posed_vertices(small_body, shape[i, 0], local[i, j])
        torch.testing.assert_close(together_m[i, j], alone_m, atol=1e-12, rtol=0)
    joints_m, rotations = posed_joints(small_body, shape, local[0, 0])
    assert joints_m.shape == (2, 3, 24, 3)
    assert rotations.shape == (2, 3, 24, 3, 3)


def test_gradients_are_those_of_finite_differences(small_body):
    rng = np.random.default_rng(5)
    few = rng.choice(len(small_body.template_m), 5, replace=False)
    body = dataclasses.replace(
        with_pose_dirs(small_body, rng),
        template_m=small_body.template_m[few],
        shape_dirs_m=small_body.shape_dirs_m[few],
        skin_weights=small_body.skin_weights[few],
        pose_dirs_m=0.01 * rng.normal(size=(5, 3, 207)),
    )
    shape, local = random_pose(rng)
    assert torch.autograd.gradcheck(
        lambda s, r: posed_vertices(body, s, r), (shape.requires_grad_(), local.requires_grad_())
    )


def test_motions_are_placed_frame_by_frame(small_body, monkeypatch):
    motion = random_motion(np.random.default_rng(6), 7)
    monkeypatch.setattr(skin, "CHUNK_BYTES", 3 * len(small_body.template_m) * 48)
    joints_m = motion_joints_m(small_body, motion)
    vertices_m = motion_vertices_m(small_body, motion)
    assert joints_m.shape == (7, 24, 3)
    assert vertices_m.shape == (7, len(small_body.template_m), 3)
    assert (joints_m.dtype, vertices_m.dtype) == (np.float64, np.float32)
    np.testing.assert_allclose(joints_m[:, 0], motion.pelvis_m, atol=1e-12)
    shape = torch.as_tensor(motion.shape)
    for t in range(7):
        alone_m = posed_vertices(small_body, shape, torch.as_tensor(motion.local_rotmats[t]))
        placed_m = alone_m.numpy() @ motion.root_rotmats[t].T + motion.pelvis_m[t]
        np.testing.assert_allclose(vertices_m[t], placed_m, atol=3e-6)
    some_m = motion_vertices_m(small_body, motion, np.array([5, 1]))
    np.testing.assert_allclose(some_m, vertices_m[[5, 1]], atol=1e-6)
    assert motion_vertices_m(small_body, motion, slice(2, 4)).shape[0] == 2
    assert motion_vertices_m(small_body, motion, np.zeros(7, dtype=bool)).shape[0] == 0


def test_numpy_bends_a_body_with_the_pose_as_torch_does(small_body):
    rng = np.random.default_rng(8)
    bends_m = 0.01 * rng.normal(size=(len(small_body.template_m), 3, 207))
    body = dataclasses.replace(small_body, pose_dirs_m=bends_m)
    motion = random_motion(rng, 3)
    shape, local = torch.as_tensor(motion.shape), torch.as_tensor(motion.local_rotmats)
    root, pelvis_m = torch.as_tensor(motion.root_rotmats), torch.as_tensor(motion.pelvis_m)
    expected_m = place(root, pelvis_m, posed_vertices(body, shape, local))
    np.testing.assert_allclose(motion_vertices_m(body, motion), expected_m, atol=3e-6)
    expected_m = place(root, pelvis_m, posed_joints(body, shape, local)[0])
    np.testing.assert_allclose(motion_joints_m(body, motion), expected_m, atol=1e-12)


def test_wrong_sizes_are_named(small_body):
    with pytest.raises(ValueError, match="body small has 10 shape coefficients"):
        posed_joints(small_body, torch.zeros(16), torch.eye(3).expand(23, 3, 3))
    with pytest.raises(ValueError, match=r"a pose is \(\.\.\., 23, 3, 3\) rotations"):
        posed_vertices(small_body, torch.zeros(10), torch.eye(3).expand(24, 3, 3))


def test_a_body_is_not_kept_alive_by_its_tensors(small_body):
    body = dataclasses.replace(small_body, name="short-lived")
    posed_joints(body, torch.zeros(10), torch.eye(3).expand(23, 3, 3))
    gone = weakref.ref(body)
    del body
    gc.collect()
    assert gone() is None
