"""What the loop of any training does: batches made ahead, and a log that goes on."""

import json
import sys
import threading
import time
from pathlib import Path

import pytest

from gmrdata.gmr.steps import AHEAD, prefetched, run_log
from gmrdata.values.errors import MissingExtra


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


def steps_of(run_dir: Path) -> list[int]:
    return [json.loads(line)["step"] for line in (run_dir / "metrics.jsonl").open()]


def test_lines_beyond_the_checkpoint_are_cut(tmp_path: Path) -> None:
    with run_log(tmp_path, 0, False) as log:
        for step in range(1, 6):
            log({"step": step, "loss": 0.5})
    with (tmp_path / "metrics.jsonl").open("a") as stream:
        stream.write('{"step": 6, "lo')
    with run_log(tmp_path, 3, False) as log:
        log({"step": 4, "loss": 0.25})
    assert steps_of(tmp_path) == [1, 2, 3, 4]


def test_a_process_that_is_to_say_nothing_writes_nothing(tmp_path: Path) -> None:
    with run_log(None, 0, True) as log:
        log({"step": 1, "loss": 0.5})
    assert list(tmp_path.iterdir()) == []


def test_missing_tensorboard_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with (
        pytest.raises(MissingExtra, match=r"Install gmrdata\[tensorboard\]"),
        run_log(tmp_path, 0, True),
    ):
        pass


def test_event_files_have_the_lines_numbers(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with run_log(tmp_path, 0, True) as log:
        for step in (1, 2, 3):
            log({"step": step, "loss": 0.5 / step})
    with run_log(tmp_path, 2, True) as log:
        log({"step": 3, "loss": 7.0})
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    found = [(event.step, event.value) for event in events.Scalars("loss")]
    assert found == [(1, 0.5), (2, 0.25), (3, 7.0)]
