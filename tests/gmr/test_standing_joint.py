"""The translation that a standing joint leaves, against forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.body.forward import posed_joints
from gmrdata.body.model import BodyModel
from gmrdata.gmr.config import ModelConfig, Representation
from gmrdata.gmr.model import Gmr, network_input, parameter_count
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.root_frame import REST_JOINTS_M, joints_in_root_frame
from gmrdata.gmr.standing_joint import places_seen, steps_if_still
from tests.gmr.test_extra_inputs import random_poses

NONE = 23
"""Share of no joint at all."""


def sure_of(joint: int, output: Representation = "axis-angle") -> Gmr:
    """A network that puts out zeros, but for being sure of which joint stands."""
    model = Gmr(ModelConfig(layers=1, hidden=4, output=output, translation="standing_joint"))
    for parameter in model.parameters():
        torch.nn.init.zeros_(parameter)
    assert model.standing is not None
    model.standing.logits.bias.data[joint] = 200.0
    return model


def test_a_point_at_rest_shows_the_translation(small_body: BodyModel) -> None:
    """The root turns at random about one joint, which stays where it is."""
    body = replace(small_body, joints_template_m=np.add(REST_JOINTS_M, (0.1, 0.2, 0.3)))
    poses = random_poses(6)
    joints_m, _ = posed_joints(body, torch.zeros(10), poses)
    places_m, _ = joints_in_root_frame(poses)
    np.testing.assert_allclose(places_m, joints_m[:, 1:] - joints_m[:, :1], atol=1e-9)
    root_rotmats = torch.from_numpy(Rotation.random(6, random_state=3).as_matrix())
    for joint in range(23):
        pelvis_m = -(root_rotmats @ places_m[:, joint, :, None])[..., 0]
        delta_rotmats, delta_m = deltas(root_rotmats.numpy(), pelvis_m.numpy())
        with_last = torch.eye(3, dtype=torch.float64).repeat(1, 6, 1, 1)
        with_last[0, :-1] = torch.from_numpy(delta_rotmats)
        steps_m = steps_if_still(places_m[None], with_last)
        np.testing.assert_allclose(steps_m[0, :-1, joint], delta_m, atol=1e-9)


@pytest.mark.parametrize("representation", ["quaternion", "axis-angle", "6d"])
def test_places_are_seen_in_the_networks_input(representation: Representation) -> None:
    poses = random_poses(2, 5)
    seen = network_input(poses, representation, ("velocity", "standing"))
    expected, _ = joints_in_root_frame(poses)
    torch.testing.assert_close(places_seen(seen, representation), expected, atol=1e-9, rtol=0)


def test_the_joint_that_stands_moves_the_root() -> None:
    poses = random_poses(1, 7)
    places_m, _ = joints_in_root_frame(poses)
    seen = network_input(poses, "quaternion").float()
    for joint in (6, 9, 22):
        delta_rotmats, delta_m = sure_of(joint)(seen)
        assert torch.equal(delta_rotmats, torch.eye(3).expand(1, 7, 3, 3))
        steps_m = places_m[0, :-1, joint] - places_m[0, 1:, joint]
        np.testing.assert_allclose(delta_m[0, :-1].detach(), steps_m, atol=1e-6)
    assert sure_of(NONE)(seen)[1].abs().max() == 0


@pytest.mark.parametrize("input_", ["quaternion", "axis-angle", "6d"])
def test_padding_leaves_finite_gradients(input_: Representation) -> None:
    """Padding is zeros, which are no rotations."""
    model = Gmr(ModelConfig(layers=1, hidden=4, input=input_, translation="standing_joint"))
    poses = network_input(random_poses(2, 6), input_).float()
    poses[0, 3:] = 0
    delta_rotmats, delta_m = model(poses, torch.tensor([3, 6]))
    (delta_rotmats[:, :2].sum() + delta_m[:, :2].sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


def test_parameter_count() -> None:
    """24 shares of each of the features, and as many biases."""
    config = ModelConfig(layers=2, hidden=7, translation="standing_joint")
    assert sum(p.numel() for p in Gmr(config).parameters()) == parameter_count(config)
    plain = parameter_count(ModelConfig(layers=2, hidden=7))
    assert parameter_count(config) - plain == 24 * 8
