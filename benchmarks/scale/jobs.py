"""What a job costs that does nothing, beside one that leaves an empty stage."""

import time
from collections.abc import Sequence
from pathlib import Path

from gmrdata.stage.jobs import Job, try_jobs, worker_pool
from gmrdata.stage.run import Run
from gmrdata.stage.shards import Shard
from gmrdata.stage.store import run_stage
from gmrdata.values.records import Config

ALONE = Run(shard=Shard(1, 1))


def nothing() -> None:
    """An empty job."""


def empty_stage(out_dir: Path, run: Run) -> Path:
    return run_stage("empty", out_dir, Config(), {}, lambda _: None, run=run)


def milliseconds(n: int, root: Path) -> dict[str, float]:
    """Wall time for each of n jobs [ms]: empty ones by a plain loop, a shard, Dask; empty stages,
    and empty stages that are there."""
    empty = [Job(f"c{number:06d}", nothing) for number in range(n)]
    begin_s = time.perf_counter()
    for job in empty:
        job.call(**job.arguments)
    plain_ms = _each_ms(begin_s, n)
    return {
        "job_ms_plain": plain_ms,
        "job_ms_shards": _run_ms(empty, ALONE, root / "shards"),
        "job_ms_dask": _run_ms(empty, Run(workers=2), root / "dask"),
        **stage_milliseconds(n, root / "stages"),
    }


def stage_milliseconds(n: int, root: Path) -> dict[str, float]:
    """Wall time for each of n empty stages in one folder [ms]: made, and found there."""
    stages = [
        Job(f"c{number:06d}", empty_stage, {"out_dir": root / f"c{number:06d}", "run": ALONE})
        for number in range(n)
    ]
    return {
        "stage_ms_shards": _run_ms(stages, ALONE, root),
        "made_stage_ms_shards": _run_ms(stages, ALONE, root),
    }


def _run_ms(jobs: Sequence[Job], run: Run, root: Path) -> float:
    begin_s = time.perf_counter()
    with worker_pool(run) as pool:
        outcome = try_jobs("empty jobs", jobs, pool, root / "failed")
    assert len(outcome.results) == len(jobs)
    return _each_ms(begin_s, len(jobs))


def _each_ms(begin_s: float, n: int) -> float:
    return round(1000 * (time.perf_counter() - begin_s) / n, 4)
