"""The training loop: it learns, stops on infinities, and goes on as if never interrupted."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import jaxtyping
import numpy as np
import pytest
import torch

from gmrdata.gmr import loop
from gmrdata.gmr.checkpoint import BestScore, latest_checkpoint, read_best, read_model
from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.loop import fit, held_out_runs, held_out_scores, learning_rate_at
from gmrdata.gmr.predict import load_gmr
from gmrdata.gmr.runs import LazyClips, usable_files
from gmrdata.gmr.windows import make_batch
from gmrdata.values.errors import BadCheckpoint, BadManifest, StageFailed, TrainingDiverged
from gmrdata.values.files import write_json
from tests.clip_manifests import write_clips
from tests.clips_in_memory import counted_clips
from tests.folders import bytes_of
from tests.gmr.conftest import Training


def lines_of(run_dir: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (run_dir / "metrics.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("kind", ["chordal", "angular", "axis-angle"])
def test_it_overfits_one_window(training, kind):
    """One window, seen again and again: the loss falls to a small part, and so do its terms."""
    config = TrainConfig(
        model=ModelConfig(layers=1, hidden=32),
        loss=LossConfig.model_validate({"orientation_loss": kind, "n_vertices": 20}),
        windows=WindowConfig(frames=20, reverse_probability=0.0),
        learning_rate=1e-2,
        schedule="cosine",
        batch_size=1,
        steps=150,
        log_every=1,
    )
    clip = training.make_clips(1, 0, duration_s=2.0, fps_hz=10.0)
    fit(clip, [training.body], training.path, config)
    first, last = lines_of(training.path)[0], lines_of(training.path)[-1]
    assert last["step"] == 150
    assert last["loss"] < 0.06 * first["loss"]
    assert last["translation"] < 0.01 * first["translation"]


def test_held_out_scores_are_logged_and_change_nothing(training):
    clips = training.make_clips(2, 1)
    training.fit(clips, "a", training.make_clips(2, 2))
    training.fit(clips, "b")
    scored = [line for line in lines_of(training.path / "a") if "held_out_ome_deg" in line]
    assert [line["step"] for line in scored] == [4, 8, 12]
    a, b = bytes_of(training.path / "a"), bytes_of(training.path / "b")
    weights = "checkpoints/step_00000012/model.safetensors"
    assert a[weights] == b[weights]


def test_the_best_weights_are_those_of_the_lowest_score(training):
    """A step size that is too large, so that the best step is not the last one."""
    clips, held_out = training.make_clips(2, 1), training.make_clips(2, 2)
    training.fit(clips, "", held_out, eval_every=1, learning_rate=0.1, schedule="constant")
    name = "held_out_tme_mm"
    scores = {line["step"]: line[name] for line in lines_of(training.path) if name in line}
    step = min(scores, key=lambda step: (scores[step], step))
    assert step < 12
    folder = latest_checkpoint(training.path)
    assert folder is not None
    best = read_best(folder)
    assert best is not None
    assert best.score == BestScore(step=int(step), score=name, value=scores[step])
    runs = held_out_runs(held_out, [training.body], 10.0)
    found = held_out_scores(read_model(folder, "best"), runs, 10.0)
    assert found[name] == scores[step]
    assert load_gmr(training.path, "best").step == step
    assert load_gmr(training.path).step == 12


def test_held_out_runs_keep_none_of_the_clips(training, monkeypatch):
    """Every second row of a clip is looked at, and kept all of it."""
    manifest = write_clips(training.path / "set", training.body, training.make_clips(4, 2))
    in_memory, alive = counted_clips(monkeypatch)
    runs = held_out_runs(LazyClips(usable_files(manifest)[0]), [training.body], 10.0)
    assert len(runs) == len(in_memory) == 4
    assert max(in_memory) <= 2 and alive() == 0


def test_without_held_out_clips_there_are_no_best_weights(training):
    training.fit(training.make_clips(1, 1))
    with pytest.raises(BadCheckpoint, match="no best weights"):
        load_gmr(training.path, "best")


def test_bf16_is_close_and_keeps_float32_weights(training):
    losses = {}
    for precision in ("fp32", "bf16"):
        model = ModelConfig(layers=2, hidden=12)
        training.fit(training.make_clips(2, 1), precision, precision=precision, model=model)
        losses[precision] = [line["loss"] for line in lines_of(training.path / precision)]
        parameters = load_gmr(training.path / precision).model.parameters()
        assert {p.dtype for p in parameters} == {torch.float32}
    assert losses["bf16"] == pytest.approx(losses["fp32"], rel=0.05)
    assert losses["bf16"] != losses["fp32"]
    # Weights are float32, so 12 steps of 3e-3 are not lost in bfloat16's 8 bits.
    assert losses["bf16"][-1] < losses["bf16"][0]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="torch.compile needs a C++ compiler")
def test_compiling_changes_rounding_alone(training, monkeypatch):
    # The checks of shapes can't be traced.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    model = ModelConfig(layers=2, hidden=12, output="6d")
    for name, compiled in (("plain", False), ("compiled", True)):
        training.fit(training.make_clips(2, 1), name, steps=4, model=model, compile=compiled)
    plain, found = (lines_of(training.path / name) for name in ("plain", "compiled"))
    assert [line["loss"] for line in found] == pytest.approx(
        [line["loss"] for line in plain], rel=1e-5
    )
    load_gmr(training.path / "compiled")


def test_compiling_without_a_compiler_is_said(training, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(StageFailed, match="there is no no-such-compiler"):
        training.fit(training.make_clips(1, 1), compile=True)


def files_after_stops(
    training: Training, stops: tuple[int, ...], patches: pytest.MonkeyPatch, **changes: Any
) -> dict[str, bytes]:
    """A run's files, which are the same if it is stopped in the middle of any of these steps."""
    clips, held_out = training.make_clips(2, 1), training.make_clips(1, 2)
    training.fit(clips, "whole", held_out, **changes)
    expected = bytes_of(training.path / "whole")
    for stop in stops:

        def stopping(*args: object, stop: int = stop, **more: object) -> object:
            if args[-1] == stop:
                raise KeyboardInterrupt
            return make_batch(*args, **more)  # type: ignore[arg-type]

        run_dir = training.path / f"stopped_{stop}"
        run_dir.mkdir()
        with patches.context() as patch:
            patch.setattr(loop, "make_batch", stopping)
            with pytest.raises(KeyboardInterrupt):
                training.fit(clips, run_dir.name, held_out, **changes)
        with (run_dir / "metrics.jsonl").open("a") as stream:
            stream.write('{"step": 11, "lo')
        torch.manual_seed(stop)
        torch.rand(stop)
        training.fit(clips, run_dir.name, held_out, **changes)
        assert bytes_of(run_dir) == expected
    return expected


