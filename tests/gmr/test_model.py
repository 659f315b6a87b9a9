"""The network of Fig. 4: what it is given, and what its outputs mean, by forward kinematics."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ModelConfig, MotionSource, Representation
from gmrdata.gmr.model import (
    REST_JOINTS_M,
    Gmr,
    input_columns,
    input_rotmats,
    input_size,
    joints_in_root_frame,
    motions_if_standing,
    network_input,
    velocities,
)
from gmrdata.gmr.rotations import log_map, to_rotmats
from gmrdata.gmr.supports import (
    MASSES,
    PELVIS_MASS,
    SCALE,
    Supports,
    apart_from,
    centre_of_mass_m,
    root_step_m,
    root_turn,
    support_numbers,
    with_flight,
)
from gmrdata.values.body import JOINT_NAMES
from gmrdata.values.motion import deltas
from tests.gmr.direct_reading import parameter_count
from tests.torch_joints import posed_joints

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")
INPUTS = {"quaternion": 92, "axis-angle": 69, "6d": 138}


@pytest.mark.parametrize(("input_", "output"), list(product(REPRESENTATIONS, REPRESENTATIONS)))
def test_all_nine_of_table_1(input_, output):
    config = ModelConfig(layers=2, hidden=8, input=input_, output=output)
    model = Gmr(config)
    poses = torch.randn(3, 10, INPUTS[input_], generator=torch.Generator().manual_seed(0))
    delta_rotmats, delta_m = model(poses)
    assert delta_rotmats.shape == (3, 10, 3, 3)
    assert delta_m.shape == (3, 10, 3)
    eye = torch.eye(3).expand(3, 10, 3, 3)
    torch.testing.assert_close(
        delta_rotmats @ delta_rotmats.transpose(-1, -2), eye, atol=1e-5, rtol=0
    )
    assert sum(p.numel() for p in model.parameters()) == parameter_count(config)


STANDING: MotionSource = "standing_joint"


@pytest.mark.parametrize(
    ("size", "settings", "more_inputs", "more"),
    [
        ((1, 1), {}, 0, 0),
        ((1, 7), {}, 0, 0),
        ((4, 16), {}, 0, 0),
        # Only the first layer is larger: three gates of both directions look at each number.
        ((3, 5), {"extra_inputs": ("velocity",)}, 69, 2 * 3 * 5 * 69),
        ((3, 5), {"extra_inputs": ("standing",)}, 138, 2 * 3 * 5 * 138),
        ((3, 5), {"extra_inputs": ("velocity", "standing")}, 207, 2 * 3 * 5 * 207),
        # 24 shares of each of the features, and as many biases, for each part.
        ((2, 7), {"rotation": STANDING}, 0, 24 * 8),
        ((2, 7), {"translation": STANDING}, 0, 24 * 8),
        ((2, 7), {"rotation": STANDING, "translation": STANDING}, 0, 2 * 24 * 8),
    ],
)
def test_parameter_count(size, settings, more_inputs, more):
    plain = ModelConfig(layers=size[0], hidden=size[1])
    config = ModelConfig.model_validate(plain.model_dump() | settings)
    for one in (plain, config):
        assert sum(p.numel() for p in Gmr(one).parameters()) == parameter_count(one)
    assert input_size(config) == 92 + more_inputs
    assert parameter_count(config) - parameter_count(plain) == more


def test_the_papers_network():
    """4 x 2048: 26.3 M for the first layer, 75.5 M for each other, 8.4 M behind the GRUs."""
    first = 2 * 3 * (2048 * (92 + 2048) + 2 * 2048)
    other = 2 * 3 * (2048 * (4096 + 2048) + 2 * 2048)
    behind = 4096 * 2048 + 2048 + 2048 * 6 + 6
    assert parameter_count(ModelConfig()) == first + 3 * other + behind == 261_289_990


@pytest.mark.parametrize(("latent", "count"), [(None, 7_114_246), (2048, 8_697_862)])
def test_table_9_with_a_latent_size_of_its_own(latent, count):
    """2 / 512, with as many latent numbers as hidden units, and with the 2048 of Fig. 4."""
    config = ModelConfig(layers=2, hidden=512, latent=latent)
    model = Gmr(config)
    assert sum(p.numel() for p in model.parameters()) == parameter_count(config) == count
    assert model.projection.out_features == model.regression.in_features == (latent or 512)
    assert model(torch.zeros(1, 3, 92))[1].shape == (1, 3, 3)


@pytest.mark.parametrize("output", REPRESENTATIONS)
def test_a_network_of_zeros_stands_still(output):
    model = Gmr(ModelConfig(layers=1, hidden=4, output=output))
    for parameter in model.parameters():
        torch.nn.init.zeros_(parameter)
    delta_rotmats, delta_m = model(torch.ones(1, 5, 92))
    assert torch.equal(delta_rotmats, torch.eye(3).expand(1, 5, 3, 3))
    assert torch.equal(delta_m, torch.zeros(1, 5, 3))


@pytest.mark.parametrize("source", ["regressed", "standing_joint"])
def test_padding_changes_nothing(source):
    config = ModelConfig(layers=2, hidden=6, rotation=source, translation=source)
    model = Gmr(config).eval()
    generator = torch.Generator().manual_seed(3)
    poses = torch.randn(3, 12, 92, generator=generator)
    lengths = torch.tensor([5, 12, 2])
    together = model(poses, lengths)
    for row, n in enumerate(lengths.tolist()):
        alone = model(poses[row : row + 1, :n])
        # The last motion leads to a frame that isn't there, and is dropped by callers.
        kept = n if source == "regressed" else n - 1
        for part in range(2):
            expected = alone[part][0, :kept]
            torch.testing.assert_close(together[part][row, :kept], expected, atol=1e-6, rtol=0)


def test_it_looks_both_ways():
    """Each output depends on the first and on the last frame."""
    model = Gmr(ModelConfig(layers=1, hidden=6)).eval()
    poses = torch.randn(1, 9, 92, generator=torch.Generator().manual_seed(5), requires_grad=True)
    model(poses)[1][0, 4].sum().backward()
    assert poses.grad is not None
    assert (poses.grad[0].abs().sum(-1) > 0).all()


def test_network_input_is_w_first_by_joint():
    still = torch.eye(3).expand(4, 23, 3, 3)
    assert torch.equal(network_input(still, "quaternion")[0, :8], torch.tensor([1.0, 0, 0, 0] * 2))
    assert network_input(still, "axis-angle").shape == (4, 69)
    assert network_input(still, "6d").shape == (4, 138)


def random_poses(*sizes: int) -> torch.Tensor:
    """Joints turned by up to about 60 degrees."""
    rng = np.random.default_rng(5)
    rotvecs_rad = rng.normal(scale=0.35, size=(*sizes, 23, 3))
    rotmats = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3)).as_matrix()
    return torch.from_numpy(rotmats.reshape(*sizes, 23, 3, 3))


def as_rotmats(rotvecs_rad: torch.Tensor) -> np.ndarray:
    matrices = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3).numpy()).as_matrix()
    return matrices.reshape(*rotvecs_rad.shape, 3)


def test_velocities_lead_from_each_pose_to_the_next():
    poses = random_poses(2, 7)
    turns = as_rotmats(velocities(poses) / SCALE)
    np.testing.assert_allclose(poses[:, :-1].numpy() @ turns[:, :-1], poses[:, 1:], atol=1e-9)
    assert velocities(poses)[:, -1].abs().max() == 0


def test_a_joint_that_stands_still_shows_the_roots_motion(small_body):
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


def test_the_skeleton_is_the_default_bodys(anny):
    rest_m = anny.joints_template_m - anny.joints_template_m[0]
    np.testing.assert_allclose(np.array(REST_JOINTS_M), rest_m, atol=0.00051)


def test_inputs_lie_side_by_side():
    poses = random_poses(2, 5)
    alone = network_input(poses, "6d")
    together = network_input(poses, "6d", ("standing", "velocity"))
    config = ModelConfig(input="6d", extra_inputs=("standing", "velocity"))
    assert together.shape == (2, 5, input_size(config)) == (2, 5, 138 + 138 + 69)
    assert torch.equal(together[..., :138], alone)
    assert torch.equal(together[..., 138:276], motions_if_standing(poses).flatten(-2))
    assert torch.equal(together[..., 276:], velocities(poses).flatten(-2))


@pytest.mark.parametrize("extra", [(), ("velocity", "standing")])
def test_a_batch_is_its_sequences(extra):
    """Quaternions of the second sequence don't depend on the first."""
    poses = random_poses(3, 6)
    config = ModelConfig.model_validate({"extra_inputs": extra})
    together = network_input(poses, "quaternion", config.extra_inputs)
    for row in range(3):
        alone = network_input(poses[row], "quaternion", config.extra_inputs)
        torch.testing.assert_close(together[row], alone, atol=1e-12, rtol=0)


