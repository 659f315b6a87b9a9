"""Jobs on Dask workers, shards and threads, with their progress."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
import pytest
from distributed import LocalCluster

from gmrdata.stage import workers
from gmrdata.stage.jobs import (
    Job,
    count_files,
    in_threads,
    made_ahead,
    raise_failures,
    run_jobs,
    try_here,
    try_jobs,
)
from gmrdata.stage.progress import console, progress_bar, track
from gmrdata.stage.run import Run
from gmrdata.stage.workers import Pool, own_cores, worker_pool
from gmrdata.values.errors import BadFrames, NoWorkers, RenderFailed, StageFailed
from gmrdata.values.limits import allowed_cores
from tests.folders import REPOSITORY


def write_process_id(path: Path) -> int:
    path.write_text(str(os.getpid()))
    return os.getpid()


def fail_on_purpose(name: str) -> None:
    raise BadFrames(f"{name}: 0 bytes. Copy it again")


def fail_in_words(name: str) -> None:
    raise ValueError(f"no number: {name}")


def fail_unforeseen() -> None:
    [][0]


def crash_until(path: Path, attempt: int) -> int:
    """A process that dies by a signal in every attempt before this one."""
    with path.open("a") as attempts:
        attempts.write("x")
    number = len(path.read_text())
    if number < attempt:
        died = subprocess.run([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"])
        raise RenderFailed(f"attempt {number} ended with signal {-died.returncode}")
    return number


def fail_and_count(path: Path) -> None:
    with path.open("a") as attempts:
        attempts.write("x")
    raise BadFrames(f"{path.name}: not an image")


def heard() -> str | None:
    return os.environ.get("GMRDATA_HEARD")


def kill_own_starter_once(path: Path) -> int:
    """Kill the process that starts workers, wherever nobody has done so."""
    if not path.exists():
        path.touch()
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(0.5)  # so that its end is known before this job's
    return os.getppid()


def wait_a_little(path: Path) -> None:
    path.touch()
    time.sleep(0.1)


UNGUARDED = """
from gmrdata.stage.run import Run
from gmrdata.stage.workers import worker_pool
from gmrdata.values.errors import NoWorkers
try:
    with worker_pool(Run(workers=1)) as pool:
        pool.client()
except NoWorkers as error:
    print(error)
"""
WAITING = """
import signal
import sys
from pathlib import Path
from gmrdata.stage.jobs import Job, run_jobs
from gmrdata.stage.run import Run
from gmrdata.stage.workers import worker_pool
from tests.stage.test_jobs import wait_a_little

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever started the tests ignores it
    folder = Path(sys.argv[1])
    jobs = [Job(f"{n}", wait_a_little, {"path": folder / f"{n}"}) for n in range(1000)]
    try:
        with worker_pool(Run(workers=2)) as pool:
            run_jobs("waiting", jobs, pool, folder / "failed")
    except KeyboardInterrupt:
        print("stopped")
