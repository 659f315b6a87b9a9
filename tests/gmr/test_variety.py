"""Windows of people who move faster or slower, or have the arms of somebody else."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from gmrdata.gmr.augmentation import with_exchanged_arms
from gmrdata.gmr.config import ModelConfig, WindowConfig
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.values.body import JOINT_NAMES
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile


def test_a_clip_is_cut_at_each_speed(make_clips: Callable[..., list[Clip]]) -> None:
    """4 s at 20 fps are 80 frames: played twice as fast, every fourth makes 10 fps; at half the
    speed, every one does."""
    (clip,) = make_clips(1, 1)
    n = clip.motion.n_frames
    config = WindowConfig(frames=8, fps_hz=10.0, speeds=(1.0, 2.0, 0.5))
    frames = make_training_set([clip], ModelConfig(input="axis-angle"), config).frames
    lengths = np.diff([0, *frames.ends]).tolist()
    every = [2, 2, 4, 4, 4, 4, 1]
    phases = [0, 1, 0, 1, 2, 3, 0]
    assert lengths == [len(range(at, n, step)) for at, step in zip(phases, every, strict=True)]
    for run, (at, step) in enumerate(zip(phases, every, strict=True)):
        pelvis_m = frames.pelvis_m[frames.rows(run)]
        np.testing.assert_array_equal(pelvis_m, clip.motion.pelvis_m[at::step])


def test_a_speed_that_would_need_more_frames_than_there_are_is_refused(
    make_clips: Callable[..., list[Clip]],
) -> None:
    config = WindowConfig(fps_hz=10.0, speeds=(0.4,))
    with pytest.raises(BadMotionFile, match="20 fps is lower than 25 fps"):
        make_training_set(make_clips(1, 1), ModelConfig(input="axis-angle"), config)
    for speeds in ((), (0.0,), (20.0,)):
        with pytest.raises(ValidationError, match="speeds"):
            WindowConfig(speeds=speeds)


def test_arms_and_head_come_from_the_next_window() -> None:
    rotmats = np.arange(3 * 4 * 23 * 9, dtype=np.float32).reshape(3, 4, 23, 3, 3)
    rng = np.random.default_rng(0)
    assert np.array_equal(with_exchanged_arms(rotmats, 0.0, rng), rotmats)
    exchanged = with_exchanged_arms(rotmats, 1.0, rng)
    for joint, name in enumerate(JOINT_NAMES[1:]):
        is_leg = any(part in name for part in ("hip", "knee", "ankle", "foot", "spine"))
        source = rotmats if is_leg else rotmats[[1, 2, 0]]
        np.testing.assert_array_equal(exchanged[:, :, joint], source[:, :, joint])
    some = with_exchanged_arms(np.repeat(rotmats, 100, axis=0), 0.3, rng)
    changed = (some != np.repeat(rotmats, 100, axis=0)).any((1, 2, 3, 4)).sum()
    assert changed <= 3, "only the last of each hundred has another neighbour"


def test_exchanged_arms_change_the_input_and_the_body_but_not_the_motion(
    make_clips: Callable[..., list[Clip]],
) -> None:
    plain = WindowConfig(frames=60)
    config = plain.model_copy(update={"exchange_probability": 1.0})
    training_set = make_training_set(make_clips(3, 1), ModelConfig(input="axis-angle"), plain)
    a, b = (make_batch(training_set, one, 4, seed=2, step=9) for one in (plain, config))
    assert torch.equal(a.motions.delta_m, b.motions.delta_m)
    assert not torch.equal(a.local_rotmats, b.local_rotmats)
    legs = [JOINT_NAMES.index(name) - 1 for name in ("left_hip", "right_knee", "spine3")]
    assert torch.equal(a.local_rotmats[:, :, legs], b.local_rotmats[:, :, legs])
    poses = b.poses.unflatten(-1, (23, 3))
    assert torch.allclose(poses[:, :, legs], a.poses.unflatten(-1, (23, 3))[:, :, legs], atol=1e-5)
    assert not torch.allclose(poses, a.poses.unflatten(-1, (23, 3)), atol=1e-2)
    assert poses[:, 40:].abs().max() == 0
