"""The training loop: it learns, stops on infinities, and goes on as if never interrupted."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadCheckpoint, BadManifest, StageFailed, TrainingDiverged
from gmrdata.gmr import loop
from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.data import make_batch, make_training_set
from gmrdata.gmr.infer import load_gmr
from gmrdata.gmr.loop import batch_loss, fit, learning_rate_at
from gmrdata.gmr.model import Gmr


def bytes_of(run_dir: Path) -> dict[str, bytes]:
    return {
        path.relative_to(run_dir).as_posix(): path.read_bytes()
        for path in sorted(run_dir.rglob("*"))
        if path.is_file()
    }


def lines_of(run_dir: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (run_dir / "metrics.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("kind", ["chordal", "angular", "axis-angle"])
def test_it_overfits_one_window(
    make_clips: Callable[..., list[Clip]], small_body: BodyModel, tmp_path: Path, kind: str
) -> None:
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
    clip = make_clips(1, 0, duration_s=2.0, fps_hz=10.0)
    fit(clip, small_body, tmp_path, config)
    first, last = lines_of(tmp_path)[0], lines_of(tmp_path)[-1]
    assert last["step"] == 150
    assert last["loss"] < 0.06 * first["loss"]
    assert last["translation"] < 0.01 * first["translation"]


def test_held_out_scores_are_logged_and_change_nothing(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    clips, held_out = make_clips(2, 1), make_clips(2, 2)
    fit(clips, small_body, tmp_path / "a", small_config, held_out=held_out)
    fit(clips, small_body, tmp_path / "b", small_config)
    scored = [line for line in lines_of(tmp_path / "a") if "held_out_ome_deg" in line]
    assert [line["step"] for line in scored] == [4, 8, 12]
    a, b = bytes_of(tmp_path / "a"), bytes_of(tmp_path / "b")
    weights = "checkpoints/step_00000012/model.safetensors"
    assert a[weights] == b[weights]


def test_k_steps_resumed_are_n_steps_bit_for_bit(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped in the middle of any step: before, between and after checkpoints and log lines."""
    clips, held_out = make_clips(2, 1), make_clips(1, 2)
    fit(clips, small_body, tmp_path / "whole", small_config, held_out=held_out)
    expected = bytes_of(tmp_path / "whole")
    make_batch = loop.make_batch
    for stop in (0, 3, 5, 9, 11):

        def stopping(*args: object, stop: int = stop, **more: object) -> object:
            if args[-1] == stop:
                raise KeyboardInterrupt
            return make_batch(*args, **more)  # type: ignore[arg-type]

        run_dir = tmp_path / f"stopped_{stop}"
        run_dir.mkdir()
        with monkeypatch.context() as patch:
            patch.setattr(loop, "make_batch", stopping)
            with pytest.raises(KeyboardInterrupt):
                fit(clips, small_body, run_dir, small_config, held_out=held_out)
        with (run_dir / "metrics.jsonl").open("a") as stream:
            stream.write('{"step": 11, "lo')
        torch.manual_seed(stop)
        torch.rand(stop)
        fit(clips, small_body, run_dir, small_config, held_out=held_out)
        assert bytes_of(run_dir) == expected


