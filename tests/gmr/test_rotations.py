"""Rotations and motions between frames (eqs. 2-4), against scipy, in both kinds of arrays."""

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation
from gmrdata.values import transforms
from gmrdata.values.motion import accumulate, deltas

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")
axes = st.integers(0, 2**31 - 1).map(
    lambda seed: Rotation.random(random_state=seed).as_matrix()[:, 0]
)
angles_rad = st.one_of(
    st.sampled_from([0.0, 1e-9, 1e-7, 1e-5, np.pi / 2, np.pi - 1e-7, np.pi]), st.floats(0, np.pi)
)
rotvecs = st.builds(lambda axis, angle_rad: axis * angle_rad, axes, angles_rad)


@given(st.sampled_from(REPRESENTATIONS), rotvecs)
def test_every_representation_gives_the_rotation_back(representation, rotvec):
    rotmat = torch.as_tensor(Rotation.from_rotvec(rotvec).as_matrix())
    values = rotations.from_rotmats(rotmat, representation)
    assert values.shape == (rotations.SIZE[representation],)
    again = rotations.to_rotmats(values, representation)
    torch.testing.assert_close(
        again, rotmat, atol=3e-7 if "axis" in representation else 1e-12, rtol=0
    )


@given(rotvecs)
def test_values_are_scipys(rotvec):
    rotation = Rotation.from_rotvec(rotvec)
    rotmat = torch.as_tensor(rotation.as_matrix())
    x, y, z, w = rotation.as_quat(canonical=True)
    quaternion = rotations.from_rotmats(rotmat, "quaternion").numpy()
    assert abs(abs(quaternion @ [w, x, y, z]) - 1) < 1e-12
    assert quaternion[0] >= 0
    length_rad = np.linalg.norm(rotations.log_map(rotmat).numpy())
    assert length_rad == pytest.approx(rotation.magnitude(), abs=2e-8)
    np.testing.assert_array_equal(
        rotations.from_rotmats(rotmat, "6d"), np.concatenate([rotmat[:, 0], rotmat[:, 1]])
    )


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_the_identity(representation):
    values = torch.tensor(rotations.IDENTITY[representation])
    assert torch.equal(rotations.to_rotmats(values, representation), torch.eye(3))
    assert torch.equal(rotations.from_rotmats(torch.eye(3), representation), values)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_any_output_of_a_network_is_a_rotation_with_finite_gradients(representation):
    size = rotations.SIZE[representation]
    generator = torch.Generator().manual_seed(1)
    values = 4 * torch.randn(500, size, generator=generator, dtype=torch.float64)
    values[0] = torch.tensor(rotations.IDENTITY[representation])
    values.requires_grad_()
    rotmats = rotations.to_rotmats(values, representation)
    eye = torch.eye(3, dtype=torch.float64).expand(500, 3, 3)
    torch.testing.assert_close(rotmats @ rotmats.transpose(-1, -2), eye, atol=1e-9, rtol=0)
    torch.testing.assert_close(torch.linalg.det(rotmats), torch.ones(500).double())
    (rotmats * torch.arange(9.0).reshape(3, 3)).sum().backward()
    assert values.grad is not None
    assert torch.isfinite(values.grad).all()


def test_quaternions_do_not_jump_when_a_joint_passes_180_degrees():
    """A joint that turns once around: w falls through 0, and with w >= 0 forced it would jump."""
    turn_rad = np.linspace(0, 2 * np.pi, 50)
    rotmats = Rotation.from_rotvec(turn_rad[:, None] * [0, 0, 1.0]).as_matrix()
    canonical = rotations.from_rotmats(torch.as_tensor(rotmats)[:, None], "quaternion")
    assert (canonical[1:] - canonical[:-1]).norm(dim=-1).max() > 1.9
    smooth = rotations.continuous_in_time(canonical)
    expected = np.stack(
        [np.cos(turn_rad / 2), 0 * turn_rad, 0 * turn_rad, np.sin(turn_rad / 2)], axis=-1
    )
    np.testing.assert_allclose(smooth[:, 0].numpy(), expected, atol=1e-12)


@given(st.integers(0, 2**31 - 1))
def test_signs_in_time_are_per_joint_and_the_same_whatever_came_in(seed):
    rng = np.random.default_rng(seed)
    steps = Rotation.from_rotvec(rng.normal(0, 0.4, (20 * 3, 3)))
    rotmats = np.tile(np.eye(3), (20, 3, 1, 1))
    for joint in range(3):
        rotation = Rotation.random(random_state=seed + joint)
        for frame in range(20):
            rotation = rotation * steps[frame * 3 + joint]
            rotmats[frame, joint] = rotation.as_matrix()
    quaternions = rotations.from_rotmats(torch.as_tensor(rotmats), "quaternion")
    smooth = rotations.continuous_in_time(quaternions)
    assert ((smooth[1:] * smooth[:-1]).sum(-1) > 0).all()
    assert (smooth[0, :, 0] >= 0).all()
    signs = torch.as_tensor(rng.choice([-1.0, 1.0], (20, 3, 1)))
    torch.testing.assert_close(rotations.continuous_in_time(quaternions * signs), smooth)


