"""The motion that a standing joint leaves to the root, against forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ModelConfig, Representation
from gmrdata.gmr.model import (
    REST_JOINTS_M,
    Gmr,
    input_rotmats,
    joints_in_root_frame,
    motions_if_standing,
    network_input,
    root_step_m,
    root_turn,
    speeds_of_change,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import deltas
from tests.gmr.direct_reading import parameter_count
from tests.gmr.test_extra_inputs import random_poses
from tests.torch_joints import posed_joints

NONE = 23
"""Share of no joint at all."""
BOTH = ModelConfig(layers=1, hidden=4, rotation="standing_joint", translation="standing_joint")


def sure_of(turning: int, stepping: int) -> Gmr:
    """A network that puts out zeros, but for being sure of which joint stands."""
    model = Gmr(BOTH)
    for parameter in model.parameters():
        torch.nn.init.zeros_(parameter)
    assert model.turn_shares is not None and model.step_shares is not None
    model.turn_shares.logits.bias.data[turning] = 200.0
    model.step_shares.logits.bias.data[stepping] = 200.0
    return model


def all_of(joint: int) -> torch.Tensor:
    """Shares that give all to one joint."""
    return torch.nn.functional.one_hot(torch.tensor(joint), 23).double()[:, None]


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
        steps_m = root_step_m(all_of(joint), places_m[None], with_last)
        np.testing.assert_allclose(steps_m[0, :-1], delta_m, atol=1e-9)


def test_a_joint_at_rest_shows_the_rotation() -> None:
    """The root turns such that one joint keeps its orientation in the world."""
    _, root_from_joint = joints_in_root_frame(random_poses(6))
    for joint in range(23):
        root_rotmats = (
            Rotation.random(random_state=joint).as_matrix() @ root_from_joint[:, joint].mT.numpy()
        )
        delta_rotmats, _ = deltas(root_rotmats, np.zeros((6, 3)))
        turns = root_turn(all_of(joint), root_from_joint[None])
        np.testing.assert_allclose(turns[0, :-1], delta_rotmats, atol=1e-6)
        np.testing.assert_allclose(turns[0, -1], np.eye(3), atol=1e-6)


def test_shares_of_a_turn_are_shares_of_its_angle() -> None:
    """Two joints that turn about the same axis: the mean angle; and none leaves no turn."""
    angles_rad = np.array([[0.0, 0.0], [0.2, 0.6]])
    rotmats = Rotation.from_rotvec([[0, 0, angle] for angle in angles_rad.flat]).as_matrix()
    shares = torch.tensor([0.5, 0.25], dtype=torch.float64)[:, None]
    turns = root_turn(shares, torch.from_numpy(rotmats).reshape(1, 2, 2, 3, 3))
    expected_rad = -(0.5 * 0.2 + 0.25 * 0.6)
    found_rad = Rotation.from_matrix(turns[0, 0].numpy()).as_rotvec()
    np.testing.assert_allclose(found_rad, [0, 0, expected_rad], atol=1e-9)


@pytest.mark.parametrize("representation", ["quaternion", "axis-angle", "6d"])
def test_joints_are_seen_in_the_networks_input(representation: Representation) -> None:
    poses = random_poses(2, 5)
    seen = network_input(poses, representation, ("velocity", "standing"))
    expected = joints_in_root_frame(poses)
    found = joints_in_root_frame(input_rotmats(seen, representation))
    torch.testing.assert_close(found, expected, atol=1e-9, rtol=0)


def test_the_joints_that_stand_turn_and_move_the_root() -> None:
    poses = random_poses(1, 7)
    places_m, root_from_joint = joints_in_root_frame(poses)
    seen = network_input(poses, "quaternion").float()
    for turning, stepping in ((6, 9), (9, 6), (22, 22)):
        delta_rotmats, delta_m = sure_of(turning, stepping)(seen)
        turns = root_from_joint[0, :-1, turning] @ root_from_joint[0, 1:, turning].mT
        np.testing.assert_allclose(delta_rotmats[0, :-1].detach(), turns, atol=2e-6)
        moved_m = (turns @ places_m[0, 1:, stepping, :, None])[..., 0]
        steps_m = places_m[0, :-1, stepping] - moved_m
        np.testing.assert_allclose(delta_m[0, :-1].detach(), steps_m, atol=5e-6)
    for joint in (6, 9, 22):
        delta_rotmats, delta_m = sure_of(NONE, joint)(seen)
        assert torch.equal(delta_rotmats, torch.eye(3).expand(1, 7, 3, 3))
        steps_m = places_m[0, :-1, joint] - places_m[0, 1:, joint]
        np.testing.assert_allclose(delta_m[0, :-1].detach(), steps_m, atol=1e-6)
    delta_rotmats, delta_m = sure_of(NONE, NONE)(seen)
    assert torch.equal(delta_rotmats, torch.eye(3).expand(1, 7, 3, 3))
    assert delta_m.abs().max() == 0


@pytest.mark.parametrize("input_", ["quaternion", "axis-angle", "6d"])
def test_padding_leaves_finite_gradients(input_: Representation) -> None:
    """Padding is zeros, which are no rotations."""
    model = Gmr(BOTH.model_copy(update={"input": input_}))
    poses = network_input(random_poses(2, 6), input_).float()
    poses[0, 3:] = 0
    delta_rotmats, delta_m = model(poses, torch.tensor([3, 6]))
    (delta_rotmats[:, :2].sum() + delta_m[:, :2].sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


@pytest.mark.parametrize("parts", [("rotation",), ("translation",), ("rotation", "translation")])
def test_parameter_count(parts: tuple[str, ...]) -> None:
    """24 shares of each of the features, and as many biases, for each part."""
    standing = dict.fromkeys(parts, "standing_joint")
    config = ModelConfig.model_validate({"layers": 2, "hidden": 7} | standing)
    assert sum(p.numel() for p in Gmr(config).parameters()) == parameter_count(config)
    plain = parameter_count(ModelConfig(layers=2, hidden=7))
    assert parameter_count(config) - plain == 24 * 8 * len(parts)


def test_who_holds_a_pose_stands_still_whatever_is_regressed() -> None:
    """A pose that is held, then left: what is regressed counts by how fast the pose changes."""
    config = BOTH.model_copy(update={"regressed": "as_the_pose_changes", "output_scale": 0.1})
    model, free = Gmr(config).double(), Gmr(BOTH.model_copy(update={"output_scale": 0.1})).double()
    free.load_state_dict(model.state_dict())
    for network in (model, free):
        network.regression.bias.data[:] = 3.0
        for shares in (network.turn_shares, network.step_shares):
            assert shares is not None
            shares.logits.bias.data[NONE] = 200.0
    poses = random_poses(1).expand(8, -1, -1, -1).clone()
    poses[6:] = random_poses(3)[1:]
    seen = network_input(poses, "quaternion")[None]
    with torch.no_grad():
        turns, delta_m = model(seen)
        free_turns, free_m = free(seen)
        speeds = speeds_of_change(*joints_in_root_frame(poses))[:, 0]
    assert speeds[:5].max() < 1e-6 < 1 < speeds[5:].min()
    assert delta_m[0, :5].abs().max() < 1e-6
    torch.testing.assert_close(turns[0, :5], torch.eye(3).double().expand(5, 3, 3))
    torch.testing.assert_close(delta_m[0], free_m[0] * speeds[:, None])
    assert free_m.abs().min() > 0.1
    assert not torch.allclose(free_turns[0, :5], torch.eye(3).double().expand(5, 3, 3), atol=0.1)


def test_speeds_of_change_are_the_larger_of_both_sides() -> None:
    poses = random_poses(5)
    motions = motions_if_standing(poses).square().mean((-1, -2)).sqrt()
    speeds = speeds_of_change(*joints_in_root_frame(poses))[:, 0]
    wanted = torch.maximum(motions, torch.cat([motions[:1], motions[:-1]]))
    torch.testing.assert_close(speeds, wanted)
