"""Batches ahead of their steps: in order, each once, and errors where they belong."""

import threading
import time

import pytest

from gmrdata.gmr.steps import AHEAD, prefetched


def test_steps_come_in_order_with_their_batches() -> None:
    made: list[int] = []

    def make(step: int) -> int:
        made.append(step)
        return step * step

    steps = range(3, 40)
    assert list(prefetched(make, steps)) == [(step, step * step) for step in steps]
    assert made == list(steps)
    assert list(prefetched(make, range(0))) == []


def test_no_more_are_made_than_needed_soon() -> None:
    made: list[int] = []
    seen = []
    for step, _ in prefetched(made.append, range(20)):
        time.sleep(0.002)
        seen.append(step)
        assert len(made) <= step + 1 + AHEAD
    assert seen == list(range(20))


def test_the_next_is_made_while_one_is_used() -> None:
    """Each step waits for the next step's batch, which only a maker beside it can make."""
    made = [threading.Event() for _ in range(30)]

    for step, _ in prefetched(lambda step: made[step].set(), range(30)):
        assert made[min(step + 1, 29)].wait(timeout=30), f"nobody makes step {step + 1}"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_is_raised_at_its_step(error: type[BaseException]) -> None:
    def make(step: int) -> int:
        if step == 5:
            raise error
        return step

    seen = []
    with pytest.raises(error):
        for step, _ in prefetched(make, range(10)):
            seen.append(step)
    assert seen == [0, 1, 2, 3, 4]


def test_a_loop_that_ends_early_leaves_no_thread() -> None:
    before = threading.active_count()
    batches = prefetched(lambda step: step, range(100))
    assert next(batches) == (0, 0)
    batches.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before
