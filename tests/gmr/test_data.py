"""Windows: phases, gaps, padding, time reversal, and their dependence on seed and step alone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ModelConfig, Representation, WindowConfig
from gmrdata.gmr.flat_runs import TrainingRun
from gmrdata.gmr.rotations import to_rotmats
from gmrdata.gmr.runs import runs_at
from gmrdata.gmr.windows import Batch, make_batch, make_training_set, reverse
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadMotionFile
from gmrdata.values.motion import Motion, accumulate, deltas

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")


def counting_clip(n_frames: int, fps_hz: float, gaps: tuple[int, ...] = ()) -> Clip:
    """A clip whose pelvis is at x = the frame's number, so that a frame can be told by it."""
    valid = np.ones(n_frames, bool)
    valid[list(gaps)] = False
    motion = Motion(
        local_rotmats=np.tile(np.eye(3), (n_frames, 23, 1, 1)),
        root_rotmats=np.tile(np.eye(3), (n_frames, 1, 1)),
        pelvis_m=np.arange(n_frames)[:, None] * [1.0, 0.0, 0.0],
        shape=np.zeros(10),
        fps_hz=fps_hz,
        body="small",
        gender="neutral",
        frame="world",
        source="counted",
    )
    return Clip("counting", motion, valid, np.full(n_frames, -1), None)


