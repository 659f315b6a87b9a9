"""Dask's workers: local processes by default, or those of a cluster, which are looked at first."""

import ctypes
import logging
import multiprocessing
import os
import platform
import signal
import sys
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from gmrdata import __version__
from gmrdata.stage.run import Run, Shard
from gmrdata.stage.store import package_versions
from gmrdata.values.errors import NoWorkers
from gmrdata.values.files import write_text
from gmrdata.values.limits import allowed_cores

CONNECT_S = 5.0  # how long a scheduler may take to answer
FIRST_WORKER_S = 60.0  # and the first of its workers to come
IDLE = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s"}
"""Dask's processes look at themselves 50 to 100 times a second, which takes a tenth of a core."""
GUARD = 'In a script work goes under `if __name__ == "__main__":`, since they read the script again'
FORKED = {"distributed.worker.multiprocessing-method": "forkserver"}
"""One process loads Dask for all workers of all pools, which then start in a tenth of the time."""


def give_sigterm_back() -> None:
    """After an import of pycolmap, whose log would answer SIGTERM with a stack of 30 lines: whoever
    had the signal in this process has it again."""
    handler = signal.getsignal(signal.SIGTERM)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)
    elif handler is signal.SIG_DFL:  # in a worker, whose jobs are threads
        ctypes.CDLL(None).signal(int(signal.SIGTERM), 0)


def own_cores() -> int:
    """Cores for this process: its share of them in a worker, else all that it may use."""
    share = os.environ.get("OMP_NUM_THREADS", "")
    return int(share) if share.isdecimal() and int(share) > 0 else allowed_cores()


@dataclass(frozen=True)
class Pool:
    """Who runs jobs."""

    client: Callable[[], Any]  # gives a Dask client; the first call starts the workers
    elsewhere: bool = False
    """Whether the workers may be on other machines, so that each is looked at before it works."""
    shard: Shard | None = None

    def is_own(self, id: str) -> bool:
        """Whether the job of an id is in the share of this process."""
        return self.shard is None or self.shard.of(id) == self.shard.index


@contextmanager
def worker_pool(run: Run, workers: int = 2) -> Iterator[Pool]:
    """Workers for `run_jobs`: local processes, or those of the cluster at `run.scheduler`.

    `workers` is the number of local processes where the run names none.
    """
    with ExitStack() as stack:

        @cache
        def client() -> Any:
            start = _local_client if run.scheduler is None else _cluster_client
            return stack.enter_context(start(run, workers))

        yield Pool(client, run.scheduler is not None, run.share)


@contextmanager
def _cluster_client(run: Run, _: int) -> Iterator[Any]:
    from dask.distributed import Client

    # It prints how it looks for a scheduler that is gone; ours says it in a sentence.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = Client(run.scheduler, timeout=CONNECT_S)
    # The last two: tls:// without certificates, tcp:// where Dask's settings want encryption.
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        what = f"no Dask scheduler at {run.scheduler} ({error})"
        raise NoWorkers(f"{what}. Start one, or leave --scheduler out") from error
    with client:
        yield client


@contextmanager
def _local_client(run: Run, workers: int) -> Iterator[Any]:
    from dask import config
    from dask.distributed import Client, LocalCluster
    from distributed.gc import disable_gc_diagnosis

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)  # a worker that reads its script again, whose command says so
    count = run.workers or workers
    threads = max(1, own_cores() // count)
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
    # What other systems' libraries do to a process that forks is not known here.
    with config.set(IDLE | (FORKED if sys.platform == "linux" else {})):
        try:
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                preload=[__name__],  # `dask_setup`
                dashboard_address="127.0.0.1:0",  # without one Dask warns when its port is taken
                memory_limit=0,
                # Theirs would else be that of the first pool.
                env=os.environ | dict.fromkeys(names, str(threads)),
                silence_logs=logging.CRITICAL + 1,  # Ctrl-C during a message is critical to Dask
            )
        except RuntimeError as error:
            what = str(error).rstrip(".")
            raise NoWorkers(f"local workers did not start ({what}). {GUARD}") from error
        # A Ctrl-C during a collection would reach its callback, where Python drops it.
        disable_gc_diagnosis(force=True)
        with cluster, Client(cluster) as client:
            yield client


def dask_setup(_: Any) -> None:
    """In a local worker, by Dask's name for it: Ctrl-C, which a terminal sends to all, is left to
    the command."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


Fault = Callable[[], str]
"""In a worker: what is not as where the work was asked for; empty where all is."""


@contextmanager
def checked_workers(out_dir: Path, pool: Pool) -> Iterator[Fault | None]:
    """Look at the workers of other machines before they begin; NoWorkers names one that differs.

    The mark stays until the work is done, for workers that come later.
    """
    if not pool.elsewhere:
        yield None
        return
    mark = out_dir.resolve() / f".workers-{uuid.uuid4().hex}"
    fault = partial(_fault, mark, _versions())
    write_text(mark, "")
    try:
        client = pool.client()
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError:
            what = f"no worker came to {client.scheduler.address} in {FIRST_WORKER_S:g} s"
            how = "Start some with `dask worker ADDRESS --nthreads 1`"
            raise NoWorkers(f"{what}. {how}") from None
        answers = client.run(fault, on_error="ignore")  # of who doesn't answer, nothing
        if wrong := [f"  {address}: {said}" for address, said in sorted(answers.items()) if said]:
            what = f"{len(wrong)} of {len(answers)} workers can't work on this"
            raise NoWorkers("\n".join([f"{what}. Mend or stop them and run again:", *wrong]))
        yield fault
    finally:
        mark.unlink(missing_ok=True)


def _versions() -> dict[str, str]:
    return package_versions() | {"gmrdata": __version__, "python": platform.python_version()}


def _fault(mark: Path, versions: Mapping[str, str]) -> str:
    if not mark.is_file():
        return f"does not see {mark.parent}. Put it on a disk that all machines share"
    own = {name: _versions().get(name, "not at all") for name in versions}
    return "; ".join(
        f"has {name} {own[name]}, not {version}"
        for name, version in versions.items()
        if own[name] != version
    )
