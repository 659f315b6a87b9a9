"""The loop of a training, for any network: a batch in, a step of the optimiser, and a line of log.

Each step is seeded anew, so that a run that was stopped goes on bit for bit.  A run says of itself
`metrics.jsonl`, and TensorBoard's event files if wanted.

One training may have several processes, as `torchrun` starts them: one per GPU, or on CPUs.

    torchrun --nproc-per-node 4 -m gmrdata train manifest.yaml --out run

Each takes its part of a step's windows; the gradients are averaged, so that all have the same
weights at all times.  The first process alone writes.  All must see the same run folder.
"""

import atexit
import importlib
import json
import math
import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from gmrdata.gmr.checkpoint import (
    StepState,
    latest_checkpoint,
    load_optimizer,
    load_weights,
    save_step,
)
from gmrdata.gmr.config import StepsConfig
from gmrdata.stage.progress import progress_bar
from gmrdata.values.errors import MissingExtra, StageFailed, TrainingDiverged
from gmrdata.values.files import write_text

Log = Callable[[Mapping[str, float]], None]  # takes a line: `step`, and numbers by name

Batch = TypeVar("Batch")
Tensors = tuple[Tensor, ...] | list[Tensor]
AHEAD = 2  # batches that are ready or being made while a step is computed
PATIENCE = timedelta(hours=2)  # they wait for scores on held-out clips, which the first makes


@dataclass(frozen=True)
class Processes:
    """Which process this is, of how many."""

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:  # the one that writes
        return self.rank == 0


ALONE = Processes()


def check_device(device: str) -> None:
    if device == "cuda" and not torch.cuda.is_available():
        raise StageFailed(
            "no GPU here that torch can use. Give --device cpu, or device: cpu in the recipe"
        )


def join_processes(device: str) -> Processes:
    """Join the others that `torchrun` started, until this process ends; `ALONE` without it."""
    check_device(device)
    if not dist.is_torchelastic_launched():
        return ALONE
    # Once per process: a second group would find the first one's addresses and wait for ever.
    if not dist.is_initialized():
        if device == "cuda":
            torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
        # Imported later, as optimisers do, it would hold the group, whose threads then outlive it:
        # one that frees a tensor while Python ends aborts the process.
        importlib.import_module("torch._dynamo")
        dist.init_process_group("nccl" if device == "cuda" else "gloo", timeout=PATIENCE)
        atexit.register(dist.destroy_process_group)
    return Processes(dist.get_rank(), dist.get_world_size())


def in_all_processes(
    stage: Callable[[Callable[[Path], Any]], object],
    work: Callable[[Path], Any],
    processes: Processes,
) -> None:
    """Do a stage's work in all processes, in the folder that the first one's stage gives it."""
    if not processes.is_first:
        folder = _from_first(None, processes)
        if folder is not None:
            work(Path(folder))
        return
    told = []

    def work_of_first(partial_dir: Path) -> Any:
        told.append(_from_first(str(partial_dir), processes))
        return work(partial_dir)

    try:
        stage(work_of_first)
    finally:
        if not told:
            _from_first(None, processes)


def _from_first(value: str | None, processes: Processes) -> str | None:
    """What the first process says; the others' own value is not looked at."""
    values = [value]
    if processes.count > 1:
        dist.broadcast_object_list(values, src=0)
    return values[0]


def averaging(model: nn.Module, processes: Processes) -> nn.Module:
    """The network, with gradients that are averaged over the processes as they are made."""
    if processes.count == 1:
        return model
    # Without device_ids, inputs stay where they are: the lengths must stay on the CPU.
    return nn.parallel.DistributedDataParallel(model, broadcast_buffers=False)


def averaged(values: torch.Tensor, processes: Processes) -> torch.Tensor:
    if processes.count > 1:
        dist.all_reduce(values)
        values = values / processes.count
    return values


