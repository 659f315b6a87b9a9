"""The training loop: windows in, weights out, exactly resumable."""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gmrdata.body.forward import posed_vertices
from gmrdata.body.model import BodyModel
from gmrdata.body.subset import vertex_rows, with_vertices
from gmrdata.clip import Clip
from gmrdata.errors import BadCheckpoint, StageFailed, TrainingDiverged
from gmrdata.gmr.average import start_average, update_average
from gmrdata.gmr.checkpoint import (
    latest_checkpoint,
    load_optimizer,
    load_weights,
    read_state,
    save_checkpoint,
)
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.data import Batch, make_batch, make_training_set
from gmrdata.gmr.flat_runs import remove_files
from gmrdata.gmr.held_out import held_out_runs, held_out_scores
from gmrdata.gmr.losses import LossTerms, Motions, gmr_loss
from gmrdata.gmr.mixing import Mix
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.prefetch import prefetched
from gmrdata.gmr.usable import fitting_clips
from gmrdata.progress import progress_bar, track
from gmrdata.store import write_text

CHUNK_BYTES = 256 << 20
"""Memory that posing bodies may take at once."""


def fit(
    clips: Sequence[Clip],
    body: BodyModel,
    run_dir: Path,
    config: TrainConfig,
    *,
    held_out: Sequence[Clip] = (),
    mix: Mix | None = None,
    pack_dir: Path | None = None,
) -> Gmr:
    """The training loop: goes on from the folder's latest checkpoint, or begins.

    Args:
        clips: What to train on.
        body: Their body.
        run_dir: Gets `checkpoints` and `metrics.jsonl`.
        config: The recipe.
        held_out: What to score now and then.
        mix: Which clips come from which manifest, and how often windows come from each.
        pack_dir: Folder for the training frames, used as it is if it is there, and removed when the
            training is done; None to keep them in memory.

    Returns:
        The network, with averaged weights if the recipe averages them.

    Raises:
        GmrdataError: as `gmrdata.gmr.train.train`.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise StageFailed(f"{run_dir}: no GPU here that torch can use. Train with device: cpu")
    training_set = make_training_set(
        track(fitting_clips(clips, body), "reading clips", total=len(clips)),
        config.model.input,
        config.windows,
        config.model.extra_inputs,
        mix=mix,
        pack_dir=pack_dir,
    )
    scored_runs = held_out_runs(held_out, body, config.windows.fps_hz)
    rows = vertex_rows(len(body.template_m), config.loss.n_vertices)
    loss_body = with_vertices(body, rows)
    with _torch_settings(config), progress_bar() as bar:
        model = Gmr(config.model).to(config.device)
        optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
        average = start_average(model) if config.average_decay > 0 else None
        used = model if average is None else average
        done = _resume(run_dir, config, model, optimizer, average)
        task = bar.add_task("training", total=config.steps, completed=done)

        def batch_of(step: int) -> Batch:
            size = config.batch_size
            return make_batch(training_set, config.windows, size, config.seed, step)

        for step, batch in prefetched(batch_of, range(done, config.steps)):
            torch.manual_seed(_derived_seed(config.seed, step + 1))
            values = _backward(model, batch, loss_body, len(body.template_m), config)
            _check_finite(values, run_dir, step)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate_at(config, step)
            optimizer.step()
            if average is not None:
                update_average(average, model, config.average_decay, step)
            bar.update(task, advance=1, description=f"training  loss {values['loss']:.5f}")

            now = step + 1
            if now % config.log_every == 0 or now == config.steps:
                _log(run_dir, {"step": now} | values)
            if scored_runs and (now % config.eval_every == 0 or now == config.steps):
                scores = held_out_scores(used, scored_runs, config.windows.fps_hz)
                _log(run_dir, {"step": now} | scores)
            if now % config.checkpoint_every == 0 or now == config.steps:
                extra = {"fps_hz": config.windows.fps_hz, "body": body.name}
                save_checkpoint(run_dir, now, model, optimizer, extra, average=average)
    if pack_dir is not None:
        remove_files(pack_dir)
    return used


def _backward(
    model: Gmr, batch: Batch, loss_body: BodyModel, n_body_vertices: int, config: TrainConfig
) -> dict[str, float]:
    """Fill the gradients; the loss, its terms and the gradient's length before clipping."""
    model.train()
    model.zero_grad(set_to_none=True)
    terms = batch_loss(model, batch, loss_body, n_body_vertices, config)
    terms.total.backward()
    limit = math.inf if config.gradient_norm is None else config.gradient_norm
    gradient_norm = torch.nn.utils.clip_grad_norm_(model.parameters(), limit)
    return {
        "loss": terms.total.item(),
        "orientation": terms.orientation.item(),
        "translation": terms.translation.item(),
        "vertex": terms.vertex.item(),
        "smoothness": terms.smoothness.item(),
        "gradient_norm": gradient_norm.item(),
    }


