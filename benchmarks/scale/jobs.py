"""What a job costs that does nothing, beside one that leaves an empty stage."""

import time
from collections.abc import Sequence
from pathlib import Path

from gmrdata.stage.jobs import Job, try_here, try_jobs
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.stage.workers import worker_pool
from gmrdata.values.records import Config


def nothing() -> None:
    """An empty job."""


def empty_stage(out_dir: Path, run: Run) -> Path:
    return run_stage("empty", out_dir, Config(), {}, lambda _: None, run=run)


def milliseconds(n: int, root: Path) -> dict[str, float]:
    """Wall time for each of n jobs [ms]: empty ones by a plain loop and Dask; empty stages, and
    empty stages that are there."""
    empty = [Job(f"c{number:06d}", nothing) for number in range(n)]
    begin_s = time.perf_counter()
    for job in empty:
        job.call(**job.arguments)
    plain_ms = _each_ms(begin_s, n)
    return {
        "job_ms_plain": plain_ms,
        "job_ms_dask": _run_ms(empty, root / "dask"),
        **stage_milliseconds(n, root / "stages"),
    }


def stage_milliseconds(n: int, root: Path) -> dict[str, float]:
    """Wall time for each of n empty stages in one folder [ms]: made, and found there."""
    stages = [
        Job(f"c{number:06d}", empty_stage, {"out_dir": root / f"c{number:06d}", "run": DEFAULT_RUN})
        for number in range(n)
    ]
    return {"stage_ms": _here_ms(stages, root), "made_stage_ms": _here_ms(stages, root)}


def _run_ms(jobs: Sequence[Job], root: Path) -> float:
    begin_s = time.perf_counter()
    with worker_pool(Run(workers=2)) as pool:
        outcome = try_jobs("empty jobs", jobs, pool, root / "failed")
    assert len(outcome.results) == len(jobs)
    return _each_ms(begin_s, len(jobs))


def _here_ms(jobs: Sequence[Job], root: Path) -> float:
    begin_s = time.perf_counter()
    assert len(try_here("empty stages", jobs, root / "failed").results) == len(jobs)
    return _each_ms(begin_s, len(jobs))


def _each_ms(begin_s: float, n: int) -> float:
    return round(1000 * (time.perf_counter() - begin_s) / n, 4)