"""


def kill_own_process() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def kill_own_process_once(path: Path, dies: bool) -> None:
    with path.open("a") as attempts:
        attempts.write("x")
    if dies and path.read_text() == "x":
        kill_own_process()


def wait_s(seconds: float) -> None:
    time.sleep(seconds)


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Pool]:
    """For the tests that leave the workers alive."""
    with worker_pool(Run(workers=2)) as pool:
        yield pool


def test_jobs_run_in_other_processes_and_give_their_results(two_workers, tmp_path):
    jobs = [Job(f"clip{i}", write_process_id, {"path": tmp_path / f"{i}"}) for i in range(4)]
    results = run_jobs("writing", jobs, two_workers, tmp_path / "failed")
    assert list(results) == ["clip0", "clip1", "clip2", "clip3"]
    assert os.getpid() not in results.values()
    assert [int((tmp_path / f"{i}").read_text()) for i in range(4)] == list(results.values())
    assert not (tmp_path / "failed").exists()


def test_one_failure_is_recorded_and_the_others_finish(two_workers, tmp_path):
    jobs = [
        Job("bad", fail_on_purpose, {"name": "7.jpg"}),
        Job("worse", fail_unforeseen),
        Job("good", write_process_id, {"path": tmp_path / "done"}),
    ]
    with pytest.raises(StageFailed) as caught:
        run_jobs("reading", jobs, two_workers, tmp_path / "failed")
    assert "reading: 2 of 3 failed" in str(caught.value)
    assert "bad: 7.jpg: 0 bytes. Copy it again" in str(caught.value)
    assert (tmp_path / "failed" / "bad.txt").read_text() == "7.jpg: 0 bytes. Copy it again"
    unforeseen = (tmp_path / "failed" / "worse.txt").read_text()
    assert unforeseen.startswith("IndexError") and "fail_unforeseen" in unforeseen
    assert (tmp_path / "done").exists()


def test_a_crash_is_tried_again_and_bad_input_is_not(two_workers, tmp_path):
    failed = tmp_path / "failed"
    failed.mkdir()
    (failed / "once.txt").write_text("what went wrong in an earlier run")
    jobs = [
        Job("once", crash_until, {"path": tmp_path / "once", "attempt": 2}, retries=1),
        Job("twice", crash_until, {"path": tmp_path / "twice", "attempt": 3}, retries=1),
        Job("bad", fail_and_count, {"path": tmp_path / "bad"}, retries=1),
        Job("never", crash_until, {"path": tmp_path / "never", "attempt": 2}),
    ]
    outcome = try_jobs("rendering", jobs, two_workers, failed)
    assert outcome.results == {"once": 2}
    assert outcome.reasons == {
        "twice": "attempt 2 ended with signal 9\nattempt 1 of 2: attempt 1 ended with signal 9",
        "bad": "bad: not an image",
        "never": "attempt 1 ended with signal 9",
    }
    assert (tmp_path / "bad").read_text() == "x"
    files = {path.stem: path.read_text() for path in failed.iterdir()}
    assert files == outcome.reasons


@pytest.mark.parametrize("call", [fail_on_purpose, fail_in_words])
def test_a_name_that_is_no_utf8_is_in_the_reason(call, tmp_path):
    """A folder from an old disk: one broken file in it ended the whole batch with a traceback."""
    name = os.fsdecode(b"donn\xe9es/7.jpg")
    jobs = [
        Job("bad", call, {"name": name}),
        Job("good", write_process_id, {"path": tmp_path / "done"}),
    ]
    outcome = try_here("reading", jobs, tmp_path / "failed")
    assert list(outcome.results) == ["good"] and r"donn\xe9es/7.jpg" in outcome.reasons["bad"]
    assert (tmp_path / "failed" / "bad.txt").read_text() == outcome.reasons["bad"]


def fail_without_words() -> None:
    raise TimeoutError


def test_an_error_without_words_is_named_by_its_kind(tmp_path):
    """It ended the whole batch with a traceback once all was done."""
    with pytest.raises(StageFailed, match="1 of 1 failed.*\n  silent: TimeoutError"):
        outcome = try_here("reading", [Job("silent", fail_without_words)], tmp_path / "failed")
        raise_failures("reading", outcome.reasons, 1, tmp_path / "failed")


def test_a_worker_that_always_dies_is_a_clear_failure(tmp_path):
    jobs = [
        Job("hungry", kill_own_process),
        Job("good", write_process_id, {"path": tmp_path / "done"}),
    ]
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        worker_pool(Run(workers=1)) as pool,
    ):
        outcome = try_jobs("rendering", jobs[:1], pool, tmp_path / "failed")
        # The pool goes on with a new worker.
        assert set(run_jobs("writing", jobs[1:], pool, tmp_path / "failed")) == {"good"}
    assert outcome.results == {}
    assert outcome.reasons["hungry"].startswith("its worker process was killed again and again")


def test_a_worker_that_dies_once_is_replaced(tmp_path):
    jobs = [
        Job(str(i), kill_own_process_once, {"path": tmp_path / str(i), "dies": i == 1})
        for i in range(4)
    ]
    with worker_pool(Run(workers=2)) as pool:
        outcome = try_jobs("rendering", jobs, pool, tmp_path / "failed")
    assert (set(outcome.results), outcome.reasons) == ({"0", "1", "2", "3"}, {})
    assert (tmp_path / "1").read_text() == "xx"


@contextmanager
def cluster_of(n_workers: int, **more: Any) -> Iterator[tuple[LocalCluster, Run]]:
    """A scheduler with so many workers, and a run on it."""
    options = {"threads_per_worker": 1, "dashboard_address": None} | more
    with LocalCluster(n_workers=n_workers, **options) as cluster:
        yield cluster, Run(scheduler=cluster.scheduler_address)


def test_a_running_scheduler_is_used(tmp_path):
    jobs = [Job("a", write_process_id, {"path": tmp_path / "a"})]
    with cluster_of(1) as (_, run), worker_pool(run) as pool:
        assert set(run_jobs("writing", jobs, pool, tmp_path)) == {"a"}


def name_slowly(name: str) -> str:
    time.sleep(1)
    return name


def test_two_commands_on_one_scheduler_get_their_own_results(tmp_path):
    """A key stands for one task of all clients: the second had the first one's folders."""
    found: dict[str, str] = {}

    def ask(name: str, run: Run) -> None:
        with worker_pool(run) as pool:
            job = Job("walk", name_slowly, {"name": name})
            found[name] = run_jobs("naming", [job], pool, tmp_path)["walk"]

    with cluster_of(1, threads_per_worker=2) as (_, run):
        commands = [threading.Thread(target=ask, args=(name, run)) for name in "ab"]
        for command in commands:
            command.start()
        for command in commands:
            command.join()
    assert found == {"a": "a", "b": "b"}


