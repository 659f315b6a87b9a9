"""Windows and the runs that they are cut from, in memory and in mapped files."""

import shutil
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ModelConfig, Representation, WindowConfig
from gmrdata.gmr.flat_runs import (
    FlatRuns,
    PackRecord,
    TrainingRun,
    in_files,
    in_memory,
)
from gmrdata.gmr.model import network_input
from gmrdata.gmr.rotations import to_rotmats
from gmrdata.gmr.runs import Mix, runs_at
from gmrdata.gmr.windows import Batch, make_batch, make_training_set, reverse, sample_run
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecord
from gmrdata.values.files import read_json, write_json
from gmrdata.values.motion import accumulate, deltas, whole_ratio
from tests.motions import bare_clip, made_up

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")


def counting_clip(n_frames: int, fps_hz: float, gaps: tuple[int, ...] = ()) -> Clip:
    """A clip whose pelvis is at x = the frame's number, so that a frame can be told by it."""
    valid = np.ones(n_frames, bool)
    valid[list(gaps)] = False
    motion = made_up(
        np.tile(np.eye(3), (n_frames, 23, 1, 1)),
        np.tile(np.eye(3), (n_frames, 1, 1)),
        np.arange(n_frames)[:, None] * [1.0, 0.0, 0.0],
        fps_hz=fps_hz,
    )
    return bare_clip("counting", motion, valid)


