"""The command line as a person meets it: exit codes, messages, nothing half-written."""

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.cli import VERBS
from gmrdata.stage.recipes import find_recipe, recipe_kind, recipe_names
from tests.docs.page_commands import FUNCTIONS

Answer = subprocess.CompletedProcess[str]
Gmrdata = Callable[..., Answer]

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  End Site
  {
    OFFSET 0 1 0
  }
}
MOTION
Frames: 2
Frame Time: 0.00833333
0 0 0 0 0 0
0 0 0 0 0 nan
"""


def in_a_process(*arguments: object, **options: object) -> Answer:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.mark.parametrize("verb", list(FUNCTIONS))
def test_help_of_each_verb_says_what_it_does(
    verb: str, gmrdata: Gmrdata, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    answer = gmrdata(*verb.split(), "--help")
    assert answer.returncode == 0, answer.stderr
    first_line = (FUNCTIONS[verb].__doc__ or "").splitlines()[0]
    said = " ".join(answer.stdout.split())
    assert " ".join(first_line.split())[:40] in said


def test_help_comes_from_a_process_of_its_own_too() -> None:
    answer = in_a_process("--help")
    assert answer.returncode == 0, answer.stderr
    assert all(verb in answer.stdout for verb in VERBS)


@pytest.mark.parametrize(
    "arguments", [("fly",), ("demo", "--no-such-flag"), ("render",), ("demo", "--workers", "two")]
)
def test_wrong_flags_exit_with_2(arguments: tuple[str, ...], gmrdata: Gmrdata) -> None:
    answer = gmrdata(*arguments)
    assert answer.returncode == 2
    assert "Traceback" not in answer.stderr


def test_no_argument_is_rewritten(gmrdata: Gmrdata, tmp_path: Path) -> None:
    answer = gmrdata("threedpw", "--threedpw", tmp_path, "--out", tmp_path / "out")
    assert answer.returncode == 2
    assert "gmrdata threedpw regenerate --help" in " ".join(answer.stderr.split())
    assert "regenerate" in gmrdata("threedpw").stderr


def fails_cleanly(answer: Answer, *said: str) -> None:
    assert answer.returncode == 1, answer.stderr
    assert "Traceback" not in answer.stderr
    for text in said:
        assert text in answer.stderr


def test_a_motion_file_with_nan_is_named(gmrdata: Gmrdata, tmp_path: Path) -> None:
    path = tmp_path / "walk.bvh"
    path.write_text(BVH)
    fails_cleanly(gmrdata("motions", path), "walk.bvh")
    assert sorted(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("content", [b"", b"\x00\xff\x13" * 50, BVH[:120].encode()])
def test_a_broken_motion_file_leaves_nothing_behind(
    gmrdata: Gmrdata, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "in" / "walk.bvh"
    path.parent.mkdir()
    path.write_bytes(content)
    fails_cleanly(gmrdata("motions", path, "--out", tmp_path / "out"), "walk.bvh")
    assert not list((tmp_path / "out").rglob("*.npz.tmp*"))
    assert not (tmp_path / "out" / "motions.yaml").exists()


def test_missing_things_are_named(gmrdata: Gmrdata, tmp_path: Path) -> None:
    fails_cleanly(gmrdata("manifest", "check", tmp_path / "no.yaml"), "no.yaml")
    fails_cleanly(gmrdata("manifest", "check"), "Name a manifest file")
    fails_cleanly(gmrdata("demo", "--recipe", "no-such"), "no such recipe file")
    fails_cleanly(gmrdata("report", tmp_path), "recipe.yaml")
    fails_cleanly(gmrdata("demo", "--workers", 0, "--out", tmp_path / "o"), "--workers 0")
    fails_cleanly(gmrdata("run", "no-such", "--out", tmp_path / "o"), "no such recipe file")
    fails_cleanly(gmrdata("floor", "--out", tmp_path / "o"), "Name --motions to sample twins")
    drawn = gmrdata("floor", "--out", tmp_path / "o", "--motions", tmp_path, "--size", "big")
    fails_cleanly(drawn, "--size big: give small, full")
    given = gmrdata("floor", "--out", tmp_path / "o", "--twins", tmp_path / "no")
    fails_cleanly(given, "twins.json: no such file")
    assert not (tmp_path / "o").exists()


def test_a_dry_run_of_the_demo_does_nothing(gmrdata: Gmrdata, tmp_path: Path) -> None:
    out = tmp_path / "demo"
    answer = gmrdata("demo", "--dry-run", "--out", out)
    assert answer.returncode == 0, answer.stderr
    assert "render circular" in answer.stdout and "to do" in answer.stdout
    assert not out.exists()


def test_a_dry_run_of_the_floor_samples_and_does_nothing(
    gmrdata: Gmrdata, tmp_path: Path, cmu_dir: Path
) -> None:
    out = tmp_path / "floor"
    asked = ["floor", "--sequences", 2, "--seed", 5, "--motions", cmu_dir, "--out", out]
    answer = gmrdata(*asked, "--clip-frames", 60, "--dry-run", "--no-probe")
    assert answer.returncode == 0, answer.stderr
    assert "2 clips, 120 frames; to do: 2 clips, 120 frames" in answer.stdout
    assert not out.exists()


def test_a_folder_without_write_permission_and_a_file_limit_end_without_half_files(
    gmrdata: Gmrdata, tmp_path: Path, cmu_dir: Path
) -> None:
    """A limit on file sizes stands for the full disk: both fail in the middle of a write."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    out = tmp_path / "out"
    trial = cmu_dir / "amc" / "02_03.amc"
    answer = in_a_process("motions", trial, "--out", out, preexec_fn=limit)
    fails_cleanly(answer, "run")
    written = [path for path in out.rglob("*") if path.is_file()]
    assert not [path for path in written if ".partial" not in str(path) and path.suffix == ".npz"]
    assert not (out / "motions.yaml").exists()
    again = gmrdata("motions", trial, "--out", out)
    assert again.returncode == 0, again.stderr
    assert gmrdata("manifest", "check", out / "motions.yaml").returncode == 0


def test_motions_are_listed(gmrdata: Gmrdata, cmu_dir: Path) -> None:
    answer = gmrdata("motions", cmu_dir / "amc" / "02_03.amc", cmu_dir / "bvh" / "08_02.bvh")
    assert answer.returncode == 0, answer.stderr
    assert "02_03.amc" in answer.stdout and "08_02.bvh" in answer.stdout


NEEDED = {"threedpw": "--threedpw", "masks": "--frames", "gmr": "--manifest", "table": "--manifest"}
"""Flag without which no recipe of a kind does anything."""


@pytest.mark.parametrize("name", recipe_names())
def test_each_recipe_runs_or_names_the_flag_that_it_lacks(
    name: str, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    kind = recipe_kind(find_recipe(name))
    out = tmp_path / "out"
    if kind in NEEDED:
        fails_cleanly(gmrdata("run", name, "--out", out), NEEDED[kind])
    else:
        fails_without_motions = name in ("synthetic", "synthetic_more", "twins")
        answer = gmrdata("run", name, "--out", out, "--dry-run")
        assert answer.returncode == 0, answer.stderr
        assert ("no motion file" in answer.stdout) == fails_without_motions
        if fails_without_motions:
            fails_cleanly(gmrdata("run", name, "--out", out), "--motions")
    assert not out.exists()
