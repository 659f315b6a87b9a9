"""As many threads as a process has cores, and results in order."""

import os
import threading
import time
from pathlib import Path

import pytest

from gmrdata.stage.jobs import Job, in_threads, run_jobs
from gmrdata.stage.run import Run
from gmrdata.stage.workers import own_cores, worker_pool


def test_a_worker_has_its_share_of_the_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with worker_pool(Run(workers=2)) as pool:
        jobs = [Job("clip", own_cores, {})]
        found = run_jobs("counting", jobs, pool, tmp_path / "failed")
    cores = os.cpu_count() or 1
    assert found == {"clip": max(1, cores // 2)}
    for said, expected in (("3", 3), ("", cores), ("0", cores), ("many", cores)):
        monkeypatch.setenv("OMP_NUM_THREADS", said)
        assert own_cores() == expected


def test_results_come_in_the_order_of_the_items(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    together = threading.Barrier(4, timeout=20)

    def backwards(number: int) -> int:
        together.wait()
        time.sleep(0.01 * (4 - number))
        return number * number

    assert in_threads(backwards, range(4)) == [0, 1, 4, 9]


def test_an_error_stops_what_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    begun = []

    def fail_at_once(number: int) -> None:
        begun.append(number)
        if number == 0:
            raise ValueError("the first")
        time.sleep(0.05)

    with pytest.raises(ValueError, match="the first"):
        in_threads(fail_at_once, range(50))
    assert len(begun) < 10
