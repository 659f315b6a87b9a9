"""Batches made ahead of the step that needs them, in a thread."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

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
