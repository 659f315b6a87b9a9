"""Claims on a shared disk: one owner at a time, taken over from the dead, given to nobody twice."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from gmrdata.stage import claims
from gmrdata.stage.claims import ClaimRecord, claimed, is_dead, owner, try_claim
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import ClaimLost
from gmrdata.values.files import host_word
from gmrdata.values.records import Config

HOLD = """
import sys, time
from pathlib import Path
from gmrdata.stage.claims import claimed
with claimed(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def of_another_machine(path: Path, **changes: object) -> ClaimRecord:
    """A claim as a process of another machine writes it."""
    about: dict[str, object] = {
        "token": "f" * 32, "host": "0" * 12, "machine": "node7", "pid": 1, "started": "1",
        "beats": 0, "deaths": 0,
    }  # fmt: skip
    record = ClaimRecord.model_validate(about | changes)
    record.write(path)
    return record


@pytest.fixture
def silent_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "SILENT_S", 0.2)
    monkeypatch.setattr(claims, "LONGEST_LOOK_S", 0.05)
    claims._SEEN.clear()


def count_alone(folder: Path, rounds: int) -> None:
    for _ in range(rounds):
        with claimed(folder / ".x.claim"):
            number = int((folder / "count").read_text())
            time.sleep(0.0005)
            (folder / "count").write_text(str(number + 1))


def test_one_of_many_has_it_and_nothing_stays(tmp_path: Path) -> None:
    """Reading, waiting and writing a number loses counts where two do it at once."""
    (tmp_path / "count").write_text("0")
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=count_alone, args=(tmp_path, 10)) for _ in range(4)]
    threads = [threading.Thread(target=count_alone, args=(tmp_path, 10)) for _ in range(2)]
    for process in processes:
        process.start()
    for thread in threads:
        thread.start()
    for process in processes:
        process.join(60)
    for thread in threads:
        thread.join(60)
    assert (tmp_path / "count").read_text() == "60"
    assert names(tmp_path) == ["count"]


def test_the_dead_of_this_machine_are_known_at_once(tmp_path: Path) -> None:
    path = tmp_path / ".x.claim"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    found = owner(path)
    assert found is not None and found.pid == holder.pid and not is_dead(path, found)
    assert try_claim(path) is None
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    claim = try_claim(path)
    assert claim is not None and claim.taken_over and claim.record.deaths == 1
    claim.release()
    assert names(tmp_path) == []


def test_a_number_of_a_process_that_is_used_again_is_no_life(tmp_path: Path) -> None:
    path = tmp_path / ".x.claim"
    of_another_machine(path, host=host_word(), pid=os.getpid(), started="1")
    with claimed(path) as claim:
        assert claim.taken_over


@pytest.mark.usefixtures("silent_soon")
def test_another_machine_is_dead_when_its_count_stands_still(tmp_path: Path) -> None:
    """By the clock of who watches: the other's may say anything."""
    path = tmp_path / ".x.claim"
    record = of_another_machine(path)
    os.utime(path, (0, 0))  # a clock that is 56 years late
    assert try_claim(path) is None
    for beats in range(1, 5):
        time.sleep(0.1)
        record.model_copy(update={"beats": beats}).write(path)
        assert try_claim(path) is None
    start_s = time.monotonic()
    with claimed(path) as claim:
        assert time.monotonic() - start_s > 0.2
        assert claim.record.deaths == 1


@pytest.mark.usefixtures("silent_soon")
def test_one_of_many_takes_over(tmp_path: Path) -> None:
    path = tmp_path / ".x.claim"
    of_another_machine(path)
    won: list[claims.Claim] = []

    def take() -> None:
        for _ in range(100):
            claim = try_claim(path)
            if claim is not None:
                won.append(claim)
                return
            time.sleep(0.005)

    threads = [threading.Thread(target=take) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(won) == 1 and won[0].record.deaths == 1
    assert names(tmp_path) == [".x.claim"]


@pytest.mark.usefixtures("silent_soon")
def test_an_owner_that_wakes_up_too_late_is_told(tmp_path: Path) -> None:
    path = tmp_path / ".x.claim"
    first = try_claim(path)
    assert first is not None
    # As if it had been another machine's, which nobody can look up.
    first.record = first.record.model_copy(update={"host": "0" * 12})
    first.record.write(path)
    with claimed(path) as second:
        first.beat()
        assert owner(path) == second.record
        with pytest.raises(ClaimLost, match="another process took over"):
            first.require()
        first.release()
        assert owner(path) is not None
        second.require()


def test_an_owner_shows_that_it_lives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "BEAT_S", 0.02)
    monkeypatch.setattr(claims, "_HEART", claims._Heart())
    path = tmp_path / ".x.claim"
    with claimed(path):
        deadline_s = time.monotonic() + 20
        while (found := owner(path)) is None or found.beats < 3:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
    assert names(tmp_path) == []


