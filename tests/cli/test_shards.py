"""--shard and merge on the command line: the bytes of one process, and who is left is named."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.cli.shards import COMMAND_FILE, CommandRecord, merging, share
from gmrdata.stage.jobs import OthersLeft
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


def test_shards_and_merge_leave_the_bytes_of_one_process(
    command: tuple[object, ...], gmrdata: Gmrdata, tmp_path: Path
) -> None:
    alone, shared = tmp_path / "a" / "out", tmp_path / "b" / "out"
    whole = gmrdata(*command, "--out", alone)
    assert whole.returncode == 1 and "broken.bvh" in whole.stderr

    def shard(share: str) -> subprocess.CompletedProcess[str]:
        return gmrdata(*command, "--out", shared, "--workers", "1", f"--shard={share}")

    nothing = gmrdata("merge", shared)
    assert nothing.returncode == 1 and "nothing is left to merge" in nothing.stderr
    second = shard("2/3")
    assert second.returncode == 0, second.stderr
    assert "shard 1/3: broken, walk3\n  shard 3/3: walk2\n" in second.stderr
    first = shard("1/3")
    assert first.returncode == 1 and "broken.bvh" in first.stderr
    assert "reading motions: 1 of 5 are left" in first.stderr
    left = gmrdata("merge", shared)
    assert left.returncode == 1 and "shard 3/3: walk2\n" in left.stderr
    assert "shard 1/3" not in left.stderr
    last = shard("3/3")
    assert last.returncode == 0 and "shard 1/3: broken\n" in last.stderr
    assert not (shared / "motions.yaml").exists()
    merged = gmrdata("merge", shared)
    assert merged.returncode == 1 and "1 of 5 files could not be read" in merged.stderr
    assert contents(shared).keys() - contents(alone).keys() == {COMMAND_FILE}
    assert contents(alone).items() <= contents(shared).items()
    assert leftovers(shared) == leftovers(alone) == ["clips/broken.partial"]
    # Without the file that can't be read a shard finds everything made, and nothing is left.
    (tmp_path / "motions" / "broken.bvh").unlink()
    assert shard("2/3").returncode == 0
    assert "nothing is left to merge" in gmrdata("merge", shared).stderr


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
        merging(tmp_path / COMMAND_FILE, record, tmp_path / "out")


@pytest.mark.parametrize(
    ("typed", "out", "merges"),
    [
        (
            ("render", "set.yaml", "--out", "out", "--shard", "2/40", "--redo"),
            "out",
            ["render", "set.yaml", "--out", "out", "--shard", "0/40", "--redo"],
        ),
        (
            ("motions", "a=1/walk.bvh", "--out", "b=2", "--shard", "1/2", "--fps-hz", "30"),
            "b=2",
            ["motions", "a=1/walk.bvh", "--out", "b=2", "--shard", "0/2", "--fps-hz", "30"],
        ),
    ],
)
def test_the_recorded_command_works_on_nothing(
    typed: tuple[str, ...], out: str, merges: list[str], tmp_path: Path
) -> None:
    record = CommandRecord(arguments=typed, folder=str(tmp_path))
    assert merging(tmp_path / COMMAND_FILE, record, tmp_path / out) == merges


def test_flags_are_recorded_as_they_are_meant(tmp_path: Path) -> None:
    typed = ("motions", "a=1/walk.bvh", f"--out={tmp_path}/b=2", "--shard=1/2", "--fps_hz=30")
    with share(typed):
        raise OthersLeft("one is left", failed=False)
    assert CommandRecord.read(tmp_path / "b=2" / COMMAND_FILE).arguments == (
        "motions", "a=1/walk.bvh", "--out", f"{tmp_path}/b=2", "--shard", "1/2", "--fps-hz", "30",
    )  # fmt: skip


@pytest.mark.parametrize("flag", ["--print-slurm", "--print_slurm=2", "--print-kubernetes"])
def test_flags_that_are_gone_name_the_page(flag: str, gmrdata: Gmrdata, tmp_path: Path) -> None:
    answer = gmrdata("motions", tmp_path, "--out", tmp_path / "out", flag, "2")
    assert answer.returncode == 2 and "docs/scale.md, Slurm and Kubernetes" in answer.stderr
    assert not (tmp_path / "out").exists()


def test_what_is_not_shared_says_so(gmrdata: Gmrdata, tmp_path: Path) -> None:
    """Each shard would do the whole work."""
    recipe = tmp_path / "gmr.yaml"
    recipe.write_text("recipe: gmr\n")
    commands = (
        ("run", recipe, "--out", tmp_path / "out", "--shard", "1/2"),
        ("motions", tmp_path, "--shard", "1/2"),
        ("motions", tmp_path, "--layout", "emdb", "--out", tmp_path / "out", "--shard", "1/2"),
    )
    for command in commands:
        answer = gmrdata(*command)
        assert answer.returncode == 1 and "eave " in answer.stderr, answer.stderr
    assert not (tmp_path / "out").exists()
