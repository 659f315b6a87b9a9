"""Independent jobs on Dask workers, local ones by default, and work in threads."""

import logging
import os
import platform
import socket
import traceback
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

from gmrdata import __version__
from gmrdata.stage.claims import claimed
from gmrdata.stage.progress import console, progress_bar, track
from gmrdata.stage.run import Run
from gmrdata.stage.shards import Marks, OthersLeft, Shard, marks_folder
from gmrdata.stage.store import NotMade, package_versions
from gmrdata.values.errors import ClaimLost, GmrdataError, StageFailed
from gmrdata.values.files import write_text

Item = TypeVar("Item")
Result = TypeVar("Result")


def own_cores() -> int:
    """Cores for this process: its share of them in a worker, else all of them."""
    share = os.environ.get("OMP_NUM_THREADS", "")
    return int(share) if share.isdecimal() and int(share) > 0 else os.cpu_count() or 1


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """A function of each item, in the items' order, with a thread for each of the own cores.

    What the function raises first is raised; items that are not begun then are left alone.
    """
    with ThreadPoolExecutor(own_cores()) as pool:
        return list(pool.map(function, items))


POLL_S = 0.5
CONNECT_S = 5.0  # how long a scheduler may take to answer
FIRST_WORKER_S = 60.0  # and the first of its workers to come
IDLE = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s"}
"""Dask's processes look at themselves 50 to 100 times a second, which takes a tenth of a core."""


@dataclass(frozen=True)
class Job:
    """One clip's share of a stage: a call with paths and plain values as its arguments."""

    id: str
    call: Callable[..., Any]  # a module-level function, so that a worker process can import it
    arguments: Mapping[str, Any] = field(default_factory=dict)
    retries: int = 0
    """Further calls after a StageFailed: a crash may not come again, while bad input stays bad."""
    weight: float = 1.0
    """How much work it is beside the others, for sharing them out."""


Results = dict[str, Any]  # what the calls of jobs gave, by job id


class Outcome(NamedTuple):
    """What became of jobs, by job id."""

    results: Results  # of those that finished
    reasons: dict[str, str]  # why each other job failed


Units = tuple[int, Callable[[], int]] | None
"""What a progress bar counts instead of jobs: how many there will be, how many there are by now."""