poses = st.builds(
    lambda seed, n: (
        Rotation.random(n, random_state=seed).as_matrix(),
        np.random.default_rng(seed).normal(0, 3, (n, 3)),
    ),
    st.integers(0, 2**31 - 1),
    st.integers(2, 40),
)
world_changes = st.builds(
    lambda seed: (
        Rotation.random(random_state=seed).as_matrix(),
        np.random.default_rng(seed).normal(0, 10, 3),
    ),
    st.integers(0, 2**31 - 1),
)


def test_deltas_by_hand():
    """A quarter turn to the left, then a step of 1 m along the body's own new front."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    root_rotmats = np.stack([np.eye(3), turn, turn])
    pelvis_m = np.array([[5.0, 0.0, 1.0], [5.0, 0.0, 1.0], [5.0, 1.0, 1.0]])
    delta_rotmats, delta_m = deltas(root_rotmats, pelvis_m)
    np.testing.assert_array_equal(delta_rotmats, [turn, np.eye(3)])
    np.testing.assert_array_equal(delta_m, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


@given(poses)
def test_it_is_eq_2_as_4x4_matrices(pose):
    world_from_root = transforms.rigid(*pose)
    product = world_from_root[:-1] @ transforms.rigid(*deltas(*pose))
    np.testing.assert_allclose(product, world_from_root[1:], atol=1e-12)


@given(poses)
def test_the_pelvis_and_smpls_trans_have_the_same_motions(pose):
    """T of eq. 1 is SMPL's `trans`, which the pelvis differs from by J0: the same in all frames."""
    root_rotmats, pelvis_m = pose
    rest_pelvis_m = np.array([0.002, -0.22, 0.03])
    of_trans = deltas(root_rotmats, pelvis_m - rest_pelvis_m)
    np.testing.assert_allclose(of_trans[1], deltas(root_rotmats, pelvis_m)[1], atol=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_quaternions_are_those_of_roma_bit_for_bit(dtype):
    """Random ones, small ones, and half turns, where two of the four factors are zero."""
    rotvecs = np.random.default_rng(0).normal(0, 1e-3, (500, 3))
    halves = np.pi * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [0, -0.6, 0.8]])
    turns = (Rotation.random(500, random_state=1), *map(Rotation.from_rotvec, (rotvecs, halves)))
    rotmats = torch.from_numpy(np.concatenate([turn.as_matrix() for turn in turns])).to(dtype)
    x, y, z, w = roma.rotmat_to_unitquat(rotmats).unbind(-1)
    wanted = torch.stack([w, x, y, z], dim=-1)
    found = rotations.from_rotmats(rotmats, "quaternion")
    assert torch.equal(found, torch.where(wanted[:, :1] < 0, -wanted, wanted))
    assert torch.equal(rotations.log_map(rotmats), roma.rotmat_to_rotvec(rotmats))


@given(poses)
def test_accumulating_from_the_first_pose_gives_the_poses_back(pose):
    root_rotmats, pelvis_m = pose
    again = accumulate(*deltas(root_rotmats, pelvis_m), root_rotmats[0], pelvis_m[0])
    np.testing.assert_allclose(again[0], root_rotmats, atol=1e-11)
    np.testing.assert_allclose(again[1], pelvis_m, atol=1e-10)


@given(poses)
def test_accumulating_from_the_identity_gives_the_poses_up_to_the_first(pose):
    first_from_world = transforms.invert(transforms.rigid(pose[0][0], pose[1][0]))
    expected = first_from_world @ transforms.rigid(*pose)
    found = transforms.rigid(*accumulate(*deltas(*pose), np.eye(3), np.zeros(3)))
    np.testing.assert_allclose(found, expected, atol=1e-10)


@given(poses, world_changes)
def test_deltas_do_not_depend_on_the_world(pose, change):
    other_from_world = transforms.rigid(*change)
    other = other_from_world @ transforms.rigid(*pose)
    for found, expected in zip(
        deltas(other[:, :3, :3], other[:, :3, 3]), deltas(*pose), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-11)


@settings(max_examples=20)
@given(poses)
def test_torch_and_numpy_agree_in_batches(pose):
    root_rotmats, pelvis_m = (torch.as_tensor(np.stack([part, part[::-1]])) for part in pose)
    found = deltas(root_rotmats, pelvis_m)
    for row, order in enumerate((slice(None), slice(None, None, -1))):
        expected = deltas(pose[0][order], pose[1][order])
        np.testing.assert_allclose(found[0][row].numpy(), expected[0], atol=1e-13)
        np.testing.assert_allclose(found[1][row].numpy(), expected[1], atol=1e-13)
    again = accumulate(*found, root_rotmats[:, 0], pelvis_m[:, 0])
    torch.testing.assert_close(again[0], root_rotmats, atol=1e-11, rtol=0)
    torch.testing.assert_close(again[1], pelvis_m, atol=1e-10, rtol=0)
