"""A symmetric network: the mean of four answers, whichever of the four ways is given."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from gmrdata.gmr.augmentation import mean_of_four, mirror_local, mirror_points_m, mirror_rotmats
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import Gmr, network_input, seen_from_feet
from gmrdata.gmr.predict import TrainedGmr, onnx_network, predict_deltas
from gmrdata.values.motion import Motion, deltas
from tests.gmr.test_extra_inputs import random_poses
from tests.gmr.test_onnx_network import run_onnx

CONFIG = ModelConfig(
    layers=1, hidden=5, extra_inputs=("standing", "velocity", "feet"), looks_at="legs_and_trunk",
    rotation="standing_joint", translation="standing_joint", output_scale=0.5, symmetric=True,
)  # fmt: skip


def network(config: ModelConfig = CONFIG) -> Gmr:
    torch.manual_seed(1)
    return Gmr(config).double().eval()


def answer(model: Gmr, poses: Tensor, lengths: Tensor | None = None) -> tuple[Tensor, Tensor]:
    config = model.config
    with torch.no_grad():
        return model(network_input(poses, config.input, config.extra_inputs), lengths)


def test_a_mirror_image_moves_as_the_mirrored_person() -> None:
    poses, model = random_poses(1, 7), network()
    turns, moves_m = answer(model, poses)
    seen = answer(model, torch.from_numpy(mirror_local(poses.numpy())))
    np.testing.assert_allclose(seen[0][:, :-1], mirror_rotmats(turns.numpy())[:, :-1], atol=1e-6)
    np.testing.assert_allclose(seen[1][:, :-1], mirror_points_m(moves_m.numpy())[:, :-1], atol=1e-6)


def test_backwards_the_person_goes_back() -> None:
    poses, model = random_poses(1, 7), network()
    turns, back = answer(model, poses)[0], answer(model, poses.flip(1))[0]
    np.testing.assert_allclose(back[0, :-1].flip(0), turns[0, :-1].mT, atol=1e-6)


def test_four_right_answers_are_one(walk: Callable[..., Motion]) -> None:
    """True motions of a walk, its mirror image, its reverse and both; and of a shorter piece."""
    motion = walk(10.0)
    roots, pelvis_m = motion.root_rotmats[:12], motion.pelvis_m[:12]
    turns, moves_m = np.zeros((4, 2, 12, 3, 3)), np.zeros((4, 2, 12, 3))
    for piece, n in enumerate((12, 7)):
        for way in range(4):
            step = -1 if way >= 2 else 1
            found = deltas(roots[:n][::step], pelvis_m[:n][::step])
            if way % 2:
                found = mirror_rotmats(found[0]), mirror_points_m(found[1])
            turns[way, piece, : n - 1], moves_m[way, piece, : n - 1] = found
            turns[way, piece, n - 1 :] = np.eye(3)
    lengths = torch.tensor([12, 7])
    ways = zip(torch.from_numpy(turns), torch.from_numpy(moves_m), strict=True)
    mean = mean_of_four(list(ways), lengths)
    wanted = deltas(roots, pelvis_m)
    for piece, n in enumerate((12, 7)):
        np.testing.assert_allclose(mean[0][piece, : n - 1], wanted[0][: n - 1], atol=1e-6)
        np.testing.assert_allclose(mean[1][piece, : n - 1], wanted[1][: n - 1], atol=1e-6)


def test_the_answer_lies_between_the_plain_networks_answers() -> None:
    poses, model = random_poses(1, 9), network()
    plain = Gmr(CONFIG.model_copy(update={"symmetric": False})).double().eval()
    plain.load_state_dict(model.state_dict())
    _, as_given = answer(plain, poses)
    mirrored = mirror_points_m(
        answer(plain, torch.from_numpy(mirror_local(poses.numpy())))[1].numpy()
    )
    _, mean_m = answer(model, poses)
    assert np.abs(as_given.numpy() - mirrored)[:, :-1].max() > 1e-3
    assert not torch.allclose(mean_m, as_given)
    model.train()
    torch.testing.assert_close(answer(model, poses)[1], as_given)


def test_a_padded_batch_is_its_sequences() -> None:
    poses, model = random_poses(2, 8), network()
    alone = answer(model, poses[1:, :5])
    together = answer(model, poses, torch.tensor([8, 5]))
    torch.testing.assert_close(together[0][1, :4], alone[0][0, :4])
    torch.testing.assert_close(together[1][1, :4], alone[1][0, :4])


@pytest.mark.parametrize("n_frames", [2, 9])
def test_as_an_onnx_model(n_frames: int) -> None:
    gmr = TrainedGmr(network().float(), 10.0, "some_run", 3)
    poses = random_poses(2, n_frames).numpy()
    turns, steps_m = run_onnx(onnx_network(gmr), poses)
    for at, one in enumerate(poses):
        wanted = predict_deltas(gmr, one)
        np.testing.assert_allclose(turns[at], wanted[0], atol=1e-5)
        np.testing.assert_allclose(steps_m[at], wanted[1], atol=1e-5)


def test_feet_see_the_body_in_their_own_frames() -> None:
    """Where the left foot stands as in the T-pose, its frame is the root's."""
    still = torch.eye(3, dtype=torch.float64).expand(3, 23, 3, 3).clone()
    left, right = seen_from_feet(still)[0].unbind(0)
    np.testing.assert_allclose(left[6:9], (-0.224, 0, 0), atol=1e-12)  # the other ankle
    np.testing.assert_allclose(right[6:9], (0.224, 0, 0), atol=1e-12)
    np.testing.assert_allclose(left[12:15], (-0.112, 0.856, 0.008), atol=1e-12)  # the pelvis
    np.testing.assert_allclose(left[24:], (0, 1, 0, 0, 1, 0), atol=1e-12)
    assert -0.13 < left[0] < -0.1 and 0.8 < left[1] < 1.2, "the centre of mass, about the pelvis"
    poses = random_poses(6)
    seen = seen_from_feet(poses)
    np.testing.assert_allclose(
        seen[:-1, 0, 12:15] + seen[:-1, 0, 15:18] / 10, seen[1:, 0, 12:15], atol=1e-12
    )
    assert seen[-1, :, 3:6].abs().max() == 0
    mirrored = seen_from_feet(torch.from_numpy(mirror_local(poses.numpy())))
    swapped = seen.flip(1).unflatten(-1, (10, 3)) * torch.tensor([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(mirrored, swapped.flatten(-2), atol=1e-12)
