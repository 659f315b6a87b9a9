"""Resampling: exact on samples, slerp between them, never across a gap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.motion.resample import resample, resample_valid, slice_motion, valid_runs
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from tests.motions import random_motion


def _motion(n_frames: int, fps_hz: float) -> Motion:
    return random_motion(np.random.default_rng(0), n_frames, fps_hz=fps_hz)


@given(st.integers(2, 40), st.integers(1, 6), st.sampled_from([12.0, 30.0, 120.0, 59.94]))
def test_an_integer_ratio_takes_the_very_samples(n_frames, ratio, fps_hz):
    motion = _motion(n_frames, fps_hz)
    sampled = resample(motion, fps_hz / ratio)
    for name in ("local_rotmats", "root_rotmats", "pelvis_m"):
        np.testing.assert_array_equal(getattr(sampled, name), getattr(motion, name)[::ratio])
    assert sampled.fps_hz == fps_hz / ratio
    assert sampled.source == motion.source


def test_what_lies_between_valid_frames_is_valid():
    """A frame on a valid one is, whatever is beside that."""
    valid = np.array([1, 1, 0, 1, 1, 0, 1], dtype=bool)
    assert resample_valid(valid, 30.0, 10.0).tolist() == [True, True, True]
    halves = [1, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0, 1]
    assert resample_valid(valid, 30.0, 60.0).tolist() == list(map(bool, halves))


def test_a_start_on_a_sample_is_exact():
    motion = _motion(25, 120.0)
    sampled = resample(motion, 30.0, start_s=3 / 120)
    np.testing.assert_array_equal(sampled.root_rotmats, motion.root_rotmats[3::4])


@given(st.floats(7.0, 400.0), st.floats(0.0, 0.3))
def test_between_samples_it_is_slerp_and_lines(fps_hz, start_s):
    motion = _motion(13, 30.0)
    sampled = resample(motion, fps_hz, start_s=start_s)
    times_s = start_s + np.arange(sampled.n_frames) / fps_hz
    source_s = np.arange(13) / 30.0
    assert times_s[-1] <= source_s[-1] + 1e-6 < times_s[-1] + 1 / fps_hz + 1e-6
    times_s = np.clip(times_s, 0.0, source_s[-1])
    expected = Slerp(source_s, Rotation.from_matrix(motion.local_rotmats[:, 4]))(times_s)
    turned = expected.inv() * Rotation.from_matrix(sampled.local_rotmats[:, 4])
    assert turned.magnitude().max() < 1e-4  # sample times within 1e-6 of a frame snap to it
    for k in range(3):
        lines = np.interp(times_s, source_s, motion.pelvis_m[:, k])
        np.testing.assert_allclose(sampled.pelvis_m[:, k], lines, atol=1e-4)


def test_there_and_back_is_the_same_motion():
    motion = _motion(20, 10.0)
    back = resample(resample(motion, 70.0), 10.0)
    np.testing.assert_allclose(back.local_rotmats, motion.local_rotmats, atol=1e-12)


@given(st.lists(st.booleans(), max_size=30))
def test_valid_runs_are_the_runs(flags):
    runs = valid_runs(np.array(flags, dtype=bool))
    rebuilt = np.zeros(len(flags), dtype=bool)
    for start, stop in runs:
        assert start < stop
        assert not rebuilt[max(start - 1, 0) : stop].any()
        rebuilt[start:stop] = True
    assert rebuilt.tolist() == flags


def test_wrong_arguments():
    motion = _motion(10, 30.0)
    for fps_hz in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(BadRecipe, match="not positive"):
            resample(motion, fps_hz)
    for start_s in (-0.1, 0.31, np.nan):
        with pytest.raises(BadRecipe, match="outside a motion of 0.300 s"):
            resample(motion, 30.0, start_s=start_s)
    for start, stop in ((-1, 3), (3, 3), (0, 11)):
        with pytest.raises(BadRecipe, match="made up: frames"):
            slice_motion(motion, start, stop)
    np.testing.assert_array_equal(slice_motion(motion, 2, 5).pelvis_m, motion.pelvis_m[2:5])