class Learner(ABC, Generic[Batch]):
    """A training, which begins with `done` steps.  Steps count from 0."""

    model: nn.Module

    def __init__(
        self, model: nn.Module, config: StepsConfig, run_dir: Path, processes: Processes = ALONE
    ) -> None:
        self.model = model.to(config.device)
        self.optimizer = torch.optim.Adam(self.model.parameters(), lr=config.learning_rate)
        self.run_dir, self.processes = run_dir, processes
        self.done = 0
        self._steps = config

    @abstractmethod
    def batch_of(self, step: int) -> Batch:
        """What a step learns from, by its number alone."""

    @abstractmethod
    def gradients(self, batch: Batch) -> dict[str, float]:
        """Fill them; gives the figures, `loss` and `gradient_norm` among them."""

    @abstractmethod
    def state(self, done: int) -> StepState:
        """What a kept step says of itself."""

    def more_weights(self) -> dict[str, dict[str, Tensor]]:
        """What is kept beside the network, by file: `writable` tensors."""
        return {}

    def rate_at(self, step: int) -> float:
        """Adam's step size in a step."""
        return self._steps.learning_rate

    def after(self, done: int, log: Log) -> None:
        """Keep the network after so many steps, where that is due."""
        if self.processes.is_first and is_due(done, self._steps.checkpoint_every, self._steps):
            kept = self.state(done), self.model, self.optimizer, self.more_weights()
            save_step(self.run_dir, *kept)

    def go_on_from(self, folder: Path, done: int) -> None:
        """Take the network and its optimiser from a checkpoint."""
        load_weights(folder, self.model)
        load_optimizer(folder, self.model, self.optimizer)
        self.done = done


def run_steps(learner: Learner[Batch], config: StepsConfig, *, tensorboard: bool = False) -> None:
    """Train; within `torch_settings`."""
    processes, run_dir, done = learner.processes, learner.run_dir, learner.done
    log_dir = run_dir if processes.is_first else None
    with progress_bar(shown=processes.is_first) as bar, run_log(log_dir, done, tensorboard) as log:
        task = bar.add_task("training", total=config.steps, completed=done)
        for step, batch in prefetched(learner.batch_of, range(done, config.steps)):
            now = step + 1
            torch.manual_seed(derived_seed(config.seed, now, processes.rank))
            values = learner.gradients(batch)
            check_finite(values, run_dir, now)
            for group in learner.optimizer.param_groups:
                group["lr"] = learner.rate_at(step)
            learner.optimizer.step()
            bar.update(task, advance=1, description=f"training  loss {values['loss']:.5f}")
            if is_due(now, config.log_every, config):
                log({"step": now} | values)
            learner.after(now, log)


def is_due(done: int, every: int, config: StepsConfig) -> bool:
    """Whether something that comes every so many steps, and after the last one, comes now."""
    return done % every == 0 or done == config.steps


def fill_gradients(
    network: nn.Module,
    terms: Callable[[], dict[str, Tensor]],
    longest: float | None,
    processes: Processes = ALONE,
) -> dict[str, float]:
    """Fill the gradients of a step: the mean over the processes.

    `terms` computes `loss`, which is minimised, and other scalars to log.  Gives them, and
    `gradient_norm`: the gradient's length before it is clipped to `longest`.
    """
    network.train()
    network.zero_grad(set_to_none=True)
    values = terms()
    values["loss"].backward()
    limit = math.inf if longest is None else longest
    values["gradient_norm"] = nn.utils.clip_grad_norm_(network.parameters(), limit)
    numbers = averaged(torch.stack([value.detach() for value in values.values()]), processes)
    return dict(zip(values, numbers.tolist(), strict=True))


@contextmanager
def torch_settings(device: str, threads: int, seed: int) -> Iterator[None]:
    """Seeded, with so many threads and, on the CPU, deterministic kernels; put back afterwards."""
    threads_before = torch.get_num_threads()
    deterministic = torch.are_deterministic_algorithms_enabled()
    with torch.random.fork_rng():
        try:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(device == "cpu")
            torch.manual_seed(seed)
            yield
        finally:
            torch.set_num_threads(threads_before)
            torch.use_deterministic_algorithms(deterministic)


