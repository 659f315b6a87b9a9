"""Windows that are mirrored or noisy."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.augmentation import mirror_local, mirror_points_m, mirror_rotmats, turned
from gmrdata.gmr.config import ModelConfig, WindowConfig
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.values.body import JOINT_NAMES, MIRRORED
from gmrdata.values.motion import Motion, accumulate, deltas
from gmrdata.values.skinning import motion_joints_m
from tests.motions import bare_clip, random_motion

MIRROR = np.diag([-1.0, 1.0, 1.0])


def mirror_motion(motion: Motion) -> Motion:
    """A world's motion with left and right exchanged."""
    return replace(
        motion,
        local_rotmats=mirror_local(motion.local_rotmats),
        root_rotmats=mirror_rotmats(motion.root_rotmats),
        pelvis_m=mirror_points_m(motion.pelvis_m),
    )


@given(st.integers(0, 2**31 - 1))
def test_mirrored_twice_is_the_motion_itself(seed):
    motion = random_motion(np.random.default_rng(seed), 5)
    once = mirror_motion(motion)
    twice = mirror_motion(once)
    for name in ("local_rotmats", "root_rotmats", "pelvis_m"):
        np.testing.assert_array_equal(getattr(twice, name), getattr(motion, name))
        assert not np.array_equal(getattr(once, name), getattr(motion, name))
    assert np.linalg.det(once.local_rotmats) == pytest.approx(1.0)


@given(st.integers(0, 2**31 - 1))
def test_joints_are_the_mirror_image(small_body, seed):
    """On a skeleton of equal sides: x changes its sign, and left and right their names."""
    motion = random_motion(np.random.default_rng(seed), 5)
    mirrored_m = motion_joints_m(small_body, mirror_motion(motion))
    expected_m = motion_joints_m(small_body, motion)[:, list(MIRRORED)] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(mirrored_m, expected_m, atol=1e-12)
    assert JOINT_NAMES[MIRRORED[JOINT_NAMES.index("left_knee")]] == "right_knee"


@given(st.integers(0, 2**31 - 1))
def test_motions_between_frames_are_mirrored_in_the_body(seed):
    motion = random_motion(np.random.default_rng(seed), 5)
    mirrored = mirror_motion(motion)
    delta_rotmats, delta_m = deltas(motion.root_rotmats, motion.pelvis_m)
    found_rotmats, found_m = deltas(mirrored.root_rotmats, mirrored.pelvis_m)
    np.testing.assert_allclose(found_rotmats, MIRROR @ delta_rotmats @ MIRROR, atol=1e-12)
    np.testing.assert_allclose(found_m, delta_m @ MIRROR, atol=1e-12)
    roots, pelvis_m = accumulate(
        found_rotmats, found_m, mirrored.root_rotmats[0], mirrored.pelvis_m[0]
    )
    np.testing.assert_allclose(roots, mirrored.root_rotmats, atol=1e-12)
    np.testing.assert_allclose(pelvis_m, mirrored.pelvis_m, atol=1e-12)


def test_a_left_turn_becomes_a_right_turn():
    """A person who faces y of the world turns left by 30 degrees and steps to the left."""
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    stand = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    motion = replace(
        random_motion(np.random.default_rng(0), 2),
        root_rotmats=np.stack([stand, turn @ stand]),
        pelvis_m=np.array([[0.0, 0, 1], [-0.4, 0, 1]]),
    )
    mirrored = mirror_motion(motion)
    np.testing.assert_allclose(mirrored.root_rotmats, [stand, turn.T @ stand], atol=1e-15)
    np.testing.assert_array_equal(mirrored.pelvis_m, [[0.0, 0, 1], [0.4, 0, 1]])


