"""Noise on the network's input: of the size and smoothness asked for, and on nothing else."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.augmentation import turned
from gmrdata.gmr.config import ModelConfig, WindowConfig
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.values.clip import Clip

STILL = np.tile(np.eye(3), (6, 64, 23, 1, 1))


def noise_rad(config: WindowConfig) -> np.ndarray:
    """Axis-angle vectors (6, 64, 23, 3) by which a still pose is turned."""
    rotmats = turned(STILL, config, np.random.default_rng(0))
    return Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec().reshape(6, 64, 23, 3)


@pytest.mark.parametrize("time_s", [0.0, 0.05, 0.3, 2.0])
def test_its_size_is_that_asked_for(time_s: float) -> None:
    found = noise_rad(WindowConfig(pose_noise_deg=4.0, pose_noise_time_s=time_s))
    rms_deg = np.rad2deg(np.sqrt((found**2).sum(-1).mean()))
    assert rms_deg == pytest.approx(4.0, rel=0.02 if time_s < 1 else 0.06)
    by_frame = np.sqrt((found**2).sum(-1).mean((0, 2)))
    assert by_frame.max() < 1.25 * by_frame.min()


@pytest.mark.parametrize("fps_hz", [10.0, 20.0])
def test_smooth_noise_is_alike_in_neighbouring_frames(fps_hz: float) -> None:
    """A Gaussian of s frames makes the correlation exp(-1 / 4s^2) from frame to frame."""
    config = WindowConfig(pose_noise_deg=1.0, pose_noise_time_s=0.2, fps_hz=fps_hz)
    found = noise_rad(config)
    correlation = (found[:, 1:] * found[:, :-1]).mean() / (found**2).mean()
    assert correlation == pytest.approx(np.exp(-1 / (4 * (0.2 * fps_hz) ** 2)), abs=0.01)
    white = noise_rad(config.model_copy(update={"pose_noise_time_s": 0.0}))
    assert abs((white[:, 1:] * white[:, :-1]).mean() / (white**2).mean()) < 0.01


def test_joints_are_turned_about_their_own_axes() -> None:
    rng = np.random.default_rng(1)
    rotmats = Rotation.random(23 * 8, random_state=2).as_matrix().reshape(8, 23, 3, 3)
    noisy = turned(rotmats.astype(np.float32), WindowConfig(pose_noise_deg=2.0), rng)
    assert noisy.dtype == np.float32
    angles_deg = np.rad2deg(
        Rotation.from_matrix((rotmats.swapaxes(-1, -2) @ noisy).reshape(-1, 3, 3)).magnitude()
    )
    assert 0 < angles_deg.min() < 2 < angles_deg.max() < 8


def test_only_the_input_is_noisy(make_clips: Callable[..., list[Clip]]) -> None:
    clean = WindowConfig(frames=60)
    noisy = clean.model_copy(update={"pose_noise_deg": 3.0})
    training_set = make_training_set(
        make_clips(2, 1), ModelConfig(input="axis-angle", extra_inputs=("velocity",)), clean
    )
    a, b = (make_batch(training_set, config, 3, seed=2, step=9) for config in (clean, noisy))
    assert torch.equal(a.local_rotmats, b.local_rotmats)
    assert torch.equal(a.motions.delta_rotmats, b.motions.delta_rotmats)
    assert torch.equal(a.motions.delta_m, b.motions.delta_m)
    difference = (a.poses - b.poses)[..., :69]
    assert 0.5 < np.rad2deg(difference.square().mean().sqrt().item()) * np.sqrt(3) / 3.0 < 1.5
    assert a.lengths.tolist() == [40, 40, 40]
    assert b.poses[:, 40:].abs().max() == 0
    assert b.poses[:, 39, 69:].abs().max() < 1e-5
    again = make_batch(training_set, noisy, 3, seed=2, step=9)
    assert torch.equal(again.poses, b.poses)
    assert not torch.equal(make_batch(training_set, noisy, 3, seed=2, step=8).poses, b.poses)


def test_posture_noise_is_the_same_in_all_frames_of_a_window() -> None:
    found = noise_rad(WindowConfig(posture_noise_deg=4.0))
    np.testing.assert_allclose(found, found[:, :1] + np.zeros_like(found), atol=1e-12)
    rms_deg = np.rad2deg(np.sqrt((found**2).sum(-1).mean()))
    assert rms_deg == pytest.approx(4.0, rel=0.15)
    assert np.abs(found[0] - found[1]).max() > 0.01
    both = noise_rad(WindowConfig(posture_noise_deg=3.0, pose_noise_deg=4.0, pose_noise_time_s=0.3))
    assert np.rad2deg(np.sqrt((both**2).sum(-1).mean())) == pytest.approx(5.0, rel=0.1)