@dataclass(frozen=True)
class Pool:
    """Who runs jobs."""

    client: Callable[[], Any]  # gives a Dask client; the first call starts the workers
    elsewhere: bool = False
    """Whether the workers may be on other machines, so that each is looked at before it works."""
    shard: Shard | None = None
    here: bool = False
    """Whether this process runs them one by one, without Dask: one of many shards."""


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
    file with the reason for each job that failed.  One shard of several raises OthersLeft when it
    is done and others are not.
    """
    if pool.shard is None:
        return _in_order(jobs, _run_left(description, jobs, pool, failures_dir, units))
    weights = {job.id: job.weight for job in jobs}
    marks = Marks(marks_folder(failures_dir, description), pool.shard, weights)
    by_id, results = {job.id: job for job in jobs}, Results()
    with marks.working() as shares:
        for ids in shares:
            share = [by_id[id] for id in ids]
            results |= _run_left(
                description, share, pool, failures_dir, units, marks.folder
            ).results
    ended = marks.ended()
    results |= _look_first([job for job in jobs if job.id not in results])
    failed = {id: failures_dir / f"{id}.txt" for id in ended - results.keys()}
    reasons = {id: path.read_text() for id, path in failed.items() if path.is_file()}
    if left := by_id.keys() - {*results, *reasons}:
        raise OthersLeft(
            f"{description}: {len(left)} of {len(jobs)} are left. Who finishes last writes the "
            f"result, or `gmrdata merge` does.\n{marks.said(left)}",
            marks.folder,
            merging=pool.shard.index == 0,
        )
    # A process that fell silent and woke up may have written why it lost what is made now.
    record_failures(failures_dir, {}, results)
    marks.remove()
    return _in_order(jobs, Outcome(results, reasons))


def try_here(description: str, jobs: Sequence[Job], failures_dir: Path) -> Outcome:
    """`try_jobs` in this process, one by one, with all of its cores for each."""
    outcome = Outcome(_look_first(jobs), {})
    for job in track([job for job in jobs if job.id not in outcome.results], description):
        try:
            outcome.results[job.id] = _attempt(job)
        except Exception as error:
            outcome.reasons[job.id] = _reason(error, error.__traceback__)
    record_failures(failures_dir, outcome.reasons, outcome.results)
    return _in_order(jobs, outcome)


def _in_order(jobs: Sequence[Job], outcome: Outcome) -> Outcome:
    return Outcome(*({job.id: of[job.id] for job in jobs if job.id in of} for of in outcome))


def _run_left(
    description: str,
    jobs: Sequence[Job],
    pool: Pool,
    failures_dir: Path,
    units: Units,
    claims_dir: Path | None = None,
) -> Outcome:
    """Run what is not made, and keep the reasons of what fails."""
    made, new = _look_first(jobs), Outcome({}, {})
    record_failures(failures_dir, {}, made)
    if left := [job for job in jobs if job.id not in made]:
        if pool.here and claims_dir is not None:
            new = _one_by_one(description, left, claims_dir, failures_dir)
        else:
            with _same_house(failures_dir.parent, pool) as house:
                new = _by_dask(description, left, pool, units, house)
        record_failures(failures_dir, new.reasons, new.results)
    return Outcome(made | new.results, new.reasons)


@dataclass(frozen=True)
class House:
    """What a worker on another machine must have in common with the process that asks."""

    mark: Path
    """A file in the output folder."""
    token: str
    """What it holds."""
    versions: dict[str, str]
    """Of the packages that decide what bytes come out, gmrdata's and Python's."""


@contextmanager
def _same_house(out_dir: Path, pool: Pool) -> Iterator[House | None]:
    """Look at the workers of other machines before they begin; StageFailed names one that differs.

    The mark stays until the work is done, for workers that come later.
    """
    if not pool.elsewhere:
        yield None
        return
    token = uuid.uuid4().hex
    house = House(out_dir.resolve() / f".workers-{token}", token, _versions())
    write_text(house.mark, token)
    try:
        client = pool.client()
        _await_worker(client)
        found = client.run(_differs, house, on_error="ignore")  # of who doesn't answer, nothing
        if wrong := {address: said for address, said in found.items() if said}:
            listed = "\n".join(f"  {address}: {said}" for address, said in sorted(wrong.items()))
            raise StageFailed(
                f"{len(wrong)} of {len(found)} workers can't work on this. Mend or stop them and "
                f"run again:\n{listed}"
            )
        yield house
    finally:
        house.mark.unlink(missing_ok=True)


def _await_worker(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_S)
    except TimeoutError:
        raise StageFailed(
            f"no worker came to {client.scheduler.address} in {FIRST_WORKER_S:g} s. "
            "Start some with `dask worker ADDRESS --nthreads 1`"
        ) from None


def _versions() -> dict[str, str]:
    return package_versions() | {"gmrdata": __version__, "python": platform.python_version()}


def _differs(house: House) -> str:
    """In the worker: what is not as where the work was asked for; empty where all is."""
    try:
        seen = house.mark.read_text()
    except OSError:
        seen = ""
    if seen != house.token:
        return f"does not see {house.mark.parent}. Put it on a disk that all machines share"
    own = _versions()
    return "; ".join(
        f"has {name} {own.get(name, 'not at all')}, not {version}"
        for name, version in house.versions.items()
        if own.get(name) != version
    )


def _by_dask(
    description: str, jobs: Sequence[Job], pool: Pool, units: Units, house: House | None
) -> Outcome:
    results, reasons = {}, {}
    for id, future in _submit_and_wait(description, jobs, pool.client(), units, house).items():
        # Not by its status: a worker that dies now takes its results along, and Dask makes them
        # again, for which these two wait.
        try:
            error = future.exception()
            if error is None:
                results[id] = future.result()
        except CancelledError:
            raise StageFailed(
                f"{description}: the scheduler was lost. What is made is kept; start it again, and "
                "the same command goes on"
            ) from None
        if error is not None:
            reasons[id] = _reason(error, future.traceback())
    return Outcome(results, reasons)


MAX_DEATHS = 3  # processes that may die on a job before it counts as failed


def _one_by_one(
    description: str, jobs: Sequence[Job], claims_dir: Path, failures_dir: Path
) -> Outcome:
    """Run jobs in this process.  A claim on each keeps count of the processes that died on it."""
    outcome = Outcome({}, {})
    for job in track(jobs, description):
        with claimed(claims_dir / f".{job.id}.claim") as claim:
            if claim.record.deaths >= MAX_DEATHS:
                outcome.reasons[job.id] = (
                    f"{claim.record.deaths} processes died while they worked on it, as the system "
                    "kills them when memory runs out. Run it again with more memory"
                )
                continue
            try:
                outcome.results[job.id] = _attempt(job)
            except ClaimLost:  # who took it over makes it
                continue
            except Exception as error:
                outcome.reasons[job.id] = _reason(error, error.__traceback__)
                # Kept now: this process may not live to the end of its share.
                record_failures(failures_dir, {job.id: outcome.reasons[job.id]}, ())
    return outcome


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

    return {id: result for found in in_threads(look, jobs) for id, result in found.items()}


def _submit_and_wait(
    description: str, jobs: Sequence[Job], client: Any, units: Units, house: House | None
) -> Results:
    """Futures that are done, by job id."""
    from dask.distributed import wait

    futures = {
        job.id: client.submit(_call, job, house, key=f"{description}-{job.id}", pure=False)
        for job in jobs
    }
    total, n_done = units or (len(jobs), lambda: sum(f.done() for f in futures.values()))
    with progress_bar() as bar:
        task = bar.add_task(description, total=total)
        while pending := [future for future in futures.values() if not future.done()]:
            bar.update(task, completed=n_done())
            with suppress(TimeoutError, CancelledError):
                wait(pending, timeout=POLL_S)
        bar.update(task, completed=total)
    return futures


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
    """Raise StageFailed with the first line of each reason; nothing when there are none."""
    if reasons:
        listed = "\n".join(f"  {id}: {reason.splitlines()[0]}" for id, reason in reasons.items())
        what = f"{len(reasons)} of {n_jobs} failed (whole messages in {failures_dir})"
        raise StageFailed(f"{description}: {what}:\n{listed}")


@contextmanager
def worker_pool(run: Run, workers: int = 2) -> Iterator[Pool]:
    """Workers for `run_jobs`: local processes, or those of the cluster at `run.scheduler`.

    `workers` is the number of local processes where the run names none.  One shard of several has
    one process, this one, where the run names neither.
    """
    with ExitStack() as stack:
        client = cache(lambda: stack.enter_context(_client(run, workers)))
        here = run.shard is not None and run.workers is None and run.scheduler is None
        yield Pool(client, run.scheduler is not None, run.shard, here)


@contextmanager
def _client(run: Run, workers: int) -> Iterator[Any]:
    from dask import config
    from dask.distributed import Client, LocalCluster

    if run.scheduler is not None:
        # It prints how it looks for a scheduler that is gone; ours says it in a sentence.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        try:
            client = Client(run.scheduler, timeout=CONNECT_S)
        # The last two: tls:// without certificates, tcp:// where Dask's settings want encryption.
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            what = f"no Dask scheduler at {run.scheduler} ({error})"
            raise StageFailed(f"{what}. Start one, or leave --scheduler out") from error
        with client:
            yield client
        return
    count = run.workers or workers
    threads = max(1, (os.cpu_count() or 1) // count)
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    with (
        config.set(IDLE),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # without one Dask warns when its port is taken
            memory_limit=0,
            env=dict.fromkeys(names, str(threads)),
            silence_logs="CRITICAL",
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _call(job: Job, house: House | None) -> Any:
    """In the worker: its progress bars would write over those of the process that waits."""
    console.quiet = True
    if house is not None and (said := _differs(house)):
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
    """What went wrong in one line; below it the traceback of an error that we did not foresee."""
    from dask.distributed import KilledWorker

    if isinstance(error, GmrdataError | OSError):
        return "\n".join([str(error), *getattr(error, "__notes__", ())])
    if isinstance(error, KilledWorker):
        what = "its worker process was killed again and again, as the system does when memory runs"
        return f"{what} out. Run again to go on, with fewer workers"
    return f"{type(error).__name__}: {error}\n" + "".join(traceback.format_tb(where))


def count_files(folders: Sequence[Path], pattern: str) -> int:
    """How many files of a pattern stages have made by now, in finished and unfinished folders."""
    unfinished = [folder.with_name(folder.name + ".partial") for folder in folders]
    return sum(1 for folder in (*folders, *unfinished) for _ in folder.glob(pattern))
