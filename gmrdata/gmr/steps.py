"""Exponential moving average of a network's weights (Polyak and Juditsky 1992, in its usual form).

The average of the last steps is less noisy than their last one.  It is a second network of the same
settings, which the checkpoint keeps beside the trained one: training goes on from the trained
weights, and the average is what is scored and used.

How torch computes while a network is trained.

Stop a training before a step without finite loss or gradient touches the weights.

Batches made ahead of the step that needs them, in a thread.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.model import Gmr
from gmrdata.values.errors import TrainingDiverged


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
    """A run's seed for its weights (counter 0) or a step (from 1), and for a process of several.

    Seeding every step anew lets a run that was stopped go on with the same dropout.
    """
    numbers = [seed, counter, rank] if rank else [seed, counter]
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


def start_average(model: Gmr) -> Gmr:
    """A network with a copy of the weights, in evaluation mode, to put the average into."""
    average = Gmr(model.config).to(next(model.parameters()).device)
    average.load_state_dict(model.state_dict())
    return average.requires_grad_(False).eval()


def update_average(average: Gmr, model: Gmr, decay: float, step: int) -> None:
    """Take the weights of one more step into the average, in place.

    Args:
        average: What `start_average` gave.
        model: The trained network after this step.
        decay: Share of its former value that the average keeps.
        step: The step, counted from 0; early on the share is less (`decay_at`).
    """
    share = 1 - decay_at(decay, step)
    with torch.no_grad():
        for mean, value in zip(average.parameters(), model.parameters(), strict=True):
            mean.lerp_(value, share)


def decay_at(decay: float, step: int) -> float:
    """Share that the average keeps in a step, counted from 0: at most (1 + step) / (10 + step)."""
    return min(decay, (1 + step) / (10 + step))


def check_finite(values: Mapping[str, float], run_dir: Path, step: int) -> None:
    """Refuse a step whose figures are not all finite.

    Args:
        values: Figures of the step, `loss` and `gradient_norm` among them.
        run_dir: The run's folder, whose last checkpoint the message names.
        step: The step, counted from 1.

    Raises:
        TrainingDiverged: one is infinite or NaN.
    """
    if all(math.isfinite(value) for value in values.values()):
        return
    kept = latest_checkpoint(run_dir)
    raise TrainingDiverged(
        f"{run_dir}: in step {step} the loss is {values['loss']:g} and its gradient has length"
        f" {values['gradient_norm']:g}. The last good checkpoint: {kept.name if kept else 'none'}."
        " Lower learning_rate, or set gradient_norm"
    )


Batch = TypeVar("Batch")

AHEAD = 2
"""Batches that are ready or being made while a step is computed."""


def prefetched(make: Callable[[int], Batch], steps: Iterable[int]) -> Iterator[tuple[int, Batch]]:
    """Each step with its batch, in order.

    A batch depends on its step alone, so nothing changes but the time.  What `make` raises is
    raised when the loop comes to that step, and not before.

    Args:
        make: Makes the batch of a step; called in a thread, for one step after the other.
        steps: The steps.
    """
    waiting: deque[tuple[int, Future[Batch]]] = deque()
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="batches") as thread:
        try:
            for step in steps:
                waiting.append((step, thread.submit(make, step)))
                if len(waiting) > AHEAD:
                    earlier, batch = waiting.popleft()
                    yield earlier, batch.result()
            while waiting:
                earlier, batch = waiting.popleft()
                yield earlier, batch.result()
        finally:
            for _, batch in waiting:
                batch.cancel()