def frame_numbers(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[list[float]]:
    runs = runs_at(clip, fps_hz, all_phases=all_phases)
    assert all(run.fps_hz == fps_hz for run in runs)
    return [run.pelvis_m[:, 0].tolist() for run in runs]


def test_a_higher_rate_gives_all_phases():
    assert frame_numbers(counting_clip(8, 30.0), 10.0, all_phases=True) == [
        [0, 3, 6],
        [1, 4, 7],
        [2, 5],
    ]
    assert frame_numbers(counting_clip(8, 30.0), 10.0, all_phases=False) == [[0, 3, 6]]
    assert frame_numbers(counting_clip(3, 10.0), 10.0, all_phases=True) == [[0, 1, 2]]


def test_a_rate_beyond_all_cameras_has_as_many_phases_as_frames():
    """Each of 1e12 phases was looked at."""
    assert frame_numbers(counting_clip(5, 1e13), 10.0, all_phases=True) == []
    assert whole_ratio(30.0, 1e-310) is None  # which overflowed


def test_no_run_crosses_a_gap():
    clip = counting_clip(20, 30.0, gaps=(7, 8, 12))
    assert frame_numbers(clip, 10.0, all_phases=True) == [
        [0, 3, 6],
        [1, 4],
        [2, 5],
        [13, 16, 19],
        [14, 17],
        [15, 18],
    ]


def test_a_ratio_that_is_not_whole_is_resampled_within_the_run():
    clip = counting_clip(31, 25.0, gaps=(10,))
    phases = frame_numbers(clip, 10.0, all_phases=True)
    expected = [[0.0, 2.5, 5.0, 7.5], [1.0, 3.5, 6.0, 8.5]]
    expected += [[11.0 + 2.5 * i for i in range(8)], [12.0 + 2.5 * i for i in range(8)]]
    expected[3] = [x for x in expected[3] if x <= 30]
    assert [len(phase) for phase in phases] == [len(phase) for phase in expected]
    for found, want in zip(phases, expected, strict=True):
        np.testing.assert_allclose(found, want, atol=1e-9)


def test_a_lower_rate_is_refused():
    with pytest.raises(BadMotionFile, match=r"clip counting: 5 fps is lower than 10 fps"):
        runs_at(counting_clip(8, 5.0), 10.0, all_phases=True)


@pytest.mark.parametrize("field", ["local_rotmats", "root_rotmats", "pelvis_m"])
def test_nan_in_a_valid_frame_is_refused(field):
    clip = counting_clip(9, 10.0, gaps=(2,))
    array = getattr(clip.motion, field).copy()
    array[2] = np.nan
    broken = replace(clip, motion=replace(clip.motion, **{field: array}))
    assert len(runs_at(broken, 10.0, all_phases=True)) == 2
    array[5] = np.inf
    with pytest.raises(BadMotionFile, match="clip counting: frame 5 holds NaN"):
        runs_at(broken, 10.0, all_phases=True)


def test_clips_without_two_frames_are_refused():
    with pytest.raises(BadManifest, match="none of the 1 training clips"):
        make_training_set([counting_clip(1, 10.0)], ModelConfig(), WindowConfig())


def test_training_in_all_phases_or_in_the_first():
    for all_phases, n_frames in ((True, [3, 3, 2]), (False, [3])):
        config = WindowConfig(all_phases=all_phases)
        training_set = make_training_set([counting_clip(8, 30.0)], ModelConfig(), config)
        assert np.diff(training_set.frames.ends, prepend=0).tolist() == n_frames


def test_bodies_do_not_mix():
    other = counting_clip(9, 10.0)
    other = replace(other, motion=replace(other.motion, body="large"))
    with pytest.raises(BadManifest, match="different bodies"):
        make_training_set([counting_clip(9, 10.0), other], ModelConfig(), WindowConfig())


def local_rotmats_of(run: TrainingRun, representation: Representation) -> np.ndarray:
    values = torch.from_numpy(run.poses).unflatten(-1, (23, -1))
    return to_rotmats(values, representation).numpy()


def test_a_batch_depends_on_seed_and_step_alone(make_clips):
    config = WindowConfig(frames=12)
    training_set = make_training_set(make_clips(3, 1), ModelConfig(), config)
    batches = [make_batch(training_set, config, 4, seed=5, step=step) for step in range(4)]
    for step in (3, 1, 0, 2):
        assert same(make_batch(training_set, config, 4, seed=5, step=step), batches[step])
    assert not same(batches[0], batches[1])
    assert not same(batches[0], make_batch(training_set, config, 4, seed=6, step=0))


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_windows_are_rows_of_the_runs(make_clips, representation):
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


def test_short_runs_are_padded_and_masked():
    config = WindowConfig(frames=6, reverse_probability=0.0)
    training_set = make_training_set([counting_clip(4, 10.0)], ModelConfig(), config)
    batch = make_batch(training_set, config, 2, seed=0, step=0)
    assert batch.lengths.tolist() == [4, 4]
    assert batch.mask.tolist() == [[True, True, True, False, False]] * 2
    assert batch.motions.delta_m[0, :, 0].tolist() == [1, 1, 1, 0, 0]
    assert torch.equal(batch.motions.delta_rotmats[0, 3:], torch.eye(3).expand(2, 3, 3))
    assert batch.poses[0, 4:].abs().max() == 0
    assert batch.poses[0, :4, ::4].min() == 1


def test_reversal_is_not_a_change_of_sign():
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


def test_quaternions_of_a_window_are_those_that_inference_makes():
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


PACK = PackRecord(input="quaternion", fps_hz=10.0)
OTHER_PACK = PackRecord(input="quaternion", fps_hz=20.0)


def random_runs(lengths: list[int], parts: list[int], seed: int = 0) -> Iterator[TrainingRun]:
    rng = np.random.default_rng(seed)
    for length, part in zip(lengths, parts, strict=True):
        yield TrainingRun(
            rng.normal(size=(length, 92)),
            rng.normal(size=(length, 3, 3)),
            rng.normal(size=(length, 3)),
            rng.normal(size=4),
            part,
        )


def same(a: Batch, b: Batch) -> bool:
    return all(map(torch.equal, tensors_of(a), tensors_of(b)))


def tensors_of(batch: Batch) -> list[torch.Tensor]:
    values = vars(batch) | vars(batch.motions)
    return [value for value in values.values() if isinstance(value, torch.Tensor)]


@pytest.mark.parametrize("representation", REPRESENTATIONS)
@pytest.mark.parametrize("weights", [None, (1.0, 2.5)])
def test_packed_and_unpacked_give_the_same_batches(make_clips, tmp_path, representation, weights):
    clips = make_clips(4, 1, duration_s=3.0)
    config = WindowConfig(frames=12)
    mix = Mix((3, 1), weights)
    unpacked = make_training_set(clips, ModelConfig(input=representation), config, mix=mix)
    packed = make_training_set(
        clips, ModelConfig(input=representation), config, mix=mix, pack_dir=tmp_path / "pack"
    )
    assert isinstance(packed.frames.poses, np.memmap)
    assert not isinstance(unpacked.frames.poses, np.memmap)
    for step in range(6):
        batches = [make_batch(one, config, 5, seed=3, step=step) for one in (packed, unpacked)]
        for a, b in zip(*map(tensors_of, batches), strict=True):
            assert a.dtype == b.dtype and torch.equal(a, b)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_frames_are_those_of_the_clip(make_clips, representation):
    (clip,) = make_clips(1, 2, fps_hz=10.0)
    config = WindowConfig(frames=clip.motion.n_frames, reverse_probability=0.0)
    training_set = make_training_set([clip], ModelConfig(input=representation), config)
    run = training_set.window(0, slice(None))
    assert len(training_set.frames.ends) == 1
    local_rotmats = make_batch(training_set, config, 1, seed=0, step=0).local_rotmats[0].numpy()
    np.testing.assert_allclose(local_rotmats, clip.motion.local_rotmats, atol=1e-6)
    assert local_rotmats.dtype == np.float32
    np.testing.assert_array_equal(run.root_rotmats, clip.motion.root_rotmats)
    np.testing.assert_array_equal(run.pelvis_m, clip.motion.pelvis_m)
    expected = network_input(torch.from_numpy(clip.motion.local_rotmats), representation)
    np.testing.assert_array_equal(run.poses, expected.float().numpy())


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lengths=st.lists(st.integers(2, 40), min_size=1, max_size=6), seed=st.integers(0, 99))
def test_files_hold_what_memory_holds(tmp_path, lengths, seed):
    parts = sorted(np.random.default_rng(seed).integers(0, 3, len(lengths)).tolist())
    folder = tmp_path / f"pack_{seed}_{'_'.join(map(str, lengths))}"
    files = in_files(random_runs(lengths, parts, seed), folder, PACK)
    memory = in_memory(random_runs(lengths, parts, seed))
    for name in ("poses", "root_rotmats", "pelvis_m", "shapes", "parts", "ends"):
        a, b = getattr(files, name), getattr(memory, name)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    assert [memory.rows(run) for run in range(len(lengths))] == [
        slice(end - length, end) for end, length in zip(np.cumsum(lengths), lengths, strict=True)
    ]


