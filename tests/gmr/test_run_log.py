"""Logs that are cut to a checkpoint, and TensorBoard's files."""

import json
import sys
from pathlib import Path

import pytest

from gmrdata.gmr.steps import run_log
from gmrdata.values.errors import MissingExtra


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
