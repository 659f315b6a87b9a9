"""The mirror augmentation: exact, consistent, and the same body seen in a mirror."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.augmentation import mirror_local, mirror_points_m, mirror_rotmats
from gmrdata.gmr.config import ExtraInput, ModelConfig, Representation, WindowConfig
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.values.body import JOINT_NAMES, MIRRORED, BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion
from gmrdata.values.motion_deltas import accumulate, deltas
from gmrdata.values.skinning import motion_joints_m

MIRROR = np.diag([-1.0, 1.0, 1.0])


def random_motion(seed: int, n_frames: int = 5) -> Motion:
    rng = np.random.default_rng(seed)
    rotmats = Rotation.random(24 * n_frames, random_state=seed).as_matrix()
    rotmats = rotmats.reshape(n_frames, 24, 3, 3)
    return Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=rng.normal(size=(n_frames, 3)),
        shape=np.zeros(10),
        fps_hz=10.0,
        body="small",
        gender="neutral",
        frame="world",
        source="random",
    )


def mirror_motion(motion: Motion) -> Motion:
    """A world's motion with left and right exchanged."""
    return replace(
        motion,
        local_rotmats=mirror_local(motion.local_rotmats),
        root_rotmats=mirror_rotmats(motion.root_rotmats),
        pelvis_m=mirror_points_m(motion.pelvis_m),
    )


@given(st.integers(0, 2**31 - 1))
def test_mirrored_twice_is_the_motion_itself(seed: int) -> None:
    motion = random_motion(seed)
    once = mirror_motion(motion)
    twice = mirror_motion(once)
    for name in ("local_rotmats", "root_rotmats", "pelvis_m"):
        np.testing.assert_array_equal(getattr(twice, name), getattr(motion, name))
        assert not np.array_equal(getattr(once, name), getattr(motion, name))
    assert np.linalg.det(once.local_rotmats) == pytest.approx(1.0)


@given(st.integers(0, 2**31 - 1))
def test_joints_are_the_mirror_image(small_body: BodyModel, seed: int) -> None:
    """On a skeleton of equal sides: x changes its sign, and left and right their names."""
    motion = random_motion(seed)
    mirrored_m = motion_joints_m(small_body, mirror_motion(motion))
    expected_m = motion_joints_m(small_body, motion)[:, list(MIRRORED)] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(mirrored_m, expected_m, atol=1e-12)
    assert JOINT_NAMES[MIRRORED[JOINT_NAMES.index("left_knee")]] == "right_knee"


@given(st.integers(0, 2**31 - 1))
def test_motions_between_frames_are_mirrored_in_the_body(seed: int) -> None:
    motion = random_motion(seed)
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


def test_a_left_turn_becomes_a_right_turn() -> None:
    """A person who faces y of the world turns left by 30 degrees and steps to the left."""
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    stand = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    motion = replace(
        random_motion(0, 2),
        root_rotmats=np.stack([stand, turn @ stand]),
        pelvis_m=np.array([[0.0, 0, 1], [-0.4, 0, 1]]),
    )
    mirrored = mirror_motion(motion)
    np.testing.assert_allclose(mirrored.root_rotmats, [stand, turn.T @ stand], atol=1e-15)
    np.testing.assert_array_equal(mirrored.pelvis_m, [[0.0, 0, 1], [0.4, 0, 1]])


@pytest.mark.parametrize("representation", ["quaternion", "axis-angle", "6d"])
@pytest.mark.parametrize("extra", [(), ("velocity", "standing")])
@pytest.mark.parametrize("reverse", [0.0, 1.0])
def test_mirrored_windows_are_windows_of_mirrored_clips(
    make_clips: Callable[..., list[Clip]],
    representation: Representation,
    extra: tuple[ExtraInput, ...],
    reverse: float,
) -> None:
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


def test_about_as_many_windows_are_mirrored_as_asked_for() -> None:
    motion = random_motion(1, 40)
    clip = Clip("one", motion, np.ones(40, bool), np.full(40, -1), None)
    config = WindowConfig(frames=40, reverse_probability=0.0, mirror_probability=0.3)
    training_set = make_training_set([clip], ModelConfig(input="6d"), config)
    batch = make_batch(training_set, config, 400, seed=0, step=0)
    whole = torch.from_numpy(motion.local_rotmats).float()
    share = (
        sum(not torch.allclose(window, whole, atol=1e-5) for window in batch.local_rotmats) / 400
    )
    assert share == pytest.approx(0.3, abs=0.07)
