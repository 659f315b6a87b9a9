"""What the loop of any training does, and the moving average of weights."""

import json
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.gmr.checkpoint import checkpoint_dir, load_weights
from gmrdata.gmr.config import ModelConfig, TrainConfig
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import load_gmr
from gmrdata.gmr.steps import AHEAD, decay_at, prefetched, run_log, start_average
from gmrdata.values.errors import BadCheckpoint, MissingExtra
from tests.gmr.test_loop import files_after_stops


def test_steps_come_in_order_with_their_batches():
    made: list[int] = []

    def make(step: int) -> int:
        made.append(step)
        return step * step

    steps = range(3, 40)
    assert list(prefetched(make, steps)) == [(step, step * step) for step in steps]
    assert made == list(steps)
    assert list(prefetched(make, range(0))) == []


def test_no_more_are_made_than_needed_soon():
    made: list[int] = []
    seen = []
    for step, _ in prefetched(made.append, range(20)):
        time.sleep(0.002)
        seen.append(step)
        assert len(made) <= step + 1 + AHEAD
    assert seen == list(range(20))


def test_the_next_is_made_while_one_is_used():
    """Each step waits for the next step's batch, which only a maker beside it can make."""
    made = [threading.Event() for _ in range(30)]

    for step, _ in prefetched(lambda step: made[step].set(), range(30)):
        assert made[min(step + 1, 29)].wait(timeout=30), f"nobody makes step {step + 1}"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_is_raised_at_its_step(error):
    def make(step: int) -> int:
        if step == 5:
            raise error
        return step

    seen = []
    with pytest.raises(error):
        for step, _ in prefetched(make, range(10)):
            seen.append(step)
    assert seen == [0, 1, 2, 3, 4]


def test_a_loop_that_ends_early_leaves_no_thread():
    before = threading.active_count()
    batches = prefetched(lambda step: step, range(100))
    assert next(batches) == (0, 0)
    batches.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before


def steps_of(run_dir: Path) -> list[int]:
    return [json.loads(line)["step"] for line in (run_dir / "metrics.jsonl").open()]


def test_lines_beyond_the_checkpoint_are_cut(tmp_path):
    with run_log(tmp_path, 0, False) as log:
        for step in range(1, 6):
            log({"step": step, "loss": 0.5})
    with (tmp_path / "metrics.jsonl").open("ab") as stream:
        stream.write(b'{"step": "two"}\n\xff\xfe\x00\n{"step": 6, "lo')
    with run_log(tmp_path, 3, False) as log:
        log({"step": 4, "loss": 0.25})
    assert steps_of(tmp_path) == [1, 2, 3, 4]


def test_a_process_that_is_to_say_nothing_writes_nothing(tmp_path):
    with run_log(None, 0, True) as log:
        log({"step": 1, "loss": 0.5})
    assert list(tmp_path.iterdir()) == []


def test_missing_tensorboard_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(MissingExtra, match=r"pip install tensorboard"), run_log(tmp_path, 0, True):
        pass


def test_event_files_have_the_lines_numbers(tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with run_log(tmp_path, 0, True) as log:
        for step in (1, 2, 3):
            log({"step": step, "loss": 0.5 / step})
    with run_log(tmp_path, 2, True) as log:
        log({"step": 3, "loss": 7.0})
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    found = [(event.step, event.value) for event in events.Scalars("loss")]
    assert found == [(1, 0.5), (2, 0.25), (3, 7.0)]


@pytest.fixture
def small_config(small_config) -> TrainConfig:
    windows = small_config.windows.model_copy(
        update={"mirror_probability": 0.5, "pose_noise_deg": 2.0, "pose_noise_time_s": 0.2}
    )
    model = small_config.model.model_copy(update={"extra_inputs": ("velocity", "standing")})
    return small_config.model_copy(
        update={"average_decay": 0.8, "windows": windows, "model": model}
    )


def test_it_is_the_weighted_sum_of_the_steps():
    torch.manual_seed(0)
    model = Gmr(ModelConfig(layers=1, hidden=3))
    average = start_average(model, 0.7)
    weight = model.regression.weight
    expected = weight.detach().double().numpy().copy()
    for step in range(40):
        with torch.no_grad():
            weight.add_(torch.randn(weight.shape))
        average.update_parameters(model)
        share = min(0.7, (1 + step) / (10 + step))
        assert decay_at(0.7, step) == share
        expected = share * expected + (1 - share) * weight.detach().double().numpy()
    np.testing.assert_allclose(average.module.regression.weight, expected, atol=1e-5)
    assert not average.training
    assert not any(p.requires_grad for p in average.parameters())
    assert torch.equal(average.module.projection.weight, model.projection.weight)


def test_the_average_is_what_is_used_and_training_goes_on_from_the_weights(training):
    clips = training.make_clips(2, 1)
    used = training.fit(clips, "a")
    training.fit(clips, "b", average_decay=0.0)
    a, b = checkpoint_dir(training.path / "a", 12), checkpoint_dir(training.path / "b", 12)
    for name in ("model.safetensors", "optimizer.safetensors"):
        assert (a / name).read_bytes() == (b / name).read_bytes()
    assert not (b / "average.safetensors").exists()
    loaded, trained = load_gmr(training.path / "a").model, load_gmr(training.path / "b").model
    for name, tensor in used.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], tensor)
        assert not torch.equal(trained.state_dict()[name], tensor)


def test_n_steps_are_k_resumed_and_the_rest_bit_for_bit(training, monkeypatch):
    """With every augmentation, extra input and the average: stopped at any step."""
    files = files_after_stops(training, (3, 5, 11), monkeypatch)
    assert any("average" in name for name in files)


def test_a_checkpoint_that_lost_its_average_is_refused(training):
    clips = training.make_clips(1, 1)
    training.fit(clips)
    folder = checkpoint_dir(training.path, 12)
    assert json.loads((folder / "state.json").read_text())["averaged"] is True
    path = folder / "average.safetensors"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(BadCheckpoint, match=r"average\.safetensors: truncated"):
        load_gmr(training.path)
    path.unlink()
    with pytest.raises(BadCheckpoint, match=r"average\.safetensors: truncated, missing"):
        load_gmr(training.path)
    with pytest.raises(BadCheckpoint, match=r"average\.safetensors"):
        training.fit(clips, steps=20)
    load_weights(folder, Gmr(training.config.model))
