"""A finished run of shards again: nothing is looked at one by one, and no change is missed."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.stage import finished
from gmrdata.stage.finished import FINISHED_FILE, FinishedRecord
from gmrdata.values.joint_names import MIXAMO
from tests.film.set_kills import contents

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]
MADE = "made, and no file of it or its inputs has changed since"
OPENED: list[str] = []
"""What was opened while `LISTENS` is not empty."""
LISTENS: list[bool] = []


def note_opened(event: str, about: tuple[object, ...]) -> None:
    if LISTENS and event in ("open", "os.listdir", "os.scandir") and isinstance(about[0], str):
        OPENED.append(about[0])


@pytest.fixture
def old(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that a test has just written count as old."""
    monkeypatch.setattr(finished, "FRESH_NS", -(10**9))


@pytest.fixture
def command(
    tmp_path: Path, walks_command: Callable[[int], tuple[object, ...]]
) -> tuple[object, ...]:
    """Two motion files and a joint map, as one shard of one."""
    return (*walks_command(2), "--out", tmp_path / "out", "--shard", "1/1")


@pytest.mark.usefixtures("old")
def test_a_finished_run_says_so_and_answers_as_before(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = gmrdata(*command)
    assert first.returncode == 0 and MADE not in first.stderr
    before = contents(tmp_path / "out")
    monkeypatch.setattr("tyro.extras.subcommand_cli_from_dict", None)  # nothing else is begun
    again = gmrdata(*command[:-1], "1/3")  # whoever asks
    assert again.returncode == 0 and MADE in again.stderr
    assert again.stdout == first.stdout == f"{tmp_path / 'out' / 'motions.yaml'}\n"
    assert contents(tmp_path / "out") == before
    wrong = gmrdata(*command[:-1], "3/2")
    assert wrong.returncode == 1 and "--shard 3/2: give it as 2/4" in wrong.stderr


def _edit(path: Path, old: str, new: str) -> None:
    text, found = path.read_text(), path.stat()
    assert old in text and len(old) == len(new)
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns))  # as rsync and cp -p leave it


@pytest.mark.usefixtures("old")
@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda root: _edit(root / "motions" / "walk0.bvh", "-23 2", "-23 3"), 1),
        (lambda root: (root / "motions" / "new.bvh").write_text("HIERARCHY\n"), 1),
        (lambda root: (root / "motions" / "walk0.bvh").unlink(), 1),
        (lambda root: (root / "body.npz").write_bytes(b""), 1),
        (lambda root: (root / "out" / "motions.yaml").unlink(), 0),
        (lambda root: _edit(root / "out" / "motions.yaml", "walk0", "walk9"), 1),
        (lambda root: (root / "out" / FINISHED_FILE).write_text("{"), 0),
    ],
)
def test_every_change_is_noticed(
    change: Callable[[Path], object],
    code: int,
    command: tuple[object, ...],
    gmrdata: Gmrdata,
    tmp_path: Path,
) -> None:
    assert gmrdata(*command).returncode == 0
    before = contents(tmp_path / "out")
    change(tmp_path)
    again = gmrdata(*command)
    assert MADE not in again.stderr and again.returncode == code, again.stderr
    if code == 0:
        assert contents(tmp_path / "out") == before
        assert MADE in gmrdata(*command).stderr


@pytest.mark.usefixtures("old")
def test_another_command_folder_or_version_is_looked_at(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gmrdata(*command).returncode == 0
    other = gmrdata(*command, "--fps-hz", "60")
    assert other.returncode == 1 and "made with other values of config.fps_hz" in other.stderr
    for option in ("--redo", "--workers=1"):
        answer = gmrdata(*command, *option.split("="))
        assert answer.returncode == 0 and MADE not in answer.stderr
    with monkeypatch.context() as patch:
        patch.chdir(tmp_path)
        assert MADE not in gmrdata(*command).stderr
    assert gmrdata(*command).returncode == 0
    assert MADE in gmrdata(*command).stderr
    monkeypatch.setattr(finished, "__version__", "9.9")
    assert MADE not in gmrdata(*command).stderr


def test_inputs_that_may_have_changed_meanwhile_leave_no_record(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gmrdata(*command).returncode == 0
    assert not (tmp_path / "out" / FINISHED_FILE).exists()  # written right before the run began
    monkeypatch.setattr(finished, "FRESH_NS", 0)
    remember = finished.Batch.remember

    def later(batch: finished.Batch, began_ns: int) -> None:
        (tmp_path / "motions" / "walk1.bvh").touch()
        remember(batch, began_ns)

    with monkeypatch.context() as patch:
        patch.setattr(finished.Batch, "remember", later)
        assert gmrdata(*command).returncode == 0
    assert not (tmp_path / "out" / FINISHED_FILE).exists()
    time.sleep(0.05)  # a few ticks of the disk's clock
    assert gmrdata(*command).returncode == 0
    assert (tmp_path / "out" / FINISHED_FILE).exists()


def test_a_file_that_was_just_written_counts_with_its_content(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    written = tmp_path / "out" / "clip.npz"
    written.write_bytes(b"one")
    now_ns = written.stat().st_mtime_ns
    batch = finished.Batch(("motions",), tmp_path / "out")
    soon, late = (batch._look((), now_ns + wait_ns) for wait_ns in (0, 3 * 10**9))
    assert soon != late
    state = written.stat()
    assert finished._state(written, state, is_fresh=True) != finished._state(
        written, state, is_fresh=False
    )


@pytest.mark.usefixtures("old")
def test_all_that_is_opened_is_watched(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path
) -> None:
    joint_map = tmp_path / "map.yaml"
    joint_map.write_text("".join(f"mixamorig:{name}: {joint}\n" for name, joint in MIXAMO.items()))
    sys.addaudithook(note_opened)
    LISTENS.append(True)
    try:
        answer = gmrdata(*command, "--joint-map", joint_map)
    finally:
        LISTENS.clear()
    assert answer.returncode == 0, answer.stderr
    record = FinishedRecord.read(tmp_path / "out" / FINISHED_FILE)
    watched = [*map(Path, record.inputs), tmp_path / "out"]
    watched += [Path(part) for part in record.asked.command if part.startswith("/")]
    mine = {Path(path) for path in OPENED if Path(path).is_relative_to(tmp_path)}
    assert joint_map in mine and tmp_path / "motions" / "walk0.bvh" in mine
    unwatched = {path for path in mine if not any(map(path.is_relative_to, watched))}
    assert not unwatched
