"""Processes that share a folder: locks of one machine, and shards, each its static share."""

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.stage.jobs import Job, OthersLeft, Outcome, try_jobs
from gmrdata.stage.locks import locked
from gmrdata.stage.run import Run, Shard
from gmrdata.stage.store import run_stage
from gmrdata.stage.workers import worker_pool
from gmrdata.values.errors import BadFrames, BadRecipe
from gmrdata.values.records import Config
from tests.folders import wait_for

IDS = [f"c{number}" for number in range(6)]


class Wanted(Config):
    text: str


def make(out_dir: Path, run: Run, wanted: str, wait_s: float, fails: bool) -> Path:
    """A job: a stage that notes each call, waits, and may fail."""

    def work(partial_dir: Path) -> None:
        with (out_dir.parent / "log").open("a") as stream:
            stream.write(f"{wanted} {out_dir.name}\n")
        time.sleep(wait_s)
        if fails:
            raise BadFrames(f"{out_dir.name}: not an image")
        (partial_dir / "a.txt").write_text(f"{wanted} {out_dir.name}")

    return run_stage("test", out_dir, Wanted(text=wanted), {}, work, run=run)


def batch(
    root: Path, shard: str, wanted: str = "old", wait_s: float = 0.0, *,
    failing: tuple[str, ...] = (), redo: bool = False,
) -> Outcome:  # fmt: skip
    """A whole batch of six jobs as one shard of it."""
    run = Run(shard=shard, workers=1, redo=redo)
    shared = {"run": run, "wanted": wanted, "wait_s": wait_s}
    jobs = [Job(id, make, {"out_dir": root / id, "fails": id in failing} | shared) for id in IDS]
    with worker_pool(run) as pool:
        return try_jobs("making things", jobs, pool, root / "failed")


def child(root: Path, *arguments: object) -> subprocess.Popen[str]:
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n"
        "from pathlib import Path\nfrom tests.stage.test_shards import OthersLeft, batch\n"
        "if __name__ == '__main__':\n"
        f"    try:\n        batch(Path({str(root)!r}), *{arguments!r})\n        print('whole')\n"
        "    except OthersLeft:\n        print('others left')\n"
    )
    script = root / f"child_{len(list(root.glob('child_*')))}.py"
    script.write_text(code)
    return subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, text=True, start_new_session=True
    )


def logged(root: Path) -> list[str]:
    return sorted((root / "log").read_text().splitlines())


def of_share(index: int, count: int) -> list[str]:
    return [id for id in IDS if Shard(index, count).of(id) == index]


@given(st.sets(st.text(max_size=8), max_size=60), st.integers(1, 9))
def test_each_job_is_in_one_share_whatever_the_others_are(ids, count):
    shares = {index: {id for id in ids if Shard(index, count).of(id) == index}
              for index in range(1, count + 1)}  # fmt: skip
    assert sorted(id for share in shares.values() for id in share) == sorted(ids)
    assert all(Shard(0, count).of(id) in shares for id in ids)


def test_shares_of_many_clips_are_about_even_and_stay_as_they_are():
    found = [Shard(1, 4).of(f"clip_{number:05d}") for number in range(10_000)]
    assert all(abs(found.count(index) - 2500) < 150 for index in range(1, 5))
    assert found[:12] == [1, 3, 3, 4, 1, 1, 1, 3, 1, 1, 4, 4]


@pytest.mark.parametrize("text", ["", "2", "5/4", "1/0", "a/b", "-1/2", "1/2/3", "1.0/2", "١/٢x"])
def test_a_shard_that_is_none_is_refused(text):
    with pytest.raises(BadRecipe, match="give it as 2/4"):
        Run(shard=text)


@pytest.mark.parametrize("workers", [0, 5000])
def test_a_number_of_workers_that_no_machine_has_is_refused(workers):
    """Of the second each verb began as many processes, and `floor` ended with a traceback."""
    with pytest.raises(BadRecipe, match=f"--workers {workers}: "):
        Run(workers=workers)


def test_who_finds_all_made_gets_the_whole(tmp_path):
    listed = re.escape(f"shard 1/3: {', '.join(of_share(1, 3))}")
    for shard in ("2/3", "3/3"):
        with pytest.raises(OthersLeft, match=listed) as left:
            batch(tmp_path, shard)
        assert not left.value.failed
    with pytest.raises(OthersLeft, match=listed) as left:
        batch(tmp_path, "0/3")
    assert left.value.failed
    outcome = batch(tmp_path, "1/3")
    assert list(outcome.results) == IDS and not outcome.reasons
    assert logged(tmp_path) == [f"old {id}" for id in IDS]
    # Any of them says so again, and works on nothing; so does who merges.
    assert batch(tmp_path, "2/3") == batch(tmp_path, "0/3") == outcome
    assert logged(tmp_path) == [f"old {id}" for id in IDS]


