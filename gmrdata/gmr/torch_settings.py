"""How torch computes while a network is trained."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch


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