def test_another_seed_gives_other_weights(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    clips = make_clips(2, 1)
    fit(clips, small_body, tmp_path / "a", small_config)
    fit(clips, small_body, tmp_path / "b", small_config.model_copy(update={"seed": 8}))
    assert bytes_of(tmp_path / "a") != bytes_of(tmp_path / "b")


def test_global_torch_settings_are_left_alone(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    threads = torch.get_num_threads()
    fit(make_clips(1, 1), small_body, tmp_path, small_config)
    assert torch.equal(torch.rand(3), expected)
    assert torch.get_num_threads() == threads
    assert not torch.are_deterministic_algorithms_enabled()


def test_divergence_keeps_the_last_good_checkpoint(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From step 8 on a true motion is infinite, as in a broken clip."""
    make_batch = loop.make_batch

    def bursting(*args: object, **more: object) -> object:
        batch = make_batch(*args, **more)  # type: ignore[arg-type]
        if args[-1] >= 7:  # type: ignore[operator]
            batch.motions.metres[0, 0, 0] = np.inf
        return batch

    monkeypatch.setattr(loop, "make_batch", bursting)
    with pytest.raises(TrainingDiverged, match=r"in step 8 the loss is inf .*step_00000005"):
        fit(make_clips(2, 1), small_body, tmp_path, small_config)
    gmr = load_gmr(tmp_path)
    assert gmr.step == 5
    assert all(torch.isfinite(p).all() for p in gmr.model.parameters())
    assert max(line["step"] for line in lines_of(tmp_path)) == 7


def test_a_step_size_that_is_far_too_large_diverges_and_says_so(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    config = small_config.model_copy(
        update={"learning_rate": 1e30, "warmup_steps": 0, "gradient_norm": None}
    )
    with pytest.raises(TrainingDiverged, match="checkpoint: none. Lower learning_rate"):
        fit(make_clips(2, 1), small_body, tmp_path, config)


def test_a_broken_or_foreign_checkpoint_stops_the_run(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    clips = make_clips(1, 1)
    fit(clips, small_body, tmp_path, small_config)
    larger = small_config.model_copy(update={"model": ModelConfig(layers=1, hidden=13)})
    with pytest.raises(BadCheckpoint, match="of another model"):
        fit(clips, small_body, tmp_path, larger)
    with pytest.raises(BadCheckpoint, match="more steps than the 6 to train"):
        fit(clips, small_body, tmp_path, small_config.model_copy(update={"steps": 6}))
    path = tmp_path / "checkpoints" / "step_00000012" / "optimizer.safetensors"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(BadCheckpoint, match=r"optimizer\.safetensors: truncated"):
        fit(clips, small_body, tmp_path, small_config)


def test_clips_that_cannot_be_trained_on_are_refused(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    with pytest.raises(BadManifest, match="no usable clips"):
        fit([], small_body, tmp_path, small_config)
    clip = make_clips(1, 1)[0]
    other = replace(clip, motion=replace(clip.motion, body="giant"))
    with pytest.raises(BadManifest, match="clip gait_1_0: of body giant with 10"):
        fit([other], small_body, tmp_path, small_config)
    flicker = replace(clip, valid=np.arange(clip.motion.n_frames) % 2 == 0)
    with pytest.raises(BadManifest, match="none of the 1 held-out clips has two valid frames"):
        fit([clip], small_body, tmp_path, small_config, held_out=[flicker])
    shaken = replace(clip, motion=replace(clip.motion, frame="camera"))
    with pytest.raises(BadManifest, match="clip gait_1_0: its motion is in the camera's frame"):
        fit([shaken], small_body, tmp_path, small_config)


def test_bodies_posed_in_chunks_are_the_same(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    training_set = make_training_set(make_clips(3, 1), "quaternion", small_config.windows)
    batch = make_batch(training_set, small_config.windows, 5, seed=0, step=0)
    torch.manual_seed(0)
    model = Gmr(small_config.model).eval()
    n = len(small_body.template_m)
    whole = batch_loss(model, batch, small_body, n, small_config)
    monkeypatch.setattr(loop, "CHUNK_BYTES", 2 * 15 * n * 12 * 4)
    parts = batch_loss(model, batch, small_body, n, small_config)
    assert parts.vertex.item() == pytest.approx(whole.vertex.item(), rel=1e-6)
    assert whole.vertex.item() > 0.01


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_missing_gpu_is_said(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    with pytest.raises(StageFailed, match="no GPU here"):
        fit(
            make_clips(1, 1),
            small_body,
            tmp_path,
            small_config.model_copy(update={"device": "cuda"}),
        )


def test_learning_rate() -> None:
    config = TrainConfig(learning_rate=1.0, schedule="cosine", warmup_steps=4, steps=100)
    rates = [learning_rate_at(config, step) for step in range(100)]
    assert rates[:3] == pytest.approx([0.25, 0.5, 0.75], rel=3e-3)
    assert rates[50] == pytest.approx(0.5)
    assert 0 < rates[99] < 1e-3
    assert learning_rate_at(TrainConfig(), 99_999) == 5e-5