def test_a_network_that_looks_at_legs_and_trunk_does_not_see_arms():
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


NONE = 23
"""Share of no joint at all."""
BOTH = ModelConfig(layers=1, hidden=4, rotation=STANDING, translation=STANDING)


def sure_of(turning: int, stepping: int, *, by_look: int | None = None) -> Gmr:
    """A network that puts out zeros, but for being sure of which joint stands: by its features, or
    by its first or second look at the joints."""
    model = Gmr(BOTH if by_look is None else BOTH.model_copy(update={"joints_say": True}))
    for parameter in model.parameters():
        torch.nn.init.zeros_(parameter)
    assert model.turn_shares is not None and model.step_shares is not None
    if by_look is None:
        model.turn_shares.logits.bias.data[turning] = 200.0
        model.step_shares.logits.bias.data[stepping] = 200.0
        return model
    assert model.looks is not None
    look = model.looks[by_look]
    look.own.data[turning, 0], look.own.data[stepping, 1] = 200.0, 200.0
    look.scores.weight.data[[0, 1], [0, 1]] = 1.0
    return model


def all_of(joint: int) -> torch.Tensor:
    """Shares that give all to one joint."""
    return torch.nn.functional.one_hot(torch.tensor(joint), 23).double()[:, None]


def joint_turns(root_from_joint: torch.Tensor) -> torch.Tensor:
    """What each joint leaves to the root, as axis-angle; the last frame has no next one."""
    after = torch.cat([root_from_joint[:, 1:], root_from_joint[:, -1:]], dim=1)
    return log_map(root_from_joint @ after.mT)


