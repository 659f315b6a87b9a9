"""The training loop: windows in, weights out, exactly resumable.

Scores on held-out clips during training.
"""

import math
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import nn

from gmrdata.gmr.checkpoint import (
    Best,
    best_of,
    latest_checkpoint,
    load_optimizer,
    load_weights,
    read_best,
    read_state,
    save_checkpoint,
)
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.flat_runs import remove_files
from gmrdata.gmr.losses import Counts, LossTerms, Motions, counts_of, gmr_loss
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.parallel import ALONE, Processes, averaged, averaging, check_device, own_part
from gmrdata.gmr.predict import TrainedGmr, predict_deltas
from gmrdata.gmr.run_log import run_log
from gmrdata.gmr.runs import Run, fitting_clips, runs_at
from gmrdata.gmr.steps import (
    check_finite,
    derived_seed,
    prefetched,
    start_average,
    torch_settings,
    update_average,
)
from gmrdata.gmr.vertex_loss import Bodies, LossBody, make_loss_body
from gmrdata.gmr.windows import Batch, Mix, make_batch, make_training_set
from gmrdata.stage.progress import progress_bar, track
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadCheckpoint, BadManifest, StageFailed
from gmrdata.values.motion_deltas import deltas
from gmrdata.values.motion_metrics import orientation_errors_deg, translation_errors_mm


def held_out_runs(clips: Sequence[Clip], body: BodyModel, fps_hz: float) -> list[Run]:
    """What to score: the runs of valid frames of the held-out clips, first phase.

    Raises:
        BadManifest: there are clips, but none with two valid frames in a row, or not of this body.
        BadMotionFile: a clip holds NaN, or has a lower frame rate.
    """
    if not clips:
        return []
    fitting = fitting_clips(clips, body)
    runs = [run for clip in fitting for run in runs_at(clip, fps_hz, all_phases=False)]
    if not runs:
        raise BadManifest(
            f"none of the {len(clips)} held-out clips has two valid frames in a row at {fps_hz:g}"
            " fps. Give others, or none"
        )
    return runs


def held_out_scores(model: Gmr, runs: Sequence[Run], fps_hz: float) -> dict[str, float]:
    """OME and TME over all motions of the runs (eqs. 15, 16), with true local poses.

    Returns:
        `held_out_ome_deg` and `held_out_tme_mm`.
    """
    gmr = TrainedGmr(model.eval(), fps_hz, "(in training)", 0)
    angles_deg, lengths_mm = [], []
    for run in runs:
        predicted_rotmats, predicted_m = predict_deltas(gmr, run.motion.local_rotmats)
        true_rotmats, true_m = deltas(run.motion.root_rotmats, run.motion.pelvis_m)
        angles_deg.append(orientation_errors_deg(predicted_rotmats, true_rotmats))
        lengths_mm.append(translation_errors_mm(predicted_m, true_m))
    return {
        "held_out_ome_deg": float(np.concatenate(angles_deg).mean()),
        "held_out_tme_mm": float(np.concatenate(lengths_mm).mean()),
    }


def fit(
    clips: Sequence[Clip],
    body: BodyModel,
    run_dir: Path,
    config: TrainConfig,
    *,
    held_out: Sequence[Clip] = (),
    mix: Mix | None = None,
    pack_dir: Path | None = None,
    processes: Processes = ALONE,
) -> Gmr:
    """The training loop: goes on from the folder's latest checkpoint, or begins.

    Args:
        clips: What to train on.
        body: Their body.
        run_dir: Gets `checkpoints`, `metrics.jsonl` and, if wanted, `tensorboard`.
        config: The recipe.
        held_out: What to score now and then.
        mix: Which clips come from which manifest, and how often windows come from each.
        pack_dir: Folder for the training frames, used as it is if it is there, and removed when the
            training is done; None to keep them in memory.
        processes: Which of several processes this is.

    Returns:
        The network, with averaged weights if the recipe averages them.

    Raises:
        GmrdataError: as `gmrdata.gmr.train.train`.
    """
    check_device(config.device)
    training_set = make_training_set(
        track(fitting_clips(clips, body), "reading clips", total=len(clips)),
        config.model.input,
        config.windows,
        config.model.extra_inputs,
        mix=mix,
        pack_dir=pack_dir,
    )
    scored_runs = held_out_runs(held_out, body, config.windows.fps_hz)
    loss_body = make_loss_body(body, config.loss.n_vertices, config.device)
    batch_size = config.batch_size * processes.count
    extra = {
        "fps_hz": config.windows.fps_hz,
        "body": body.name,
        "processes": processes.count,
    }

    def batch_of(step: int) -> Batch:
        return make_batch(training_set, config.windows, batch_size, config.seed, step)

    settings = torch_settings(config.device, config.threads, derived_seed(config.seed, 0))
    with settings, progress_bar(shown=processes.is_first) as bar:
        model = Gmr(config.model).to(config.device)
        optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
        average = start_average(model) if config.average_decay > 0 else None
        used = model if average is None else average
        done, best = _resume(run_dir, config, model, optimizer, average, processes)
        network = averaging(_compiled(model, config), processes)
        task = bar.add_task("training", total=config.steps, completed=done)
        with run_log(run_dir if processes.is_first else None, done, config.tensorboard) as log:
            for step, batch in prefetched(batch_of, range(done, config.steps)):
                torch.manual_seed(derived_seed(config.seed, step + 1, processes.rank))
                values = gradient_step(network, batch, loss_body, config, processes)
                check_finite(values, run_dir, step + 1)
                for group in optimizer.param_groups:
                    group["lr"] = learning_rate_at(config, step)
                optimizer.step()
                bar.update(task, advance=1, description=f"training  loss {values['loss']:.5f}")

                if average is not None:
                    update_average(average, model, config.average_decay, step)
                now = step + 1
                is_last = now == config.steps
                if now % config.log_every == 0 or is_last:
                    log({"step": now} | values)
                if not processes.is_first:
                    continue
                if scored_runs and (now % config.eval_every == 0 or is_last):
                    scores = held_out_scores(used, scored_runs, config.windows.fps_hz)
                    best = best_of(best, now, config.best_by, scores[config.best_by], used)
                    log({"step": now} | scores)
                if now % config.checkpoint_every == 0 or is_last:
                    save_checkpoint(run_dir, now, model, optimizer, extra, best, average=average)
    if pack_dir is not None and processes.is_first:
        remove_files(pack_dir)
    return used