def test_what_failed_is_known_to_who_merges(tmp_path):
    failing = (of_share(1, 2)[0], of_share(2, 2)[0])
    with pytest.raises(OthersLeft, match=f"{failing[0]}: not an image") as left:
        batch(tmp_path, "1/2", failing=failing)
    assert left.value.failed
    with pytest.raises(OthersLeft, match=f"shard 1/2: {failing[0]}\n"):
        batch(tmp_path, "2/2", failing=failing)
    outcome = batch(tmp_path, "0/2")
    assert list(outcome.results) == [id for id in IDS if id not in failing]
    assert outcome.reasons == {id: f"{id}: not an image" for id in failing}
    # Mended, they are made by the shard that has them.
    with pytest.raises(OthersLeft):
        batch(tmp_path, "1/2")
    outcome = batch(tmp_path, "2/2")
    assert list(outcome.results) == IDS and not outcome.reasons
    assert not list((tmp_path / "failed").iterdir())


def test_a_killed_shard_is_started_again(tmp_path):
    dies = child(tmp_path, "1/2", "old", 60.0)
    wait_for(tmp_path / "log", dies)
    with pytest.raises(OthersLeft, match="shard 1/2: "):
        batch(tmp_path, "2/2")
    os.killpg(dies.pid, signal.SIGKILL)
    dies.wait()
    outcome = batch(tmp_path, "1/2")
    assert list(outcome.results) == IDS
    assert {(tmp_path / id / "a.txt").read_text() for id in IDS} == {f"old {id}" for id in IDS}


def test_two_shards_at_once_and_one_of_them_twice(tmp_path):
    """The clips of the share that two processes have are made once: the second waits."""
    begun = [child(tmp_path, shard, "old", 0.1) for shard in ("1/2", "2/2", "2/2")]
    said = [process.communicate(timeout=120)[0].strip() for process in begun]
    assert set(said) <= {"others left", "whole"} and "whole" in said
    assert logged(tmp_path) == [f"old {id}" for id in IDS]


def test_a_shard_that_redoes_does_its_own_share_alone(tmp_path):
    """What others made by the old recipe does not count as done."""
    for shard in ("1/2", "2/2"):
        try:
            batch(tmp_path, shard)
        except OthersLeft:
            continue
    left = f"shard 1/2: {', '.join(of_share(1, 2))}"
    for redo in (True, False):  # restarted without --redo it makes no whole of two recipes
        with pytest.raises(OthersLeft, match=left):
            batch(tmp_path, "2/2", "new", redo=redo)
    outcome = batch(tmp_path, "1/2", "new", redo=True)
    assert list(outcome.results) == IDS and not outcome.reasons
    assert logged(tmp_path) == [f"{wanted} {id}" for wanted in ("new", "old") for id in IDS]


HOLDS = """
import sys, time
from pathlib import Path
from gmrdata.stage.locks import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_killed_process_gives_its_lock_back(tmp_path):
    out = tmp_path / "out"
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, str(out)], stdout=subprocess.PIPE)
    assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
    taken_s: list[float] = []

    def take() -> None:
        with locked(out) as alone:
            assert alone
            taken_s.append(time.monotonic())

    waiter = threading.Thread(target=take)
    waiter.start()
    time.sleep(0.3)
    killed_s = time.monotonic()
    assert not taken_s
    holder.kill()
    holder.wait()
    waiter.join(timeout=10)
    assert taken_s and taken_s[0] >= killed_s
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("number", "passes"), [(errno.ENOLCK, True), (errno.EIO, False)])
def test_a_disk_without_locks_stops_nobody(number, passes, tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    if passes:
        with locked(tmp_path / "out") as alone:
            assert not alone
        assert list(tmp_path.iterdir()) == []
    else:
        with pytest.raises(OSError), locked(tmp_path / "out"):
            pass


MAKES = """
import sys, time
from contextlib import nullcontext
from pathlib import Path
from gmrdata.stage import store
from gmrdata.values.files import write_text
root, host, resumable = Path(sys.argv[1]), sys.argv[2], sys.argv[3] == "True"
store.locked = lambda _: nullcontext(True)  # as on a disk whose locks reach one machine
store.host_word = lambda: host * 12
def work(partial):
    for name in "abcd":
        (root / f"{host}_at_{name}").touch()
        if not (partial / name).exists():
            write_text(partial / name, name)
        while host == "a" and name == "b" and not (root / "b_ended").exists():
            time.sleep(0.01)
    (root / f"{host}_worked").touch()
work = store.Resumable(work) if resumable else work
store.run_stage("test", root / "out", store.Config(), {}, work)
"""


@pytest.mark.parametrize("resumable", [False, True])
def test_two_machines_that_make_the_same_stage_leave_one_whole_folder(resumable, tmp_path):
    """The first is slow, as one that was cut off; the second begins and ends in between."""
    slow, quick = (
        [sys.executable, "-c", MAKES, str(tmp_path), host, str(resumable)] for host in "ab"
    )
    first = subprocess.Popen(slow)
    wait_for(tmp_path / "a_at_b", first)
    assert subprocess.run(quick, check=False).returncode == 0
    assert not (tmp_path / "a_worked").exists()
    (tmp_path / "b_ended").touch()
    assert first.wait(timeout=30) == 0
    made = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    del made["stage.json"]
    assert made == {name: name.encode() for name in "abcd"}
    left = [path.name for path in tmp_path.iterdir() if not path.name.startswith(("a_", "b_"))]
    assert left == ["out"]