def derived_seed(seed: int, counter: int, rank: int = 0) -> int:
    """A run's seed for its weights (counter 0) or a step (from 1), and for a process of several."""
    numbers = [seed, counter, rank] if rank else [seed, counter]
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


def start_average(model: nn.Module, decay: float) -> AveragedModel:
    """An exponential moving average of a network's weights (Polyak and Juditsky 1992)."""

    def update(averages: Tensors, values: Tensors, n_averaged: Tensor | int) -> None:
        get_ema_multi_avg_fn(decay_at(decay, int(n_averaged) - 1))(averages, values, n_averaged)

    average = AveragedModel(model, multi_avg_fn=update)
    # What the network begins with counts as the first value.
    average.n_averaged.fill_(1)
    return average.requires_grad_(False).eval()


def decay_at(decay: float, step: int) -> float:
    """Share that the average keeps in a step, counted from 0: at most (1 + step) / (10 + step)."""
    return min(decay, (1 + step) / (10 + step))


def check_finite(values: Mapping[str, float], run_dir: Path, step: int) -> None:
    if all(math.isfinite(value) for value in values.values()):
        return
    kept = latest_checkpoint(run_dir)
    raise TrainingDiverged(
        f"{run_dir}: in step {step} the loss is {values['loss']:g} and its gradient has length"
        f" {values['gradient_norm']:g}. The last good checkpoint: {kept.name if kept else 'none'}."
        " Lower learning_rate, or set gradient_norm, and pass --redo"
    )


def prefetched(make: Callable[[int], Batch], steps: Iterable[int]) -> Iterator[tuple[int, Batch]]:
    """Each step with its batch, made ahead in a thread; its error is raised when the step comes."""
    waiting: deque[tuple[int, Future[Batch]]] = deque()
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="batches") as thread:
        try:
            for step in steps:
                waiting.append((step, thread.submit(make, step)))
                if len(waiting) > AHEAD:
                    earlier, batch = waiting.popleft()
                    yield earlier, batch.result()
            for earlier, batch in waiting:
                yield earlier, batch.result()
        finally:
            for _, batch in waiting:
                batch.cancel()


@contextmanager
def run_log(run_dir: Path | None, done: int, tensorboard: bool) -> Iterator[Log]:
    """Go on with a run's log after `done` steps; what it has of later ones is cut off.

    The folder gets `metrics.jsonl` and, if wanted, `tensorboard`: event files, which hold times of
    day.  It is None for a process that is to say nothing.
    """
    if run_dir is None:
        yield lambda _: None
        return
    path = run_dir / "metrics.jsonl"
    lines = path.read_text("utf-8", "replace").splitlines() if path.is_file() else []
    # The process may have been killed in the middle of a line, which then is beyond the checkpoint.
    write_text(path, "".join(line + "\n" for line in lines if _line_step(line) <= done))
    with closing(_event_writer(run_dir, done)) if tensorboard else nullcontext() as writer:

        def log(values: Mapping[str, float]) -> None:
            with path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(values) + "\n")
            if writer is not None:
                for name in values.keys() - {"step"}:
                    writer.add_scalar(name, values[name], values["step"])

        yield log


def _line_step(line: str) -> float:
    try:
        return float(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return math.inf


def _event_writer(run_dir: Path, done: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise MissingExtra(
            f"{run_dir}: tensorboard: true, but tensorboard can't be imported ({error})."
            " pip install tensorboard, or set it to false: metrics.jsonl has the same numbers"
        ) from None
    # The viewer drops what a killed process wrote of steps that are now done again.
    return SummaryWriter(str(run_dir / "tensorboard"), purge_step=done + 1)
