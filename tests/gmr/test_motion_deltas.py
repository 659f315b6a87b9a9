"""Motion between frames: eqs. 2-4 in both kinds of arrays."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values import transforms
from gmrdata.values.motion import accumulate, deltas

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


def test_deltas_by_hand() -> None:
    """A quarter turn to the left, then a step of 1 m along the body's own new front."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    root_rotmats = np.stack([np.eye(3), turn, turn])
    pelvis_m = np.array([[5.0, 0.0, 1.0], [5.0, 0.0, 1.0], [5.0, 1.0, 1.0]])
    delta_rotmats, delta_m = deltas(root_rotmats, pelvis_m)
    np.testing.assert_array_equal(delta_rotmats, [turn, np.eye(3)])
    np.testing.assert_array_equal(delta_m, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


@given(poses)
def test_it_is_eq_2_as_4x4_matrices(pose: tuple[np.ndarray, np.ndarray]) -> None:
    world_from_root = transforms.rigid(*pose)
    product = world_from_root[:-1] @ transforms.rigid(*deltas(*pose))
    np.testing.assert_allclose(product, world_from_root[1:], atol=1e-12)


@given(poses)
def test_the_pelvis_and_smpls_trans_have_the_same_motions(
    pose: tuple[np.ndarray, np.ndarray],
) -> None:
    """T of eq. 1 is SMPL's `trans`, which the pelvis differs from by J0: the same in all frames."""
    root_rotmats, pelvis_m = pose
    rest_pelvis_m = np.array([0.002, -0.22, 0.03])
    of_trans = deltas(root_rotmats, pelvis_m - rest_pelvis_m)
    np.testing.assert_allclose(of_trans[1], deltas(root_rotmats, pelvis_m)[1], atol=1e-12)


@given(poses)
def test_accumulating_from_the_first_pose_gives_the_poses_back(
    pose: tuple[np.ndarray, np.ndarray],
) -> None:
    root_rotmats, pelvis_m = pose
    again = accumulate(*deltas(root_rotmats, pelvis_m), root_rotmats[0], pelvis_m[0])
    np.testing.assert_allclose(again[0], root_rotmats, atol=1e-11)
    np.testing.assert_allclose(again[1], pelvis_m, atol=1e-10)


@given(poses)
def test_accumulating_from_the_identity_gives_the_poses_up_to_the_first(
    pose: tuple[np.ndarray, np.ndarray],
) -> None:
    first_from_world = transforms.invert(transforms.rigid(pose[0][0], pose[1][0]))
    expected = first_from_world @ transforms.rigid(*pose)
    found = transforms.rigid(*accumulate(*deltas(*pose), np.eye(3), np.zeros(3)))
    np.testing.assert_allclose(found, expected, atol=1e-10)


@given(poses, world_changes)
def test_deltas_do_not_depend_on_the_world(
    pose: tuple[np.ndarray, np.ndarray], change: tuple[np.ndarray, np.ndarray]
) -> None:
    other_from_world = transforms.rigid(*change)
    other = other_from_world @ transforms.rigid(*pose)
    for found, expected in zip(
        deltas(other[:, :3, :3], other[:, :3, 3]), deltas(*pose), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-11)


@settings(max_examples=20)
@given(poses)
def test_torch_and_numpy_agree_in_batches(pose: tuple[np.ndarray, np.ndarray]) -> None:
    root_rotmats, pelvis_m = (torch.as_tensor(np.stack([part, part[::-1]])) for part in pose)
    found = deltas(root_rotmats, pelvis_m)
    for row, order in enumerate((slice(None), slice(None, None, -1))):
        expected = deltas(pose[0][order], pose[1][order])
        np.testing.assert_allclose(found[0][row].numpy(), expected[0], atol=1e-13)
        np.testing.assert_allclose(found[1][row].numpy(), expected[1], atol=1e-13)
    again = accumulate(*found, root_rotmats[:, 0], pelvis_m[:, 0])
    torch.testing.assert_close(again[0], root_rotmats, atol=1e-11, rtol=0)
    torch.testing.assert_close(again[1], pelvis_m, atol=1e-10, rtol=0)