@pytest.mark.usefixtures("silent_soon")
@pytest.mark.parametrize("content", ["", "{", '{"format": "gmrdata-claim/2"}'])
def test_what_cannot_be_read_shows_no_life(tmp_path: Path, content: str) -> None:
    path = tmp_path / ".x.claim"
    path.write_text(content)
    assert try_claim(path) is None
    with claimed(path) as claim:
        assert claim.taken_over


def test_a_file_system_without_nameless_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "O_TMPFILE", 0)  # as NFS: a folder can't be opened for writing
    path = tmp_path / ".x.claim"
    with claimed(path):
        assert try_claim(path) is None
        assert names(tmp_path) == [".x.claim"]
    assert names(tmp_path) == []


def test_without_links_a_file_is_created(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_link(*_: object, **__: object) -> None:
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", no_link)
    path = tmp_path / ".x.claim"
    with claimed(path):
        assert try_claim(path) is None
    assert names(tmp_path) == []


@pytest.mark.usefixtures("silent_soon")
@pytest.mark.parametrize("resumable", [False, True])
def test_a_stage_of_a_silent_machine_gets_a_new_folder(tmp_path: Path, resumable: bool) -> None:
    """The silent one may wake up and write; only files of a resumable stage are the same then."""
    (tmp_path / "out.partial").mkdir()
    (tmp_path / ".out.partial").mkdir()  # of a stage of that name
    of_another_machine(tmp_path / ".out.claim")
    folders = Counter[str]()

    def work(partial: Path) -> None:
        folders[partial.name] += 1
        (partial / "a.txt").write_text("a")

    made = run_stage("test", tmp_path / "out", Config(), {}, work, resumable=resumable)
    assert names(made) == ["a.txt", "stage.json"]
    assert (list(folders) == ["out.partial"]) is resumable
    assert [name for name in names(tmp_path) if name.startswith("out")] == ["out"]
    assert not (tmp_path / ".out.claim").exists()


@pytest.mark.usefixtures("silent_soon")
def test_a_stage_that_was_taken_over_leaves_no_result(tmp_path: Path) -> None:
    def work(partial: Path) -> None:
        of_another_machine(tmp_path / ".out.claim")  # as a process that saw this one silent does
        (partial / "a.txt").write_text("a")

    with pytest.raises(ClaimLost):
        run_stage("test", tmp_path / "out", Config(), {}, work)
    assert not (tmp_path / "out").exists()


def test_a_link_whose_answer_was_lost_is_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NFS asks a second time then, and the second answer is that the file is there."""
    link = os.link

    def twice(*args: Any, **how: Any) -> None:
        link(*args, **how)
        link(*args, **how)

    monkeypatch.setattr(os, "link", twice)
    with claimed(tmp_path / ".x.claim") as claim:
        claim.require()
    assert names(tmp_path) == []


def test_a_handle_that_went_stale_is_nobodys_claim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stale(path: Path) -> ClaimRecord:
        raise OSError(errno.ESTALE, "Stale file handle", str(path))

    monkeypatch.setattr(ClaimRecord, "read", stale)
    assert owner(tmp_path / ".x.claim") is None


def test_a_process_that_proc_hides_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of another user's processes some machines show nothing: that is no sign of death."""
    path = tmp_path / ".x.claim"
    record = of_another_machine(path, host=host_word(), pid=2**22 + 1)
    assert is_dead(path, record)

    def forbidden(*_: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "kill", forbidden)
    assert not is_dead(path, record)
