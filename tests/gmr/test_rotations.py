"""Representations of rotations, against scipy."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")
axes = st.integers(0, 2**31 - 1).map(
    lambda seed: Rotation.random(random_state=seed).as_matrix()[:, 0]
)
angles_rad = st.one_of(
    st.sampled_from([0.0, 1e-9, 1e-7, 1e-5, np.pi / 2, np.pi - 1e-7, np.pi]), st.floats(0, np.pi)
)
rotvecs = st.builds(lambda axis, angle_rad: axis * angle_rad, axes, angles_rad)


@given(st.sampled_from(REPRESENTATIONS), rotvecs)
def test_every_representation_gives_the_rotation_back(
    representation: Representation, rotvec: np.ndarray
) -> None:
    rotmat = torch.as_tensor(Rotation.from_rotvec(rotvec).as_matrix())
    values = rotations.from_rotmats(rotmat, representation)
    assert values.shape == (rotations.SIZE[representation],)
    again = rotations.to_rotmats(values, representation)
    torch.testing.assert_close(
        again, rotmat, atol=3e-7 if "axis" in representation else 1e-12, rtol=0
    )


@given(rotvecs)
def test_values_are_scipys(rotvec: np.ndarray) -> None:
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
def test_the_identity(representation: Representation) -> None:
    values = torch.tensor(rotations.IDENTITY[representation])
    assert torch.equal(rotations.to_rotmats(values, representation), torch.eye(3))
    assert torch.equal(rotations.from_rotmats(torch.eye(3), representation), values)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_any_output_of_a_network_is_a_rotation_with_finite_gradients(
    representation: Representation,
) -> None:
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


def test_quaternions_do_not_jump_when_a_joint_passes_180_degrees() -> None:
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
def test_signs_in_time_are_per_joint_and_the_same_whatever_came_in(seed: int) -> None:
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