def gradient_step(
    network: nn.Module,
    batch: Batch,
    loss_body: LossBody,
    config: TrainConfig,
    processes: Processes = ALONE,
) -> dict[str, float]:
    """Fill the gradients of a step; its loss, terms, and the gradient's length before clipping.

    Args:
        network: The network, compiled or not, whose gradients are averaged over the processes.
        batch: The windows of all processes.
        loss_body: The body.
        config: The recipe.
        processes: Which of several processes this is.
    """
    network.train()
    network.zero_grad(set_to_none=True)
    counts = counts_of(batch.mask, processes.count)
    terms = batch_loss(network, own_part(batch, processes), loss_body, config, counts)
    terms.total.backward()
    limit = math.inf if config.gradient_norm is None else config.gradient_norm
    gradient_norm = nn.utils.clip_grad_norm_(network.parameters(), limit)
    values = {
        "loss": terms.total,
        "orientation": terms.orientation,
        "translation": terms.translation,
        "vertex": terms.vertex,
        "smoothness": terms.smoothness,
        "gradient_norm": gradient_norm,
    }
    numbers = averaged(torch.stack([value.detach() for value in values.values()]), processes)
    return dict(zip(values, numbers.tolist(), strict=True))


def batch_loss(
    network: nn.Module,
    batch: Batch,
    loss_body: LossBody,
    config: TrainConfig,
    counts: Counts | None = None,
) -> LossTerms:
    """Eq. 5 of a batch.

    Args:
        network: The network.
        batch: Windows.
        loss_body: The body.
        config: The recipe.
        counts: What means are over, if not over this batch alone.
    """
    device = config.device
    with torch.autocast(device, torch.bfloat16, enabled=config.precision == "bf16"):
        delta_rotmats, delta_m = network(batch.poses.to(device), batch.lengths)
    bodies = None
    if config.loss.vertex > 0:
        # T frames have T-1 motions, and eq. 13 moves the body from the first frame of each.
        local_rotmats = batch.local_rotmats[:, :-1].to(device)
        bodies = Bodies(loss_body, batch.shape.to(device), local_rotmats)
    return gmr_loss(
        Motions(delta_rotmats[:, :-1], delta_m[:, :-1]),
        Motions(batch.motions.delta_rotmats.to(device), batch.motions.delta_m.to(device)),
        batch.mask.to(device),
        bodies,
        config.loss,
        counts,
    )


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
    processes: Processes,
) -> tuple[int, Best | None]:
    """Load the latest checkpoint, if any: the number of steps done, and the best weights so far."""
    folder = latest_checkpoint(run_dir)
    if folder is None:
        return 0, None
    state = read_state(folder)
    done, count = int(state["step"]), state.get("processes", 1)
    if done > config.steps:
        raise BadCheckpoint(f"{folder}: has more steps than the {config.steps} to train")
    if count != processes.count:
        raise BadCheckpoint(
            f"{folder}: made by {count} processes, so a step has other windows than with"
            f" {processes.count}. Go on with as many, or train again"
        )
    load_weights(folder, model)
    if average is not None:
        load_weights(folder, average, "average")
    load_optimizer(folder, model, optimizer)
    return done, read_best(folder)


def _compiled(model: Gmr, config: TrainConfig) -> nn.Module:
    """The network, made by `torch.compile` if the recipe says so; the weights stay the model's.

    Raises:
        StageFailed: there is no compiler.
    """
    if not config.compile:
        return model
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        raise StageFailed(
            f"compile: true needs a C++ compiler, and there is no {compiler}. Install it, or set"
            " compile: false"
        )
    return cast(nn.Module, torch.compile(model))
