"""Runs end to end, in memory and in mapped files: the same batches, bit for bit."""

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gmrdata.gmr.config import ModelConfig, Representation, WindowConfig
from gmrdata.gmr.flat_runs import (
    FlatRuns,
    PackRecord,
    TrainingRun,
    in_files,
    in_memory,
    remove_files,
)
from gmrdata.gmr.model import network_input
from gmrdata.gmr.runs import Mix
from gmrdata.gmr.windows import Batch, make_batch, make_training_set, sample_run
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadRecord
from gmrdata.values.files import read_json, write_json

PACK = PackRecord(input="quaternion", fps_hz=10.0)
OTHER_PACK = PackRecord(input="quaternion", fps_hz=20.0)
REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")


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


def tensors_of(batch: Batch) -> list[torch.Tensor]:
    motions = batch.motions
    return [
        batch.poses,
        batch.lengths,
        batch.mask,
        motions.delta_rotmats,
        motions.delta_m,
        batch.local_rotmats,
        batch.shape,
    ]


@pytest.mark.parametrize("representation", REPRESENTATIONS)
@pytest.mark.parametrize("weights", [None, (1.0, 2.5)])
def test_packed_and_unpacked_give_the_same_batches(
    make_clips: Callable[..., list[Clip]],
    tmp_path: Path,
    representation: Representation,
    weights: tuple[float, float] | None,
) -> None:
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
def test_frames_are_those_of_the_clip(
    make_clips: Callable[..., list[Clip]], representation: Representation
) -> None:
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
def test_files_hold_what_memory_holds(tmp_path: Path, lengths: list[int], seed: int) -> None:
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


def test_a_pack_is_made_once_and_as_a_whole(tmp_path: Path) -> None:
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
    (folder / "poses.npy").write_bytes((folder / "poses.npy").read_bytes()[:-8])
    with pytest.raises(BadRecord, match="Remove it, and it is made again"):
        in_files(random_runs([7], [0]), folder, OTHER_PACK)
    remove_files(folder)
    assert list(tmp_path.iterdir()) == []


def test_a_pack_whose_record_lacks_a_key_is_made_anew(tmp_path: Path) -> None:
    folder = tmp_path / "pack"
    for n, key in enumerate(("format", "input", "fps_hz"), start=5):
        in_files(random_runs([3], [0]), folder, PACK)
        record = read_json(folder / "pack.json")
        del record[key]
        write_json(folder / "pack.json", record)
        assert len(in_files(random_runs([n], [0]), folder, PACK).poses) == n
        assert read_json(folder / "pack.json")[key] == PACK.model_dump(mode="json")[key]
        remove_files(folder)


def test_memory_is_bounded(tmp_path: Path) -> None:
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


def test_runs_are_drawn_by_frames_or_by_weight_first() -> None:
    runs = runs_of([10, 30, 40, 20], [0, 0, 1, 2])

    def shares(weights: tuple[float, ...] | None) -> np.ndarray:
        rng = np.random.default_rng(0)
        drawn = [sample_run(runs, weights, rng) for _ in range(20_000)]
        return np.bincount(drawn, minlength=4) / len(drawn)

    np.testing.assert_allclose(shares(None), [0.1, 0.3, 0.4, 0.2], atol=0.02)
    # Weights 1 : 1 : 2; within the first manifest by frames, 1 : 3.
    np.testing.assert_allclose(shares((0.5, 0.5, 1.0)), [0.25 / 4, 0.75 / 4, 0.25, 0.5], atol=0.02)


def test_without_weights_the_draws_are_those_of_all_frames() -> None:
    runs = runs_of([10, 30, 40], [0, 1, 1])
    for seed in range(50):
        frame = np.random.default_rng(seed).integers(80)
        expected = int(np.searchsorted([10, 40, 80], frame, side="right"))
        assert sample_run(runs, None, np.random.default_rng(seed)) == expected


@given(
    weights=st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=4), seed=st.integers(0, 2**32 - 1)
)
def test_any_weights_draw_a_run(weights: list[float], seed: int) -> None:
    n = len(weights)
    runs = runs_of([3] * 2 * n, sorted([*range(n), *range(n)]))
    assert 0 <= sample_run(runs, weights, np.random.default_rng(seed)) < 2 * n


def test_a_weight_without_windows_is_refused(make_clips: Callable[..., list[Clip]]) -> None:
    clips: list[Any] = make_clips(1, 1)
    mix = Mix((1, 0), (1.0, 1.0), ("a.yaml", "b.yaml"))
    with pytest.raises(BadManifest, match=r"manifest b\.yaml has a weight, but no clip of it"):
        make_training_set(clips, ModelConfig(), WindowConfig(), mix=mix)
    unweighted = Mix((1, 0), None, ("a.yaml", "b.yaml"))
    assert make_training_set(clips, ModelConfig(), WindowConfig(), mix=unweighted).weights is None
