"""Independent jobs on Dask workers, local ones by default, and work in threads."""

import socket
import time
import traceback
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TypeVar
from uuid import uuid4

from gmrdata.stage.progress import console, progress_bar, track
from gmrdata.stage.run import Run, Shard
from gmrdata.stage.store import NotMade
from gmrdata.stage.workers import Fault, Pool, checked_workers, own_cores, worker_pool
from gmrdata.values.errors import GmrdataError, NothingMade, NoWorkers, StageFailed
from gmrdata.values.files import as_text, partial_of, write_text

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """A function of each item, in the items' order, with a thread for each of the own cores.

    What the function raises first is raised; items that are not begun then are left alone.
    """
    with ThreadPoolExecutor(own_cores()) as pool:
        return list(pool.map(function, items))


MADE_AHEAD = 2  # results that wait


def made_ahead(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """A function of each item, in the items' order: a second thread makes the next ones while one
    is worked on, where this process has several cores.  The items are drawn in this thread."""
    if own_cores() < 2:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(1) as pool:
        waiting = deque[Future[Result]]()
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > MADE_AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


POLL_S = 0.5
POLL_SHARE = 0.05
"""Most of the time that goes into counting: on a shared disk a look at many folders is slow."""


@dataclass(frozen=True)
class Job:
    """One clip's share of a stage: a call with paths and plain values as its arguments."""

    id: str
    call: Callable[..., Any]  # a module-level function, so that a worker process can import it
    arguments: Mapping[str, Any] = field(default_factory=dict)
    retries: int = 0
    """Further calls after a StageFailed: a crash may not come again, while bad input stays bad."""


Results = dict[str, Any]  # what the calls of jobs gave, by job id


class Outcome(NamedTuple):
    """What became of jobs, by job id."""

    results: Results  # of those that finished
    reasons: dict[str, str]  # why each other job failed


class OthersLeft(Exception):
    """This share of a batch is done, and others are not: there is no result of the whole yet."""

    def __init__(self, message: str, *, failed: bool) -> None:
        super().__init__(message)
        self.failed = failed  # some of this share, or the whole that `gmrdata merge` asked for


Units = tuple[int, Callable[[], int]] | None
"""What a progress bar counts instead of jobs, of the own share alone: how many there will be, how
many there are by now."""


def run_jobs(
    description: str, jobs: Sequence[Job], pool: Pool, failures_dir: Path, units: Units = None
) -> Results:
    """Results of `try_jobs` for callers that need them all; StageFailed lists what failed."""
    outcome = try_jobs(description, jobs, pool, failures_dir, units)
    raise_failures(description, outcome.reasons, len(jobs), failures_dir)
    return outcome.results


def try_jobs(
    description: str, jobs: Sequence[Job], pool: Pool, failures_dir: Path, units: Units = None
) -> Outcome:
    """Run every job on a `worker_pool`; the others go on where one fails.

    Jobs that have nothing left to make are done without a worker.  `failures_dir` gets one text
    file with the reason for each job that failed.  Of a shard only its own jobs are run; it raises
    OthersLeft unless all others are made.
    """
    shard = pool.shard
    share = [job for job in jobs if pool.is_own(job.id)]
    results = _look_first(share)
    reasons: dict[str, str] = {}
    if left := [job for job in share if job.id not in results]:
        with checked_workers(failures_dir.parent, pool) as fault:
            new, reasons = _by_dask(description, left, pool.client(), units, fault)
        results |= new
    if shard is not None:
        results |= _look_first([job for job in jobs if not pool.is_own(job.id)])
        if shard.index == 0:
            reasons = _kept_reasons(jobs, results, failures_dir)
    record_failures(failures_dir, reasons, results)
    outcome = Outcome(*({job.id: of[job.id] for job in jobs if job.id in of}
                        for of in (results, reasons)))  # fmt: skip
    if shard is not None:
        _require_whole(description, jobs, outcome, shard)
    return outcome


def try_here(description: str, jobs: Sequence[Job], failures_dir: Path) -> Outcome:
    """`try_jobs` in this process, one by one, with all of its cores for each."""
    outcome = Outcome(_look_first(jobs), {})
    for job in track([job for job in jobs if job.id not in outcome.results], description):
        try:
            outcome.results[job.id] = _attempt(job)
        except Exception as error:
            outcome.reasons[job.id] = _reason(error, error.__traceback__)
    record_failures(failures_dir, outcome.reasons, outcome.results)
    return outcome


def try_batch(
    description: str, jobs: Sequence[Job], failures_dir: Path, run: Run, few: int = 0
) -> Outcome:
    """`try_jobs` with a local worker for each core; `try_here` for one worker, or so few jobs that
    workers would start no sooner, unless the run has a cluster or is a share."""
    workers = run.workers or min(len(jobs), own_cores())
    if run.shard is run.scheduler is None and (workers == 1 or len(jobs) <= few):
        return try_here(description, jobs, failures_dir)
    with worker_pool(run, workers) as pool:
        return try_jobs(description, jobs, pool, failures_dir)


def _look_first(jobs: Sequence[Job]) -> Results:
    """Results of the jobs that take a `Run` as `run` and have nothing left to make.

    A job that fails is left, so that its worker says why.
    """

    def look(job: Job) -> Results:
        if "run" not in job.arguments:
            return {}
        run = replace(job.arguments["run"], only_look=True)
        try:
            return {job.id: job.call(**{**job.arguments, "run": run})}
        except (NotMade, GmrdataError, OSError):
            return {}

    return {id: result for results in in_threads(look, jobs) for id, result in results.items()}


def _kept_reasons(jobs: Sequence[Job], results: Results, failures_dir: Path) -> dict[str, str]:
    """Why jobs failed that were run before and are not made."""
    paths = {job.id: failures_dir / f"{job.id}.txt" for job in jobs if job.id not in results}
    return {id: path.read_text("utf-8") for id, path in paths.items() if path.is_file()}


def _require_whole(description: str, jobs: Sequence[Job], outcome: Outcome, shard: Shard) -> None:
    """OthersLeft where jobs of other shares are neither made nor, for who merges, failed."""
    left: dict[int, list[str]] = {}
    for job in jobs:
        if job.id not in outcome.results and job.id not in outcome.reasons:
            left.setdefault(shard.of(job.id), []).append(job.id)
    if not left:
        return
    said = [f"{description}: {sum(map(len, left.values()))} of {len(jobs)} are left. Run these "
            "shards; `gmrdata merge` then writes the result of all:"]  # fmt: skip
    said += [f"  shard {of}/{shard.count}: {', '.join(ids)}" for of, ids in sorted(left.items())]
    if outcome.reasons:
        said += [f"{len(outcome.reasons)} failed:", *_first_lines(outcome.reasons)]
    raise OthersLeft("\n".join(said), failed=shard.index == 0 or bool(outcome.reasons))


def _by_dask(
    description: str, jobs: Sequence[Job], client: Any, units: Units, fault: Fault | None
) -> Outcome:
    # A key names a task for all clients of a scheduler: another command may have jobs of these ids.
    own = uuid4().hex
    futures = {
        job.id: client.submit(_call, job, fault, key=f"{description}-{job.id}-{own}", pure=False)
        for job in jobs
    }
    _wait(description, futures, units)
    outcome = Outcome({}, {})
    for id, future in futures.items():
        # Not by its status: a worker that dies now takes its results along, and Dask makes them
        # again, for which these two wait.
        try:
            error = future.exception()
            if error is None:
                outcome.results[id] = future.result()
        except CancelledError:
            raise NoWorkers(
                f"{description}: the scheduler was lost. Start it again, and the same command goes "
                "on with what is made"
            ) from None
        if error is not None:
            outcome.reasons[id] = _reason(error, future.traceback())
    return outcome


def _wait(description: str, futures: Mapping[str, Any], units: Units) -> None:
    from dask.distributed import wait

    total, n_done = units or (len(futures), lambda: sum(f.done() for f in futures.values()))
    with progress_bar() as bar:
        task = bar.add_task(description, total=total)
        while pending := [future for future in futures.values() if not future.done()]:
            start_s = time.monotonic()
            bar.update(task, completed=n_done())
            count_s = time.monotonic() - start_s
            with suppress(TimeoutError, CancelledError):
                wait(pending, timeout=max(POLL_S, count_s / POLL_SHARE))
        bar.update(task, completed=total)


def record_failures(
    failures_dir: Path, reasons: Mapping[str, str], finished: Collection[str]
) -> None:
    """Write one text file for each job that failed, and remove those of jobs that now finished."""
    for id, reason in reasons.items():
        write_text(failures_dir / f"{id}.txt", reason)
    # Looked up in one listing: most folders are empty, and a shared disk is asked once.
    there = set(failures_dir.iterdir()) if finished and failures_dir.is_dir() else set()
    for path in there.intersection(failures_dir / f"{id}.txt" for id in finished):
        path.unlink(missing_ok=True)


def raise_failures(
    description: str, reasons: Mapping[str, str], n_jobs: int, failures_dir: Path
) -> None:
    """Raise StageFailed with the first line of each reason, NothingMade where all jobs have one;
    nothing when there are none."""
    if reasons:
        what = f"{len(reasons)} of {n_jobs} failed (whole messages in {failures_dir})"
        kind = NothingMade if len(reasons) == n_jobs else StageFailed
        raise kind("\n".join([f"{description}: {what}:", *_first_lines(reasons)]))


def _first_lines(reasons: Mapping[str, str]) -> list[str]:
    return [f"  {id}: {reason.splitlines()[0]}" for id, reason in reasons.items()]


def _call(job: Job, fault: Fault | None) -> Any:
    """In the worker: its progress bars would write over those of the process that waits."""
    console.quiet = True
    if fault is not None and (said := fault()):
        raise StageFailed(f"its worker on {socket.gethostname()} {said}")
    return _attempt(job)


def _attempt(job: Job) -> Any:
    earlier: list[str] = []
    while True:
        try:
            return job.call(**job.arguments)
        except StageFailed as error:
            if len(earlier) < job.retries:
                earlier.append(str(error))
                continue
            for number, reason in enumerate(earlier, start=1):
                error.add_note(f"attempt {number} of {job.retries + 1}: {reason}")
            raise


def _reason(error: BaseException, where: TracebackType | None) -> str:
    """What went wrong in one line; below it the traceback of an error that we did not foresee.
    Names in it are as records can hold them."""
    from dask.distributed import KilledWorker

    if isinstance(error, GmrdataError | OSError):
        said = str(error) or type(error).__name__  # a TimeoutError has no words
        return as_text("\n".join([said, *getattr(error, "__notes__", ())]))
    if isinstance(error, KilledWorker):
        what = "its worker process was killed again and again, as the system does when memory runs"
        return f"{what} out. Run again to go on, with fewer workers"
    return as_text(f"{type(error).__name__}: {error}\n" + "".join(traceback.format_tb(where)))


def count_files(folders: Sequence[Path], pattern: str, finished: dict[Path, int]) -> int:
    """How many files of a pattern stages have made by now, in finished and unfinished folders.

    A finished folder is looked into once: its number is kept in `finished`.
    """

    def count(folder: Path) -> int:
        return sum(1 for _ in folder.glob(pattern))

    left = [folder for folder in folders if folder not in finished]
    finished |= {folder: count(folder) for folder in left if folder.is_dir()}
    return sum(finished.values()) + sum(count(partial_of(folder)) for folder in left)