def test_a_pack_is_made_once_and_as_a_whole(tmp_path):
    folder = tmp_path / "pack"

    def stopping() -> Iterator[TrainingRun]:
        yield from random_runs([5], [0])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_files(stopping(), folder, PACK)
    assert not folder.exists()
    first = in_files(random_runs([5, 6], [0, 0]), folder, PACK)
    # Found there: the runs are not looked at.
    again = in_files(stopping(), folder, PACK)
    np.testing.assert_array_equal(first.poses, again.poses)
    assert len(in_files(random_runs([7], [0]), folder, OTHER_PACK).poses) == 7
    poses, parts = (folder / f"{name}.npy" for name in ("poses", "parts"))
    whole = poses.read_bytes()
    for content in (whole[:-8], b"", b"\x93NUMPY\x01\x00\x02\x00{\n"):
        poses.write_bytes(content)
        with pytest.raises(BadRecord, match="Remove it, and it is made again"):
            in_files(random_runs([7], [0]), folder, OTHER_PACK)
    poses.write_bytes(whole)
    np.save(parts, np.zeros(2, np.int64))
    with pytest.raises(BadRecord, match="its arrays don't fit together. Remove it"):
        in_files(random_runs([7], [0]), folder, OTHER_PACK)
    shutil.rmtree(folder)
    assert list(tmp_path.iterdir()) == []


