"""The loop of a training, for any network: a batch in, a step of the optimiser, and a line of log.

Each step is seeded anew, so that a run that was stopped goes on bit for bit.  A run says of itself
`metrics.jsonl`, and TensorBoard's event files if wanted.
"""

import json
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.config import StepsConfig
from gmrdata.gmr.parallel import ALONE, Processes, averaged
from gmrdata.stage.progress import progress_bar
from gmrdata.values.errors import MissingExtra, TrainingDiverged
from gmrdata.values.files import write_text

Log = Callable[[Mapping[str, float]], None]  # takes a line: `step`, and numbers by name

Batch = TypeVar("Batch")
Tensors = tuple[Tensor, ...] | list[Tensor]
AHEAD = 2  # batches that are ready or being made while a step is computed


class Learner(Protocol[Batch]):
    """What the loop asks of a training, which begins with `done` steps.  Steps count from 0.

    `batch_of` depends on the step's number alone; `gradients` fills them and gives the figures,
    `loss` and `gradient_norm` among them; `rate_at` is Adam's step size; `after` scores and keeps.
    """

    done: int

    @property
    def optimizer(self) -> torch.optim.Optimizer: ...
    def batch_of(self, step: int) -> Batch: ...
    def gradients(self, batch: Batch) -> dict[str, float]: ...
    def rate_at(self, step: int) -> float: ...
    def after(self, done: int, log: Log) -> None: ...


def run_steps(
    learner: Learner[Batch],
    config: StepsConfig,
    run_dir: Path,
    processes: Processes = ALONE,
    *,
    tensorboard: bool = False,
) -> None:
    """Train; within `torch_settings`."""
    log_dir, done = run_dir if processes.is_first else None, learner.done
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
        " Lower learning_rate, or set gradient_norm"
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
    lines = path.read_text("utf-8").splitlines() if path.is_file() else []
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
    except (json.JSONDecodeError, KeyError, TypeError):
        return math.inf


def _event_writer(run_dir: Path, done: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise MissingExtra(
            f"{run_dir}: tensorboard: true, but tensorboard can't be imported ({error})."
            " Install gmrdata[tensorboard], or set it to false: metrics.jsonl has the same numbers"
        ) from None
    # The viewer drops what a killed process wrote of steps that are now done again.
    return SummaryWriter(str(run_dir / "tensorboard"), purge_step=done + 1)