def _check_finite(values: dict[str, float], run_dir: Path, step: int) -> None:
    """Stop before weights are touched by a step that has no finite loss or gradient."""
    if all(math.isfinite(value) for value in values.values()):
        return
    kept = latest_checkpoint(run_dir)
    raise TrainingDiverged(
        f"{run_dir}: in step {step + 1} the loss is {values['loss']:g} and its gradient has length"
        f" {values['gradient_norm']:g}. The last good checkpoint: {kept.name if kept else 'none'}."
        " Lower learning_rate, or set gradient_norm"
    )


def batch_loss(
    model: Gmr, batch: Batch, loss_body: BodyModel, n_body_vertices: int, config: TrainConfig
) -> LossTerms:
    """Eq. 5 of a batch.

    Args:
        model: The network.
        batch: Windows.
        loss_body: The body, with those vertices that the vertex term looks at.
        n_body_vertices: Vertices of the whole body.
        config: The recipe.
    """
    device = config.device
    delta_rotmats, delta_m = model(batch.poses.to(device), batch.lengths)
    vertices_m = _posed_vertices_m(loss_body, batch, device) if config.loss.vertex > 0 else None
    return gmr_loss(
        Motions(delta_rotmats[:, :-1], delta_m[:, :-1]),
        Motions(batch.motions.rotmats.to(device), batch.motions.metres.to(device)),
        batch.mask.to(device),
        vertices_m,
        n_body_vertices,
        config.loss,
    )


def _posed_vertices_m(loss_body: BodyModel, batch: Batch, device: str) -> Tensor:
    """Posed bodies of all frames but the last, (B, T-1, V, 3) [m], a few windows at a time.

    Skinning blends 12 numbers per vertex, four times the size of what comes out.
    """
    local_rotmats = batch.local_rotmats[:, :-1]
    window_bytes = local_rotmats.shape[1] * len(loss_body.template_m) * 12 * 4
    chunk = max(1, CHUNK_BYTES // window_bytes)
    with torch.no_grad():
        parts = [
            posed_vertices(
                loss_body,
                batch.shape[rows, None].to(device),
                local_rotmats[rows].to(device),
            )
            for rows in torch.arange(len(local_rotmats)).split(chunk)
        ]
    return torch.cat(parts)


def learning_rate_at(config: TrainConfig, step: int) -> float:
    """Adam's step size in a step, counted from 0."""
    warmup = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    if config.schedule == "constant":
        return config.learning_rate * warmup
    return config.learning_rate * warmup * 0.5 * (1 + math.cos(math.pi * step / config.steps))


def _resume(
    run_dir: Path,
    config: TrainConfig,
    model: Gmr,
    optimizer: torch.optim.Optimizer,
    average: Gmr | None,
) -> int:
    """Load the latest checkpoint, if any, and cut the metrics to it; the number of steps done."""
    folder = latest_checkpoint(run_dir)
    done = 0
    if folder is not None:
        done = int(read_state(folder)["step"])
        if done > config.steps:
            raise BadCheckpoint(f"{folder}: has more steps than the {config.steps} to train")
        load_weights(folder, model)
        if average is not None:
            load_weights(folder, average, averaged=True)
        load_optimizer(folder, model, optimizer)
    metrics_path = run_dir / "metrics.jsonl"
    lines = metrics_path.read_text("utf-8").splitlines() if metrics_path.is_file() else []
    # The process may have been killed in the middle of a line, which then is beyond the checkpoint.
    kept = [line for line in lines if _line_step(line) <= done]
    write_text(metrics_path, "".join(line + "\n" for line in kept))
    return done


def _line_step(line: str) -> float:
    try:
        return float(json.loads(line)["step"])
    except (json.JSONDecodeError, KeyError, TypeError):
        return math.inf


def _log(run_dir: Path, values: dict[str, Any]) -> None:
    with (run_dir / "metrics.jsonl").open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(values) + "\n")


def _derived_seed(seed: int, counter: int) -> int:
    return int(np.random.SeedSequence([seed, counter]).generate_state(1)[0])


@contextmanager
def _torch_settings(config: TrainConfig) -> Iterator[None]:
    """Seeded, with the recipe's threads and deterministic kernels; put back afterwards."""
    threads = torch.get_num_threads()
    deterministic = torch.are_deterministic_algorithms_enabled()
    with torch.random.fork_rng():
        try:
            torch.set_num_threads(config.threads)
            torch.use_deterministic_algorithms(config.device == "cpu")
            torch.manual_seed(_derived_seed(config.seed, 0))
            yield
        finally:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(deterministic)