def test_a_pack_whose_record_lacks_a_key_is_made_anew(tmp_path):
    folder = tmp_path / "pack"
    for n, key in enumerate(("format", "input", "fps_hz"), start=5):
        in_files(random_runs([3], [0]), folder, PACK)
        record = read_json(folder / "pack.json")
        del record[key]
        write_json(folder / "pack.json", record)
        assert len(in_files(random_runs([n], [0]), folder, PACK).poses) == n
        assert read_json(folder / "pack.json")[key] == PACK.model_dump(mode="json")[key]
        shutil.rmtree(folder)


def test_memory_is_bounded(tmp_path):
    """100,000 frames, 37 MB of poses, go through far less memory."""
    tracemalloc.start()
    runs = (run for n in range(100) for run in random_runs([1000], [0], n))
    flat = in_files(runs, tmp_path / "pack", PACK)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(flat.poses) == 100_000
    assert peak_bytes < 8e6


def runs_of(lengths: list[int], parts: list[int]) -> FlatRuns:
    return in_memory(random_runs(lengths, parts))


def test_runs_are_drawn_by_frames_or_by_weight_first():
    runs = runs_of([10, 30, 40, 20], [0, 0, 1, 2])

    def shares(weights: tuple[float, ...] | None) -> np.ndarray:
        rng = np.random.default_rng(0)
        drawn = [sample_run(runs, weights, rng) for _ in range(20_000)]
        return np.bincount(drawn, minlength=4) / len(drawn)

    np.testing.assert_allclose(shares(None), [0.1, 0.3, 0.4, 0.2], atol=0.02)
    # Weights 1 : 1 : 2; within the first manifest by frames, 1 : 3.
    np.testing.assert_allclose(shares((0.5, 0.5, 1.0)), [0.25 / 4, 0.75 / 4, 0.25, 0.5], atol=0.02)


def test_without_weights_the_draws_are_those_of_all_frames():
    runs = runs_of([10, 30, 40], [0, 1, 1])
    for seed in range(50):
        frame = np.random.default_rng(seed).integers(80)
        expected = int(np.searchsorted([10, 40, 80], frame, side="right"))
        assert sample_run(runs, None, np.random.default_rng(seed)) == expected


@given(
    weights=st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=4), seed=st.integers(0, 2**32 - 1)
)
def test_any_weights_draw_a_run(weights, seed):
    n = len(weights)
    runs = runs_of([3] * 2 * n, sorted([*range(n), *range(n)]))
    assert 0 <= sample_run(runs, weights, np.random.default_rng(seed)) < 2 * n


def test_a_weight_without_windows_is_refused(make_clips):
    clips: list[Any] = make_clips(1, 1)
    mix = Mix((1, 0), (1.0, 1.0), ("a.yaml", "b.yaml"))
    with pytest.raises(BadManifest, match=r"manifest b\.yaml has a weight, but no clip of it"):
        make_training_set(clips, ModelConfig(), WindowConfig(), mix=mix)
    unweighted = Mix((1, 0), None, ("a.yaml", "b.yaml"))
    assert make_training_set(clips, ModelConfig(), WindowConfig(), mix=unweighted).weights is None


def test_people_are_balanced_within_their_manifest():
    """16 and 1 windows of two people of one manifest, by their roots: 4 to 1; as many as before of
    another one."""
    n_frames = np.array([1600, 100, 0, 850])
    mix = Mix((3, 1, 1, 2), None, (), (0, 0, 0, 1), 0.5)
    shares = np.array(mix.shares(n_frames))
    np.testing.assert_allclose(shares / shares[1], [4.0, 1.0, 0.0, 2.5])
    weighed = np.array(replace(mix, weights=(1.0, 3.0)).shares(n_frames))
    np.testing.assert_allclose(weighed, [0.8, 0.2, 0.0, 3.0])
    assert replace(mix, balance=1.0).shares(n_frames) is None