def test_a_point_at_rest_shows_the_translation(small_body):
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


def test_a_joint_at_rest_shows_the_rotation():
    """The root turns such that one joint keeps its orientation in the world."""
    _, root_from_joint = joints_in_root_frame(random_poses(6))
    for joint in range(23):
        root_rotmats = (
            Rotation.random(random_state=joint).as_matrix() @ root_from_joint[:, joint].mT.numpy()
        )
        delta_rotmats, _ = deltas(root_rotmats, np.zeros((6, 3)))
        turns = root_turn(all_of(joint), joint_turns(root_from_joint[None]))
        np.testing.assert_allclose(turns[0, :-1], delta_rotmats, atol=1e-6)
        np.testing.assert_allclose(turns[0, -1], np.eye(3), atol=1e-6)


def test_shares_of_a_turn_are_shares_of_its_angle():
    """Two joints that turn about the same axis: the mean angle; and none leaves no turn."""
    angles_rad = np.array([[0.0, 0.0], [0.2, 0.6]])
    rotmats = Rotation.from_rotvec([[0, 0, angle] for angle in angles_rad.flat]).as_matrix()
    shares = torch.tensor([0.5, 0.25], dtype=torch.float64)[:, None]
    turns = root_turn(shares, joint_turns(torch.from_numpy(rotmats).reshape(1, 2, 2, 3, 3)))
    expected_rad = -(0.5 * 0.2 + 0.25 * 0.6)
    found_rad = Rotation.from_matrix(turns[0, 0].numpy()).as_rotvec()
    np.testing.assert_allclose(found_rad, [0, 0, expected_rad], atol=1e-9)


@pytest.mark.parametrize("representation", ["quaternion", "axis-angle", "6d"])
def test_joints_are_seen_in_the_networks_input(representation):
    poses = random_poses(2, 5)
    seen = network_input(poses, representation, ("velocity", "standing"))
    expected = joints_in_root_frame(poses)
    found = joints_in_root_frame(input_rotmats(seen, representation))
    torch.testing.assert_close(found, expected, atol=1e-9, rtol=0)


def test_the_joints_that_stand_turn_and_move_the_root():
    poses = random_poses(1, 7)
    places_m, root_from_joint = joints_in_root_frame(poses)
    seen = network_input(poses, "quaternion").float()
    for by_look, (turning, stepping) in product((None, 0, 1), ((6, 9), (9, 6), (22, 22))):
        delta_rotmats, delta_m = sure_of(turning, stepping, by_look=by_look)(seen)
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


def test_a_joint_says_how_it_moved_and_moves():
    poses = random_poses(1, 5)
    places_m, _ = joints_in_root_frame(poses)
    motions = motions_if_standing(poses)
    numbers = support_numbers(Supports(motions, places_m))
    assert torch.equal(numbers[..., :6], motions)
    assert torch.equal(numbers[:, 1:, :, 6:12], motions[:, :-1])
    assert torch.equal(numbers[:, 0, :, 6:12], motions[:, 0])
    assert torch.equal(numbers[..., 12:], 2 * places_m)


