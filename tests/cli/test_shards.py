"""--shard and merge on the command line: the bytes of one process, and who is left is named."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.cli.shards import merging
from gmrdata.stage.shards import CommandRecord
from gmrdata.values.errors import BadRecord
from tests.film.set_kills import contents, leftovers

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def command(
    tmp_path: Path, walks_command: Callable[[int], tuple[object, ...]]
) -> tuple[object, ...]:
    """Five motion files, of which one can't be read."""
    arguments = walks_command(4)
    (tmp_path / "motions" / "broken.bvh").write_text("HIERARCHY\n")
    return arguments


def test_shards_leave_the_bytes_of_one_process(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path
) -> None:
    alone, shared = tmp_path / "a" / "out", tmp_path / "b" / "out"
    whole = gmrdata(*command, "--out", alone)
    assert whole.returncode == 1 and "broken.bvh" in whole.stderr
    for shard in ("2/3", "1/3"):
        answer = gmrdata(*command, "--out", shared, "--shard", shard)
        assert answer.returncode == 0, answer.stderr
        assert "shard 3/3: " in answer.stderr and "not begun" in answer.stderr
        assert not (shared / "motions.yaml").exists()
    answer = gmrdata("merge", shared)
    assert answer.returncode == 1 and "shard 3/3: " in answer.stderr
    last = gmrdata(*command, "--out", shared, "--shard", "3/3")
    assert last.returncode == 1 and "1 of 5 files could not be read" in last.stderr
    assert contents(shared) == contents(alone)
    assert leftovers(shared) == leftovers(alone) == ["clips/broken.partial"]


def test_merge_ends_what_a_killed_last_shard_left(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert gmrdata(*command, "--out", out, "--shard=1/2").returncode == 0

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("gmrdata.stage.shards.Marks.remove", killed)
        assert gmrdata(*command, "--out", out, "--shard", "2/2").returncode == 130
    assert not (out / "motions.yaml").exists()
    merged = gmrdata("merge", out)
    assert merged.returncode == 1 and "1 of 5 files could not be read" in merged.stderr
    assert (out / "motions.yaml").is_file() and not (out / "shards").exists()
    again = gmrdata("merge", out)
    assert again.returncode == 1 and "nothing is left to merge" in again.stderr


def test_a_wrong_share_is_refused(gmrdata: Gmrdata, tmp_path: Path) -> None:
    answer = gmrdata("motions", tmp_path, "--out", tmp_path / "out", "--shard", "3/2")
    assert answer.returncode == 1 and "--shard 3/2: give it as 2/4" in answer.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("fetch", "--out", "out", "--shard", "1/2"),
        ("render", "--out", "elsewhere", "--shard", "1/2"),
        ("render", "--out", "out"),
        ("render", "--shard", "1/2"),
        ("render", "--shard", "1/2", "--out"),
    ],
)
def test_a_record_with_another_command_is_refused(
    arguments: tuple[str, ...], tmp_path: Path
) -> None:
    record = CommandRecord(arguments=arguments, folder=str(tmp_path))
    with pytest.raises(BadRecord, match="not a command of shards"):
        merging(tmp_path / "command.json", record, tmp_path / "out")


def test_the_recorded_command_works_on_nothing(tmp_path: Path) -> None:
    typed = ("render", "set.yaml", "--out=out", "--shard=2/40", "--redo")
    record = CommandRecord(arguments=typed, folder=str(tmp_path))
    assert merging(tmp_path / "command.json", record, tmp_path / "out") == [
        "render", "set.yaml", "--out", "out", "--shard", "0/40", "--redo",
    ]  # fmt: skip


def test_an_equals_sign_in_a_path_stays_one(tmp_path: Path) -> None:
    typed = ("motions", "a=1/walk.bvh", "--out=b=2", "--shard=1/2", "--fps_hz=30")
    record = CommandRecord(arguments=typed, folder=str(tmp_path))
    assert merging(tmp_path / "command.json", record, tmp_path / "b=2") == [
        "motions", "a=1/walk.bvh", "--out", "b=2", "--shard", "0/2", "--fps-hz", "30",
    ]  # fmt: skip


def test_what_is_not_shared_says_so(
    gmrdata: Gmrdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each shard would do the whole work."""
    recipe = tmp_path / "gmr.yaml"
    recipe.write_text("recipe: gmr\n")
    commands = (
        ("run", recipe, "--out", tmp_path / "out", "--shard", "1/2"),
        ("motions", tmp_path, "--shard", "1/2"),
        ("motions", tmp_path, "--layout", "emdb", "--out", tmp_path / "out", "--shard", "1/2"),
        ("motions", tmp_path, "--out", "o", "--shard", "1/2", "--print-slurm", "2"),
    )
    for command in commands:
        monkeypatch.setattr("sys.argv", ["gmrdata", *map(str, command)])
        answer = gmrdata(*command)
        assert answer.returncode == 1 and "eave " in answer.stderr, answer.stderr
    assert not (tmp_path / "out").exists()