def frame_numbers(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[list[float]]:
    runs = runs_at(clip, fps_hz, all_phases=all_phases)
    assert all(run.fps_hz == fps_hz for run in runs)
    return [run.pelvis_m[:, 0].tolist() for run in runs]


def test_a_higher_rate_gives_all_phases() -> None:
    assert frame_numbers(counting_clip(8, 30.0), 10.0, all_phases=True) == [
        [0, 3, 6],
        [1, 4, 7],
        [2, 5],
    ]
    assert frame_numbers(counting_clip(8, 30.0), 10.0, all_phases=False) == [[0, 3, 6]]
    assert frame_numbers(counting_clip(3, 10.0), 10.0, all_phases=True) == [[0, 1, 2]]


def test_no_run_crosses_a_gap() -> None:
    clip = counting_clip(20, 30.0, gaps=(7, 8, 12))
    assert frame_numbers(clip, 10.0, all_phases=True) == [
        [0, 3, 6],
        [1, 4],
        [2, 5],
        [13, 16, 19],
        [14, 17],
        [15, 18],
    ]


def test_a_ratio_that_is_not_whole_is_resampled_within_the_run() -> None:
    clip = counting_clip(31, 25.0, gaps=(10,))
    phases = frame_numbers(clip, 10.0, all_phases=True)
    expected = [[0.0, 2.5, 5.0, 7.5], [1.0, 3.5, 6.0, 8.5]]
    expected += [[11.0 + 2.5 * i for i in range(8)], [12.0 + 2.5 * i for i in range(8)]]
    expected[3] = [x for x in expected[3] if x <= 30]
    assert [len(phase) for phase in phases] == [len(phase) for phase in expected]
    for found, want in zip(phases, expected, strict=True):
        np.testing.assert_allclose(found, want, atol=1e-9)


def test_a_lower_rate_is_refused() -> None:
    with pytest.raises(BadMotionFile, match=r"clip counting: 5 fps is lower than 10 fps"):
        runs_at(counting_clip(8, 5.0), 10.0, all_phases=True)


@pytest.mark.parametrize("field", ["local_rotmats", "root_rotmats", "pelvis_m"])
def test_nan_in_a_valid_frame_is_refused(field: str) -> None:
    clip = counting_clip(9, 10.0, gaps=(2,))
    array = getattr(clip.motion, field).copy()
    array[2] = np.nan
    broken = replace(clip, motion=replace(clip.motion, **{field: array}))
    assert len(runs_at(broken, 10.0, all_phases=True)) == 2
    array[5] = np.inf
    with pytest.raises(BadMotionFile, match="clip counting: frame 5 holds NaN"):
        runs_at(broken, 10.0, all_phases=True)


def test_clips_without_two_frames_are_refused() -> None:
    with pytest.raises(BadManifest, match="none of the 1 training clips"):
        make_training_set([counting_clip(1, 10.0)], ModelConfig(), WindowConfig())


def test_training_in_all_phases_or_in_the_first() -> None:
    for all_phases, n_frames in ((True, [3, 3, 2]), (False, [3])):
        config = WindowConfig(all_phases=all_phases)
        training_set = make_training_set([counting_clip(8, 30.0)], ModelConfig(), config)
        assert np.diff(training_set.frames.ends, prepend=0).tolist() == n_frames


def test_bodies_do_not_mix() -> None:
    other = counting_clip(9, 10.0)
    other = replace(other, motion=replace(other.motion, body="large"))
    with pytest.raises(BadManifest, match="different bodies"):
        make_training_set([counting_clip(9, 10.0), other], ModelConfig(), WindowConfig())


def same(a: Batch, b: Batch) -> bool:
    return all(
        torch.equal(x, y)
        for x, y in (
            (a.poses, b.poses),
            (a.lengths, b.lengths),
            (a.mask, b.mask),
            (a.motions.delta_rotmats, b.motions.delta_rotmats),
            (a.motions.delta_m, b.motions.delta_m),
            (a.local_rotmats, b.local_rotmats),
            (a.shape, b.shape),
        )
    )


def local_rotmats_of(run: TrainingRun, representation: Representation) -> np.ndarray:
    values = torch.from_numpy(run.poses).unflatten(-1, (23, -1))
    return to_rotmats(values, representation).numpy()


def test_a_batch_depends_on_seed_and_step_alone(make_clips: Callable[..., list[Clip]]) -> None:
    config = WindowConfig(frames=12)
    training_set = make_training_set(make_clips(3, 1), ModelConfig(), config)
    batches = [make_batch(training_set, config, 4, seed=5, step=step) for step in range(4)]
    for step in (3, 1, 0, 2):
        assert same(make_batch(training_set, config, 4, seed=5, step=step), batches[step])
    assert not same(batches[0], batches[1])
    assert not same(batches[0], make_batch(training_set, config, 4, seed=6, step=0))


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_windows_are_rows_of_the_runs(
    make_clips: Callable[..., list[Clip]], representation: Representation
) -> None:
    """Each window's poses are found in one run, forwards or backwards, with that run's motion."""
    config = WindowConfig(frames=9, reverse_probability=0.5)
    training_set = make_training_set(make_clips(3, 2), ModelConfig(input=representation), config)
    runs = [training_set.window(i, slice(None)) for i in range(len(training_set.frames.ends))]
    batch = make_batch(training_set, config, 16, seed=0, step=0)
    directions = set()
    for row in range(16):
        pose = batch.local_rotmats[row].numpy()
        found = [
            (run, start, backwards)
            for run in runs
            for start in range(len(run.poses) - 8)
            for backwards, order in ((False, 1), (True, -1))
            if np.array_equal(
                local_rotmats_of(run, representation)[start : start + 9][::order], pose
            )
        ]
        assert len(found) == 1
        run, start, backwards = found[0]
        directions.add(backwards)
        rows = np.arange(start, start + 9)[:: -1 if backwards else 1]
        expected = deltas(run.root_rotmats[rows], run.pelvis_m[rows])
        np.testing.assert_allclose(batch.motions.delta_rotmats[row], expected[0], atol=1e-6)
        np.testing.assert_allclose(batch.motions.delta_m[row], expected[1], atol=1e-6)
        np.testing.assert_array_equal(batch.shape[row], run.shape)
    assert directions == {False, True}


def test_short_runs_are_padded_and_masked() -> None:
    config = WindowConfig(frames=6, reverse_probability=0.0)
    training_set = make_training_set([counting_clip(4, 10.0)], ModelConfig(), config)
    batch = make_batch(training_set, config, 2, seed=0, step=0)
    assert batch.lengths.tolist() == [4, 4]
    assert batch.mask.tolist() == [[True, True, True, False, False]] * 2
    assert batch.motions.delta_m[0, :, 0].tolist() == [1, 1, 1, 0, 0]
    assert torch.equal(batch.motions.delta_rotmats[0, 3:], torch.eye(3).expand(2, 3, 3))
    assert batch.poses[0, 4:].abs().max() == 0
    assert batch.poses[0, :4, ::4].min() == 1


def test_reversal_is_not_a_change_of_sign() -> None:
    """A quarter turn while walking: backwards, dT is -dR^T dT, which points elsewhere than -dT."""
    turn = Rotation.from_euler("z", [[0], [90]], degrees=True).as_matrix()
    run = TrainingRun(
        poses=np.zeros((2, 92), np.float32),
        root_rotmats=turn,
        pelvis_m=np.array([[0.0, 0, 0], [1.0, 0, 0]]),
        shape=np.zeros(10, np.float32),
    )
    backwards = reverse(run)
    delta_rotmats, delta_m = deltas(backwards.root_rotmats, backwards.pelvis_m)
    np.testing.assert_allclose(delta_rotmats[0], turn[1].T, atol=1e-12)
    np.testing.assert_allclose(delta_m[0], [0.0, 1.0, 0.0], atol=1e-12)
    again = accumulate(delta_rotmats, delta_m, backwards.root_rotmats[0], backwards.pelvis_m[0])
    np.testing.assert_allclose(again[0][::-1], run.root_rotmats, atol=1e-12)
    np.testing.assert_allclose(again[1][::-1], run.pelvis_m, atol=1e-12)


def test_quaternions_of_a_window_are_those_that_inference_makes() -> None:
    """A joint turns on and on, so its sign goes through both; a window begins with w >= 0."""
    clip = counting_clip(60, 10.0)
    local = clip.motion.local_rotmats.copy()
    local[:, 4] = Rotation.from_euler("x", 25 * np.arange(60)[:, None], degrees=True).as_matrix()
    clip = replace(clip, motion=replace(clip.motion, local_rotmats=local))
    config = WindowConfig(frames=10, reverse_probability=0.5)
    training_set = make_training_set([clip], ModelConfig(), config)
    assert training_set.window(0, slice(None)).poses[:, 16].min() < -0.9
    batch = make_batch(training_set, config, 64, seed=1, step=2)
    quaternions = batch.poses.reshape(64, 10, 23, 4)
    assert (quaternions[:, 0, :, 0] >= 0).all()
    assert ((quaternions[:, 1:] * quaternions[:, :-1]).sum(-1) > 0).all()