@pytest.mark.parametrize("representation", ["quaternion", "axis-angle", "6d"])
@pytest.mark.parametrize("extra", [(), ("velocity", "standing")])
@pytest.mark.parametrize("reverse", [0.0, 1.0])
def test_mirrored_windows_are_windows_of_mirrored_clips(make_clips, representation, extra, reverse):
    clips = make_clips(2, 4)
    mirrored = [replace(clip, motion=mirror_motion(clip.motion)) for clip in clips]
    plain = WindowConfig(frames=12, reverse_probability=reverse)
    config = plain.model_copy(update={"mirror_probability": 1.0})
    sets = [
        make_training_set(some, ModelConfig(input=representation, extra_inputs=extra), plain)
        for some in (clips, mirrored)
    ]
    for step in range(4):
        found = make_batch(sets[0], config, 1, seed=3, step=step)
        expected = make_batch(sets[1], plain, 1, seed=3, step=step)
        torch.testing.assert_close(found.local_rotmats, expected.local_rotmats, atol=2e-6, rtol=0)
        torch.testing.assert_close(found.poses, expected.poses, atol=2e-6, rtol=0)
        torch.testing.assert_close(found.motions.delta_rotmats, expected.motions.delta_rotmats)
        torch.testing.assert_close(found.motions.delta_m, expected.motions.delta_m)


def test_about_as_many_windows_are_mirrored_as_asked_for():
    motion = random_motion(np.random.default_rng(1), 40)
    config = WindowConfig(frames=40, reverse_probability=0.0, mirror_probability=0.3)
    training_set = make_training_set([bare_clip("one", motion)], ModelConfig(input="6d"), config)
    batch = make_batch(training_set, config, 400, seed=0, step=0)
    whole = torch.from_numpy(motion.local_rotmats).float()
    share = (
        sum(not torch.allclose(window, whole, atol=1e-5) for window in batch.local_rotmats) / 400
    )
    assert share == pytest.approx(0.3, abs=0.07)


STILL = np.tile(np.eye(3), (6, 64, 23, 1, 1))


def noise_rad(config: WindowConfig) -> np.ndarray:
    """Axis-angle vectors (6, 64, 23, 3) by which a still pose is turned."""
    rotmats = turned(STILL, config, np.random.default_rng(0))
    return Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec().reshape(6, 64, 23, 3)


@pytest.mark.parametrize("time_s", [0.0, 0.05, 0.3, 2.0])
def test_its_size_is_that_asked_for(time_s):
    found = noise_rad(WindowConfig(pose_noise_deg=4.0, pose_noise_time_s=time_s))
    rms_deg = np.rad2deg(np.sqrt((found**2).sum(-1).mean()))
    assert rms_deg == pytest.approx(4.0, rel=0.02 if time_s < 1 else 0.06)
    by_frame = np.sqrt((found**2).sum(-1).mean((0, 2)))
    assert by_frame.max() < 1.25 * by_frame.min()


@pytest.mark.parametrize("fps_hz", [10.0, 20.0])
def test_smooth_noise_is_alike_in_neighbouring_frames(fps_hz):
    """A Gaussian of s frames makes the correlation exp(-1 / 4s^2) from frame to frame."""
    config = WindowConfig(pose_noise_deg=1.0, pose_noise_time_s=0.2, fps_hz=fps_hz)
    found = noise_rad(config)
    correlation = (found[:, 1:] * found[:, :-1]).mean() / (found**2).mean()
    assert correlation == pytest.approx(np.exp(-1 / (4 * (0.2 * fps_hz) ** 2)), abs=0.01)
    white = noise_rad(config.model_copy(update={"pose_noise_time_s": 0.0}))
    assert abs((white[:, 1:] * white[:, :-1]).mean() / (white**2).mean()) < 0.01


def test_joints_are_turned_about_their_own_axes():
    rng = np.random.default_rng(1)
    rotmats = Rotation.random(23 * 8, random_state=2).as_matrix().reshape(8, 23, 3, 3)
    noisy = turned(rotmats.astype(np.float32), WindowConfig(pose_noise_deg=2.0), rng)
    assert noisy.dtype == np.float32
    angles_deg = np.rad2deg(
        Rotation.from_matrix((rotmats.swapaxes(-1, -2) @ noisy).reshape(-1, 3, 3)).magnitude()
    )
    assert 0 < angles_deg.min() < 2 < angles_deg.max() < 8


def test_only_the_input_is_noisy(make_clips):
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


def test_each_window_has_its_share_of_the_jitter():
    jitter = np.rad2deg(np.linalg.norm(noise_rad(WindowConfig(jitter_deg=3.0)), axis=-1))
    of_window = np.sqrt((jitter**2).mean((-2, -1)))
    assert of_window.min() < 0.5 and 2.5 < of_window.max() < 3.2