@pytest.mark.parametrize(("precision", "stops"), [("fp32", (0, 3, 5, 9, 11)), ("bf16", (9,))])
def test_k_steps_resumed_are_n_steps_bit_for_bit(training, monkeypatch, precision, stops):
    """Before, between and after checkpoints and log lines."""
    files = files_after_stops(training, stops, monkeypatch, precision=precision)
    assert "checkpoints/step_00000012/best.safetensors" in files


def test_another_seed_gives_other_weights(training):
    clips = training.make_clips(2, 1)
    training.fit(clips, "a")
    training.fit(clips, "b", seed=8)
    assert bytes_of(training.path / "a") != bytes_of(training.path / "b")


def test_global_torch_settings_are_left_alone(training):
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    threads = torch.get_num_threads()
    training.fit(training.make_clips(1, 1))
    assert torch.equal(torch.rand(3), expected)
    assert torch.get_num_threads() == threads
    assert not torch.are_deterministic_algorithms_enabled()


def test_divergence_keeps_the_last_good_checkpoint(training, monkeypatch):
    """From step 8 on a true motion is infinite, as in a broken clip."""

    def bursting(*args: object, **more: object) -> object:
        batch = make_batch(*args, **more)  # type: ignore[arg-type]
        if args[-1] >= 7:  # type: ignore[operator]
            batch.motions.delta_m[0, 0, 0] = np.inf
        return batch

    monkeypatch.setattr(loop, "make_batch", bursting)
    with pytest.raises(TrainingDiverged, match=r"in step 8 the loss is (inf|nan) .*step_00000005"):
        training.fit(training.make_clips(2, 1))
    gmr = load_gmr(training.path)
    assert gmr.step == 5
    assert all(torch.isfinite(p).all() for p in gmr.model.parameters())
    assert max(line["step"] for line in lines_of(training.path)) == 7


def test_a_step_size_that_is_far_too_large_diverges_and_says_so(training):
    wild = {"learning_rate": 1e30, "warmup_steps": 0, "gradient_norm": None}
    with pytest.raises(TrainingDiverged, match="checkpoint: none. Lower learning_rate"):
        training.fit(training.make_clips(2, 1), **wild)


def test_a_broken_or_foreign_checkpoint_stops_the_run(training):
    clips = training.make_clips(1, 1)
    training.fit(clips)
    with pytest.raises(BadCheckpoint, match="of another model"):
        training.fit(clips, model=ModelConfig(layers=1, hidden=13))
    with pytest.raises(BadCheckpoint, match="more steps than the 6 to train"):
        training.fit(clips, steps=6)
    folder = training.path / "checkpoints" / "step_00000012"
    state = json.loads((folder / "state.json").read_text())
    write_json(folder / "state.json", state | {"processes": 2})
    with pytest.raises(BadCheckpoint, match="made by 2 processes"):
        training.fit(clips)
    write_json(folder / "state.json", state)
    path = folder / "optimizer.safetensors"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(BadCheckpoint, match=r"optimizer\.safetensors: truncated"):
        training.fit(clips)


def test_clips_that_cannot_be_trained_on_are_refused(training):
    with pytest.raises(BadManifest, match="no usable clips"):
        training.fit([])
    clip = training.make_clips(1, 1)[0]
    other = replace(clip, motion=replace(clip.motion, body="giant"))
    with pytest.raises(BadManifest, match="clip gait_1_0: of body giant with 10"):
        training.fit([other])
    flicker = replace(clip, valid=np.arange(clip.motion.n_frames) % 2 == 0)
    with pytest.raises(BadManifest, match="none of the 1 held-out clips has two valid frames"):
        training.fit([clip], held_out=[flicker])
    shaken = replace(clip, motion=replace(clip.motion, frame="camera"))
    with pytest.raises(BadManifest, match="clip gait_1_0: its motion is in the camera's frame"):
        training.fit([shaken])


def test_a_missing_gpu_is_said(training, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(StageFailed, match="no GPU here"):
        training.fit(training.make_clips(1, 1), device="cuda")


def test_learning_rate():
    config = TrainConfig(learning_rate=1.0, schedule="cosine", warmup_steps=4, steps=100)
    rates = [learning_rate_at(config, step) for step in range(100)]
    assert rates[:3] == pytest.approx([0.25, 0.5, 0.75], rel=3e-3)
    assert rates[50] == pytest.approx(0.5)
    assert 0 < rates[99] < 1e-3
    assert learning_rate_at(TrainConfig(), 99_999) == 5e-5