@pytest.mark.parametrize("protocol", ["tcp", "tls"])  # without a certificate
def test_no_scheduler_at_the_address_is_a_clear_error(no_scheduler, protocol):
    address = no_scheduler.replace("tcp", protocol)
    with (
        pytest.raises(NoWorkers, match=f"no Dask scheduler at {address}"),
        worker_pool(Run(scheduler=address)) as pool,
    ):
        pool.client()


def test_files_are_counted_in_finished_and_unfinished_folders(tmp_path):
    for name, n_files in (("a", 2), ("b.partial", 3)):
        (tmp_path / name / "frames").mkdir(parents=True)
        for i in range(n_files):
            (tmp_path / name / "frames" / f"{i}.jpg").touch()
    folders, finished = [tmp_path / "a", tmp_path / "b"], dict[Path, int]()
    assert count_files(folders, "frames/*.jpg", finished) == 5
    assert finished == {tmp_path / "a": 2}
    (tmp_path / "a" / "frames" / "0.jpg").unlink()  # nobody looks into it once more
    (tmp_path / "b.partial" / "frames" / "3.jpg").touch()
    assert count_files(folders, "frames/*.jpg", finished) == 6
    (tmp_path / "b.partial").rename(tmp_path / "b")
    assert count_files(folders, "frames/*.jpg", finished) == 6


def test_a_slow_count_is_asked_rarely(two_workers, tmp_path):
    """One of thousands of folders on a shared disk."""
    begun_s: list[float] = []

    def count() -> int:
        begun_s.append(time.monotonic())
        time.sleep(0.05)
        return 0

    run_jobs("waiting", [Job("a", wait_s, {"seconds": 2.5})], two_workers, tmp_path, (9, count))
    assert len(begun_s) >= 2 and min(np.diff(begun_s)) >= 1.0


IS_FILE = Path.is_file


def see_no_mark(path: Path) -> bool:
    return not path.name.startswith(".workers-") and IS_FILE(path)


