"""Locks of one machine, and stages that two processes make at once without one."""

import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gmrdata.stage.locks import locked

HOLDS = """
import sys, time
from pathlib import Path
from gmrdata.stage.locks import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_killed_process_gives_its_lock_back(tmp_path: Path) -> None:
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
def test_a_disk_without_locks_stops_nobody(
    number: int, passes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
root, host, resumable, wait_s = Path(sys.argv[1]), sys.argv[2], sys.argv[3] == "True", sys.argv[4]
store.locked = lambda _: nullcontext(True)  # as on a disk whose locks reach one machine
store.host_word = lambda: host * 12
def work(partial):
    for name in "abcd":
        (root / f"{host}_at_{name}").touch()
        if not (partial / name).exists():
            write_text(partial / name, name)
        time.sleep(float(wait_s))
    (root / f"{host}_worked").touch()
work = store.Resumable(work) if resumable else work
store.run_stage("test", root / "out", store.Config(), {}, work)
"""


@pytest.mark.parametrize("resumable", [False, True])
def test_two_machines_that_make_the_same_stage_leave_one_whole_folder(
    resumable: bool, tmp_path: Path
) -> None:
    """The first is slow, as one that was cut off; the second begins and ends in between."""
    slow, quick = (
        [sys.executable, "-c", MAKES, str(tmp_path), host, str(resumable), wait_s]
        for host, wait_s in (("a", "1.0"), ("b", "0.05"))
    )
    first = subprocess.Popen(slow)
    deadline_s = time.monotonic() + 30
    while not (tmp_path / "a_at_b").exists():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    assert subprocess.run(quick, check=False).returncode == 0
    assert not (tmp_path / "a_worked").exists()
    assert first.wait(timeout=30) == 0
    made = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    del made["stage.json"]
    assert made == {name: name.encode() for name in "abcd"}
    left = [path.name for path in tmp_path.iterdir() if not path.name.startswith(("a_", "b_"))]
    assert left == ["out"]
