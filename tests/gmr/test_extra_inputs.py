"""What the network is given beside local rotations, against forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import (
    REST_JOINTS_M,
    SCALE,
    Gmr,
    input_columns,
    input_size,
    motions_if_standing,
    network_input,
    velocities,
)
from gmrdata.values.body import JOINT_NAMES, BodyModel
from gmrdata.values.motion import deltas
from tests.torch_joints import posed_joints


def random_poses(*sizes: int) -> torch.Tensor:
    """Joints turned by up to about 60 degrees."""
    rng = np.random.default_rng(5)
    rotvecs_rad = rng.normal(scale=0.35, size=(*sizes, 23, 3))
    rotmats = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3)).as_matrix()
    return torch.from_numpy(rotmats.reshape(*sizes, 23, 3, 3))


def as_rotmats(rotvecs_rad: torch.Tensor) -> np.ndarray:
    matrices = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3).numpy()).as_matrix()
    return matrices.reshape(*rotvecs_rad.shape, 3)


def test_velocities_lead_from_each_pose_to_the_next() -> None:
    poses = random_poses(2, 7)
    turns = as_rotmats(velocities(poses) / SCALE)
    np.testing.assert_allclose(poses[:, :-1].numpy() @ turns[:, :-1], poses[:, 1:], atol=1e-9)
    assert velocities(poses)[:, -1].abs().max() == 0


def test_a_joint_that_stands_still_shows_the_roots_motion(small_body: BodyModel) -> None:
    """The root is placed, by the body's forward kinematics, so that one joint does not move."""
    body = replace(small_body, joints_template_m=np.add(REST_JOINTS_M, (0.1, 0.2, 0.3)))
    poses = random_poses(6)
    found = motions_if_standing(poses) / SCALE
    joints_m, root_from_joint = posed_joints(body, torch.zeros(10), poses)
    for joint in range(1, 24):
        root_rotmats = root_from_joint[:, joint].mT
        pelvis_m = -(root_rotmats @ joints_m[:, joint, :, None])[..., 0]
        delta_rotmats, delta_m = deltas(root_rotmats.numpy(), pelvis_m.numpy())
        np.testing.assert_allclose(as_rotmats(found[:-1, joint - 1, :3]), delta_rotmats, atol=1e-9)
        np.testing.assert_allclose(found[:-1, joint - 1, 3:], delta_m, atol=1e-9)
    assert found[-1].abs().max() == 0


def test_the_skeleton_is_the_default_bodys(anny: BodyModel) -> None:
    rest_m = anny.joints_template_m - anny.joints_template_m[0]
    np.testing.assert_allclose(np.array(REST_JOINTS_M), rest_m, atol=0.00051)


def test_inputs_lie_side_by_side() -> None:
    poses = random_poses(2, 5)
    alone = network_input(poses, "6d")
    together = network_input(poses, "6d", ("standing", "velocity"))
    config = ModelConfig(input="6d", extra_inputs=("standing", "velocity"))
    assert together.shape == (2, 5, input_size(config)) == (2, 5, 138 + 138 + 69)
    assert torch.equal(together[..., :138], alone)
    assert torch.equal(together[..., 138:276], motions_if_standing(poses).flatten(-2))
    assert torch.equal(together[..., 276:], velocities(poses).flatten(-2))


@pytest.mark.parametrize("extra", [(), ("velocity", "standing")])
def test_a_batch_is_its_sequences(extra: tuple[str, ...]) -> None:
    """Quaternions of the second sequence don't depend on the first."""
    poses = random_poses(3, 6)
    config = ModelConfig.model_validate({"extra_inputs": extra})
    together = network_input(poses, "quaternion", config.extra_inputs)
    for row in range(3):
        alone = network_input(poses[row], "quaternion", config.extra_inputs)
        torch.testing.assert_close(together[row], alone, atol=1e-12, rtol=0)


def test_a_network_that_looks_at_legs_and_trunk_does_not_see_arms() -> None:
    config = ModelConfig(
        layers=1, hidden=4, extra_inputs=("standing", "velocity"), looks_at="legs_and_trunk"
    )
    names = JOINT_NAMES[1:]
    chosen = [i for i, name in enumerate(names) if JOINT_NAMES.index(name) < 12]
    assert {names[i] for i in chosen} >= {"left_hip", "spine3", "right_foot", "left_ankle"}
    assert len(input_columns(config)) == 11 * (4 + 6 + 3)
    model, poses = Gmr(config).double().eval(), random_poses(6)
    other = poses.clone()
    other[:, 11:] = random_poses(3, 6)[2][:, 11:]
    with torch.no_grad():
        a, b = (
            model(network_input(one, config.input, config.extra_inputs)[None])
            for one in (poses, other)
        )
    assert torch.equal(a[0], b[0]) and torch.equal(a[1], b[1])
    other[:, 10] = random_poses(3, 6)[2][:, 10]
    with torch.no_grad():
        c = model(network_input(other, config.input, config.extra_inputs)[None])
    assert not torch.equal(a[1], c[1])
    assert input_columns(ModelConfig()) == list(range(92))
