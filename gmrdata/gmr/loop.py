"""The training of a GMR: windows in, weights out, scores on held-out clips, exactly resumable."""

import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from gmrdata.gmr import checkpoint, steps
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.losses import Bodies, LossBody, Motions, counts_of, gmr_loss, make_loss_bodies
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import TrainedGmr, predict_deltas
from gmrdata.gmr.runs import (
    LazyClips,
    Mix,
    Split,
    fitting_clips,
    no_runs,
    runs_at,
    scored_files,
    split_manifests,
)
from gmrdata.gmr.steps import ALONE, Processes
from gmrdata.gmr.windows import Batch, TrainingSet, make_batch, make_training_set
from gmrdata.read.bodies import load_bodies
from gmrdata.stage.progress import remark, track
from gmrdata.values.body import BodyModel, names_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadCheckpoint, StageFailed
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.motion_metrics import orientation_errors_deg, translation_errors_mm


def fit_manifests(
    manifest_paths: Sequence[Path],
    run_dir: Path,
    config: TrainConfig,
    body_path: Path | str | None,
    held_out_paths: Sequence[Path],
    processes: Processes,
) -> Split:
    """Train on the clips of manifests, as `fit`; which clips they were.

    The training frames are files in the run's folder until the training is done.
    """
    split = split_manifests(manifest_paths, config.data)
    scored, not_scored = scored_files(held_out_paths, split)
    for statement in filter(None, (split.statement, not_scored)) if processes.is_first else ():
        remark(statement)
    bodies = load_bodies(body_path)
    pack_dir, clips = run_dir / "pack", LazyClips(split.training)
    try:
        training_set = _training_set(clips, bodies, config, split.mix, pack_dir / "frames")
        _fit(training_set, bodies, run_dir, config, LazyClips(scored), processes)
    finally:
        # Left alone after an error, it would be kept as a training that was begun.
        if processes.is_first:
            shutil.rmtree(pack_dir, ignore_errors=True)
    return split


def fit(
    clips: Sequence[Clip],
    bodies: Sequence[BodyModel],
    run_dir: Path,
    config: TrainConfig,
    *,
    held_out: Sequence[Clip] = (),
) -> Gmr:
    """Train a network: goes on from the folder's latest checkpoint, or begins; errors as `train`.

    Gives it with averaged weights if the recipe averages them.  Each clip is of one of the bodies,
    which have one mesh; eq. 13 takes its own.
    """
    steps.check_device(config.device)
    training_set = _training_set(clips, bodies, config)
    return _fit(training_set, bodies, run_dir, config, held_out, ALONE)


def _training_set(
    clips: Sequence[Clip],
    bodies: Sequence[BodyModel],
    config: TrainConfig,
    mix: Mix | None = None,
    pack_dir: Path | None = None,
) -> TrainingSet:
    fitting = track(fitting_clips(clips, bodies), "reading clips", total=len(clips))
    names = [body.name for body in bodies]
    return make_training_set(
        fitting, config.model, config.windows, mix=mix, bodies=names, pack_dir=pack_dir
    )


def _fit(
    training_set: TrainingSet,
    bodies: Sequence[BodyModel],
    run_dir: Path,
    config: TrainConfig,
    held_out: Sequence[Clip],
    processes: Processes,
) -> Gmr:
    scored_runs = held_out_runs(held_out, bodies, config.windows.fps_hz)
    loss_bodies = make_loss_bodies(bodies, config.loss.n_vertices, config.device)
    seed = steps.derived_seed(config.seed, 0)
    with steps.torch_settings(config.device, config.threads, seed):
        learner = _GmrLearner(training_set, scored_runs, loss_bodies, run_dir, config, processes)
        steps.run_steps(learner, config, tensorboard=config.tensorboard)
    return learner.used


class _GmrLearner(steps.Learner[Batch]):
    model: Gmr

    def __init__(
        self,
        training_set: TrainingSet,
        scored_runs: Sequence[Motion],
        loss_bodies: tuple[LossBody, ...],
        run_dir: Path,
        config: TrainConfig,
        processes: Processes,
    ) -> None:
        super().__init__(Gmr(config.model), config, run_dir, processes)
        self._training_set, self._scored_runs = training_set, scored_runs
        self._config, self._loss_bodies = config, loss_bodies
        decay = config.average_decay
        self.average = steps.start_average(self.model, decay) if decay > 0 else None
        self.best: checkpoint.Best | None = None
        self._resume()
        self._network = steps.averaging(_compiled(self.model, config), processes)

    @property
    def used(self) -> Gmr:
        """What is scored, and used in the end."""
        return self.model if self.average is None else cast(Gmr, self.average.module)

    def batch_of(self, step: int) -> Batch:
        config = self._config
        size = config.batch_size * self.processes.count
        return make_batch(self._training_set, config.windows, size, config.seed, step)

    def gradients(self, batch: Batch) -> dict[str, float]:
        return gradient_step(self._network, batch, self._loss_bodies, self._config, self.processes)

    def rate_at(self, step: int) -> float:
        return learning_rate_at(self._config, step)

    def state(self, done: int) -> checkpoint.GmrState:
        return checkpoint.GmrState(
            step=done,
            body=names_of(one.body for one in self._loss_bodies),
            model=self.model.config,
            fps_hz=self._config.windows.fps_hz,
            processes=self.processes.count,
            averaged=self.average is not None,
            best=None if self.best is None else self.best.score,
        )

    def more_weights(self) -> dict[str, dict[str, Tensor]]:
        more = {} if self.best is None else {"best": self.best.weights}
        if self.average is not None:
            more["average"] = checkpoint.writable(self.used.state_dict())
        return more

    def after(self, done: int, log: steps.Log) -> None:
        config = self._config
        if self.average is not None:
            self.average.update_parameters(self.model)
        is_scored = self._scored_runs and steps.is_due(done, config.eval_every, config)
        if self.processes.is_first and is_scored:
            scores = held_out_scores(self.used, self._scored_runs, config.windows.fps_hz)
            name = "held_out_tme_mm"
            self.best = checkpoint.best_of(self.best, done, name, scores[name], self.used)
            log({"step": done} | scores)
        super().after(done, log)

    def _resume(self) -> None:
        """Load the latest checkpoint, if any."""
        folder, config = checkpoint.latest_checkpoint(self.run_dir), self._config
        if folder is None:
            return
        state = checkpoint.read_state(folder)
        if state.step > config.steps:
            raise BadCheckpoint(f"{folder}: has more steps than the {config.steps} to train")
        if state.processes != self.processes.count:
            raise BadCheckpoint(
                f"{folder}: made by {state.processes} processes, so a step has other windows than"
                f" with {self.processes.count}. Go on with as many, or train again"
            )
        self.go_on_from(folder, state.step)
        if self.average is not None:
            checkpoint.load_weights(folder, self.used, "average")
            self.average.n_averaged.fill_(state.step + 1)
        self.best = checkpoint.read_best(folder)