def test_no_joint_is_apart_from_its_own_motion():
    poses = random_poses(1, 5)
    places_m, _ = joints_in_root_frame(poses)
    motions = motions_if_standing(poses) / SCALE
    turns = to_rotmats(motions[:, :, 7, :3], "axis-angle")
    supports = Supports(SCALE * motions, places_m)
    apart = apart_from(turns, motions[:, :, 7, 3:], supports)[:, :-1]
    np.testing.assert_allclose(apart[:, :, 7], [[[0] * 6 + [0.01] * 2] * 4], atol=1e-6)
    left_rad = motions[:, :-1, 3, :3] - motions[:, :-1, 7, :3]
    torch.testing.assert_close(apart[:, :, 3, :3], SCALE * left_rad)
    moved_m = (turns[:, :-1] @ places_m[:, 1:, 3, :, None])[..., 0]
    left_m = places_m[:, :-1, 3] - moved_m - motions[:, :-1, 7, 3:]
    torch.testing.assert_close(apart[:, :, 3, 3:6], SCALE * left_m)
    lengths = apart[..., :6].unflatten(-1, (2, 3)).norm(dim=-1)
    torch.testing.assert_close(apart[..., 6:], (lengths.square() + 1e-4).sqrt())


def test_a_body_in_flight_keeps_its_mass_in_place_and_does_not_spin():
    """Its arms and legs go round: what the root does is the rest of no angular momentum."""
    poses = random_poses(1, 3)
    turned = Rotation.from_rotvec(np.random.default_rng(4).normal(0, 1e-4, (23, 3))).as_matrix()
    poses[:, 1] = poses[:, 0] @ torch.from_numpy(turned)
    places_m, _ = joints_in_root_frame(poses)
    supports = with_flight(Supports(motions_if_standing(poses), places_m))
    assert supports.motions.shape == (1, 3, 24, 6)
    delta_rotmat = to_rotmats(supports.turns[0, 0, -1], "axis-angle")
    delta_m = supports.motions[0, 0, -1, 3:] / SCALE
    before_m, after_m = (torch.cat([torch.zeros(1, 3), places_m[0, t]]) for t in (0, 1))
    after_m = after_m @ delta_rotmat.T + delta_m
    centre_m = centre_of_mass_m(places_m)[0, 0]
    torch.testing.assert_close(supports.places_m[0, 0, -1], centre_m)
    masses = torch.tensor((PELVIS_MASS, *MASSES), dtype=torch.float64)[:, None]
    moved_m = after_m - before_m
    assert (masses * moved_m).sum(0).norm() < 1e-6 * (masses * moved_m.norm(dim=1)[:, None]).sum()
    spins = masses * torch.linalg.cross(before_m - centre_m, moved_m)
    # All but the least inertia, about a hundredth of a body's.
    assert spins.sum(0).norm() < 0.03 * spins.norm(dim=1).sum()


@pytest.mark.parametrize("parts", [{"rotation": "regressed"}, {"translation": "regressed"}])
def test_joints_that_do_not_stand_have_no_say(parts):
    with pytest.raises(ValueError, match="joints_say needs rotation and translation"):
        ModelConfig.model_validate(BOTH.model_dump() | {"joints_say": True} | parts)


@pytest.mark.parametrize("joints_say", [False, True])
@pytest.mark.parametrize("input_", ["quaternion", "axis-angle", "6d"])
def test_padding_leaves_finite_gradients(input_, joints_say):
    """Padding is zeros, which are no rotations."""
    model = Gmr(BOTH.model_copy(update={"input": input_, "joints_say": joints_say}))
    poses = network_input(random_poses(2, 6), input_).float()
    poses[0, 3:] = 0
    delta_rotmats, delta_m = model(poses, torch.tensor([3, 6]))
    (delta_rotmats[:, :2].sum() + delta_m[:, :2].sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


@pytest.mark.parametrize("standing", [("standing",), ("velocity", "standing"), ()])
def test_what_joints_say_is_taken_from_the_input_or_made(standing):
    config = BOTH.model_copy(update={"joints_say": True, "extra_inputs": standing})
    model, poses = Gmr(config), random_poses(2, 6)
    assert model.looks is not None
    for look in model.looks:
        torch.nn.init.normal_(look.scores.weight)
    seen = network_input(poses, "quaternion", standing).float()
    given = model(seen)
    model._given = slice(0)  # now made of the rotations, of which the last frame leads nowhere
    made = model(seen)
    for one, other in zip(given, made, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-5)
    assert sum(p.numel() for p in model.parameters()) == parameter_count(config)