def test_workers_that_do_not_see_the_folder_are_named(tmp_path, monkeypatch):
    """They run in this process here, so that a disk can be taken away from them."""
    monkeypatch.setattr(console, "quiet", False)  # which a worker makes it
    jobs = [Job("a", write_process_id, {"path": tmp_path / "a"})]
    here = {"processes": False, "protocol": "tcp"}
    with cluster_of(1, **here) as (_, run), worker_pool(run) as pool:
        with monkeypatch.context() as patch:
            patch.setattr(Path, "is_file", see_no_mark)
            with pytest.raises(NoWorkers, match=f"does not see {tmp_path}. Put it on a disk"):
                run_jobs("writing", jobs, pool, tmp_path / "failed")
        assert list(run_jobs("writing", jobs, pool, tmp_path / "failed")) == ["a"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a"]


def test_workers_with_another_version_are_named(tmp_path):
    """A worker of a real process, in which another version of scipy is installed."""
    (tmp_path / "site" / "scipy-0.1.dist-info").mkdir(parents=True)
    metadata = "Metadata-Version: 2.1\nName: scipy\nVersion: 0.1\n"
    (tmp_path / "site" / "scipy-0.1.dist-info" / "METADATA").write_text(metadata)
    jobs = [Job("a", write_process_id, {"path": tmp_path / "a"})]
    with cluster_of(0) as (cluster, run):
        command = [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address]
        worker = subprocess.Popen(
            [*command, "--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path)],
            env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
            stderr=subprocess.DEVNULL,
        )
        try:
            with (
                worker_pool(run) as pool,
                pytest.raises(NoWorkers, match=r"tcp://.*: has scipy 0\.1, not 1"),
            ):
                run_jobs("writing", jobs, pool, tmp_path / "failed")
        finally:
            worker.terminate()
            worker.wait()


def test_a_cluster_without_workers_is_a_clear_error(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "FIRST_WORKER_S", 0.2)
    with (
        cluster_of(0) as (_, run),
        worker_pool(run) as pool,
        pytest.raises(NoWorkers, match="no worker came to tcp://"),
    ):
        run_jobs("a", [Job("a", write_process_id, {"path": tmp_path})], pool, tmp_path / "failed")


def test_a_scheduler_that_is_lost_is_a_clear_error(tmp_path, monkeypatch):
    """One that is stopped while a job is at work."""
    monkeypatch.setattr(console, "quiet", False)  # which a worker in this process makes it
    jobs = [Job("a", wait_s, {"seconds": 4.0})]
    with (
        cluster_of(1, processes=False, protocol="tcp") as (lost, run),
        worker_pool(run) as pool,
        pytest.raises(NoWorkers, match="waiting: the scheduler was lost. Start it again"),
    ):
        threading.Timer(1.0, lost.close).start()
        run_jobs("waiting", jobs, pool, tmp_path / "failed")


def test_a_worker_has_its_share_of_the_cores(tmp_path, monkeypatch):
    with worker_pool(Run(workers=2)) as pool:
        jobs = [Job("clip", own_cores, {})]
        found = run_jobs("counting", jobs, pool, tmp_path / "failed")
    cores = allowed_cores()
    assert found == {"clip": max(1, cores // 2)}
    for said, expected in (("3", 3), ("", cores), ("0", cores), ("many", cores)):
        monkeypatch.setenv("OMP_NUM_THREADS", said)
        assert own_cores() == expected


def test_workers_have_the_environment_of_now(tmp_path, monkeypatch):
    for said in ("one", "two"):
        monkeypatch.setenv("GMRDATA_HEARD", said)
        with worker_pool(Run(workers=1)) as pool:
            found = run_jobs("hearing", [Job("clip", heard, {})], pool, tmp_path / "failed")
        assert found == {"clip": said}


def test_the_process_that_starts_workers_may_die(tmp_path):
    ids, death = ("a", "b", "c", "d"), tmp_path / "death"
    with worker_pool(Run(workers=2)) as pool:
        jobs = [Job(id, kill_own_starter_once, {"path": death}) for id in ids]
        found = run_jobs("working", jobs, pool, tmp_path / "failed")
        assert set(found) == set(ids)
        again = run_jobs("working", jobs, pool, tmp_path / "failed")
    assert death.exists() and set(again) == set(ids)


def test_of_ctrl_c_the_command_speaks_alone_and_its_workers_end(tmp_path):
    """A terminal sends it to all: each worker showed where it was, in 60 lines."""
    script = tmp_path / "waiting.py"
    script.write_text(WAITING)
    command = psutil.Popen(
        [sys.executable, script, tmp_path],
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    while not (tmp_path / "9").exists():
        assert command.poll() is None, command.stdout.read()
        time.sleep(0.05)
    started = command.children(recursive=True)
    os.killpg(command.pid, signal.SIGINT)
    said, _ = command.communicate(timeout=30)
    assert command.returncode == 0 and said.endswith("stopped\n")
    assert "Traceback" not in said and "KeyboardInterrupt" not in said
    assert len(started) > 2 and not psutil.wait_procs(started, timeout=10)[1]


def test_a_collection_of_garbage_does_not_swallow_ctrl_c():
    """Dask's callback met one that came meanwhile, and the command went on."""
    before = list(gc.callbacks)
    with worker_pool(Run(workers=1)) as pool:
        pool.client()
        assert gc.callbacks == before


def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path):
    """Its workers read it again: each of them showed a traceback, and then the pool did."""
    script = tmp_path / "unguarded.py"
    script.write_text(UNGUARDED)
    ended = subprocess.run(
        [sys.executable, script],
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ended.returncode == 0, ended.stderr
    assert 'work goes under `if __name__ == "__main__":`' in ended.stdout
    assert "Traceback" not in ended.stderr


def test_a_process_has_the_cores_that_it_may_use(monkeypatch):
    """Cpusets of Slurm and Docker, and taskset, give a process some of the machine's."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    for own in ({0}, {1, 5, 6}):
        monkeypatch.setattr(os, "sched_getaffinity", lambda _, own=own: own, raising=False)
        assert own_cores() == len(own)


def test_results_come_in_the_order_of_the_items(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    together = threading.Barrier(4, timeout=20)

    def backwards(number: int) -> int:
        together.wait()
        time.sleep(0.01 * (4 - number))
        return number * number

    assert in_threads(backwards, range(4)) == [0, 1, 4, 9]


def test_an_error_stops_what_is_not_begun(monkeypatch):
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


@pytest.mark.parametrize("cores", [1, 2])
def test_a_second_thread_is_two_results_ahead(monkeypatch, cores):
    monkeypatch.setenv("OMP_NUM_THREADS", str(cores))
    drawn, by = [], set()

    def make(number: int) -> int:
        by.add(threading.get_ident())
        if number == 9:
            raise ValueError("the ninth")
        return number * number

    found = made_ahead(make, (drawn.append(number) or number for number in range(20)))
    assert [next(found) for _ in range(4)] == [0, 1, 4, 9]
    assert len(drawn) == (4 if cores == 1 else 6) and len(by) == 1
    assert (threading.get_ident() in by) == (cores == 1)
    with pytest.raises(ValueError, match="the ninth"):
        list(found)
    assert len(drawn) < 13


def test_items_pass_through(capsys):
    assert list(track(range(5), "counting")) == [0, 1, 2, 3, 4]
    assert list(track(iter("abc"), "letters", total=3)) == ["a", "b", "c"]
    assert capsys.readouterr().out == ""


def test_an_error_in_the_loop_comes_through():
    with pytest.raises(ArithmeticError):
        for _ in track([1, 2], "failing"):
            raise ArithmeticError


def test_brackets_are_text_and_no_markup():
    assert list(track([1], "checking [/b].yaml")) == [1]


def test_bar_counts():
    with progress_bar() as bar:
        task = bar.add_task("counting", total=4)
        bar.advance(task, 3)
        assert bar.tasks[0].completed == 3
        assert bar.tasks[0].total == 4