def own_part(batch: Batch, processes: Processes) -> Batch:
    """This process's windows of a step's, of which each process has as many."""
    if processes.count == 1:
        return batch
    size = len(batch.poses) // processes.count
    rows = slice(processes.rank * size, (processes.rank + 1) * size)
    return Batch(*(getattr(batch, field.name)[rows] for field in fields(batch)))


def gradient_step(
    network: nn.Module,
    batch: Batch,
    loss_bodies: tuple[LossBody, ...],
    config: TrainConfig,
    processes: Processes = ALONE,
) -> dict[str, float]:
    """`fill_gradients` with eq. 5 of this process's part of the windows of all."""
    counts, part = counts_of(batch.mask, processes.count), own_part(batch, processes)
    device = config.device

    def terms() -> dict[str, Tensor]:
        with torch.autocast(device, torch.bfloat16, enabled=config.precision == "bf16"):
            delta_rotmats, delta_m = network(part.poses.to(device), part.lengths)
        predicted = Motions(delta_rotmats[:, :-1], delta_m[:, :-1])
        true, mask, bodies = part.motions.to(device), part.mask.to(device), None
        if config.loss.vertex > 0:
            # T frames have T-1 motions, and eq. 13 moves the body from the first frame of each.
            local_rotmats = part.local_rotmats[:, :-1].to(device)
            bodies = Bodies(loss_bodies, part.shape.to(device), local_rotmats, part.bodies)
        return gmr_loss(predicted, true, mask, bodies, config.loss, counts)

    return steps.fill_gradients(network, terms, config.gradient_norm, processes)


def learning_rate_at(config: TrainConfig, step: int) -> float:
    """Adam's step size in a step, counted from 0."""
    warmup = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    if config.schedule == "constant":
        return config.learning_rate * warmup
    return config.learning_rate * warmup * 0.5 * (1 + math.cos(math.pi * step / config.steps))


def held_out_runs(
    clips: Sequence[Clip], bodies: Sequence[BodyModel], fps_hz: float
) -> list[Motion]:
    """What to score: the runs of valid frames of the held-out clips, first phase."""
    if not clips:
        return []
    fitting = fitting_clips(clips, bodies)
    runs = [
        run.take(np.arange(run.n_frames))  # a copy: every k-th row alone would keep all of them
        for clip in fitting
        for run in runs_at(clip, fps_hz, all_phases=False)
    ]
    if not runs:
        raise no_runs(len(clips), "held-out", fps_hz, "Give others, or none")
    return runs


def held_out_scores(model: Gmr, runs: Sequence[Motion], fps_hz: float) -> dict[str, float]:
    """OME and TME over all motions of the runs (eqs. 15, 16), with true local poses."""
    gmr = TrainedGmr(model.eval(), fps_hz, "(in training)", 0)
    angles_deg, lengths_mm = [], []
    for run in runs:
        predicted_rotmats, predicted_m = predict_deltas(gmr, run.local_rotmats)
        true_rotmats, true_m = deltas(run.root_rotmats, run.pelvis_m)
        angles_deg.append(orientation_errors_deg(predicted_rotmats, true_rotmats))
        lengths_mm.append(translation_errors_mm(predicted_m, true_m))
    return {
        "held_out_ome_deg": float(np.concatenate(angles_deg).mean()),
        "held_out_tme_mm": float(np.concatenate(lengths_mm).mean()),
    }


def _compiled(model: Gmr, config: TrainConfig) -> nn.Module:
    """The network, made by `torch.compile` if the recipe says so; the weights stay the model's."""
    if not config.compile:
        return model
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        raise StageFailed(
            f"compile: true needs a C++ compiler, and there is no {compiler}. Install it, or set"
            " compile: false"
        )
    return cast(nn.Module, torch.compile(model))
