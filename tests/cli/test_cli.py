"""The command line as a person meets it: exit codes, messages, nothing half-written."""

import json
import os
import re
import resource
import subprocess
import sys
import tomllib
from importlib import import_module, metadata
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from gmrdata import __version__
from gmrdata.cli import RENAMED, VERBS, lists_of
from gmrdata.film.blender_environment import PYTHON_NAME, blender_python
from gmrdata.read.models import MODELS, models_dir
from gmrdata.stage.recipes import find_recipe, published_manifest, recipe_kind, recipe_names
from gmrdata.values.body import BodyModel
from tests.clip_manifests import write_clips
from tests.docs.page_commands import FUNCTIONS
from tests.fixtures.command_line import Answer, fails_cleanly
from tests.folders import REPOSITORY
from tests.motions import walking_clips

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


LISTED = published_manifest("paper_table8")


def in_a_process(*arguments: object, **options: object) -> Answer:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.mark.parametrize("verb", list(FUNCTIONS))
def test_help_of_each_verb_says_what_it_does(verb, works, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    answer = works(*verb.split(), "--help")
    first_line = (FUNCTIONS[verb].__doc__ or "").splitlines()[0]
    said = " ".join(answer.stdout.split())
    assert " ".join(first_line.split())[:40] in said


def test_a_flag_is_explained_in_whole_lines(gmrdata, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    said = gmrdata("baseline", "vibe_cam", "--help").stdout
    assert "Other clips take the most confident person of each frame." in said


def test_the_usual_help_of_video_fits_a_screen(gmrdata, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    usual, whole = gmrdata("video", "--help").stdout, gmrdata("video", "--help-all").stdout
    assert len(usual.splitlines()) <= 50 and "--poses" in usual and "--focal" not in usual
    assert "Flags of lens, solving, part, networks, run: gmrdata video --help-all" in usual
    assert "--focal" in whole and "--shard" in whole


def test_help_comes_from_a_process_of_its_own_too():
    answer = in_a_process("--help")
    assert answer.returncode == 0, answer.stderr
    assert all(verb in answer.stdout for verb in VERBS)


@pytest.mark.parametrize(
    "arguments", [("fly",), ("demo", "--no-such-flag"), ("render",), ("demo", "--workers", "two")]
)
def test_wrong_flags_exit_with_2(arguments, gmrdata):
    fails_cleanly(gmrdata(*arguments), code=2)


def test_no_argument_is_rewritten(gmrdata, tmp_path):
    answer = gmrdata("threedpw", "--threedpw", tmp_path, "--out", tmp_path / "out")
    fails_cleanly(answer, "gmrdata threedpw regenerate --help", code=2)
    assert "regenerate" in gmrdata("threedpw").stderr


def test_the_home_folder_is_found_where_no_shell_writes_it_out(
    walks_command, gmrdata, works, tmp_path, monkeypatch
):
    """In quotes, as the Makefile gives it, and after `=`, where bash leaves it."""
    command = walks_command(1)
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(here)
    made = gmrdata(*command, "--out=~/walks")
    assert made.stdout.split()[-1] == str(tmp_path / "walks" / "motions.yaml"), made.stderr
    works("manifest", "check", "~/walks/motions.yaml")
    assert not list(here.iterdir())


def test_a_motion_file_with_nan_is_named(gmrdata, tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(BVH)
    fails_cleanly(gmrdata("motions", path), "walk.bvh")
    assert sorted(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("out", "said"),
    [("a", "a file is there, where a folder is needed"), ("a/b", "lies below a file, not in a")],
)
def test_a_file_where_the_output_belongs_has_a_remedy(out, said, walks_command, gmrdata, tmp_path):
    """It was "File exists" and "Not a directory" alone."""
    (tmp_path / "a").write_text("mine")
    answer = gmrdata(*walks_command(1), "--out", tmp_path / out)
    fails_cleanly(answer, f"{tmp_path / out}: {said}", "Choose another --out")
    assert (tmp_path / "a").read_text() == "mine"


@pytest.mark.parametrize("content", [b"", b"\x00\xff\x13" * 50, BVH[:120].encode()])
def test_a_broken_motion_file_leaves_nothing_behind(gmrdata, tmp_path, content):
    path = tmp_path / "in" / "walk.bvh"
    path.parent.mkdir()
    path.write_bytes(content)
    fails_cleanly(gmrdata("motions", path, "--out", tmp_path / "out"), "walk.bvh")
    assert not list((tmp_path / "out").rglob("*.npz.tmp*"))
    assert not (tmp_path / "out" / "motions.yaml").exists()


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("evaluate IN MANIFEST --seed -1", "--seed -1: Input should be"),
        ("evaluate IN MANIFEST --fps-hz inf", "--fps-hz inf: Input should be"),
        ("evaluate IN MANIFEST --fps-hz 0", "--fps-hz 0.0: Input should be greater"),
        ("evaluate IN MANIFEST --first-image -1", "--first-image -1: Input should be greater"),
        ("evaluate IN MANIFEST --person a=", "--person a=: give NAME, CLIP=NAME or SYSTEM/CLIP="),
        ("evaluate IN MANIFEST --person a=1 a=2", "--person a=2: give NAME"),
        ("compare IN IN --seed -1", "--seed -1: Input should be"),
        ("infer IN --bridge-frames 9999999999", "--bridge-frames 9999999999: Input should be"),
        ("infer IN --bridge-frames -1", "--bridge-frames -1: Input should be greater than or"),
        ("infer IN --fps-hz -3", "--fps-hz -3.0: Input should be greater than 0"),
        ("infer IN --fps-hz nan", "--fps-hz nan: Input should be a finite number"),
        ("sfm IN --camera-body CLIP --seed -1", "--seed -1: Input should be"),
        ("video IN --masks none --seed -1", "--seed -1: Input should be"),
        ("video IN --masks none --poses-every 0", "--poses-every 0: Input should be"),
        ("fetch cmu 02_03 --timeout-s inf", "--timeout-s inf: Input should be"),
        ("baseline mean MANIFEST --training MANIFEST --fps-hz 0", "--fps-hz 0.0: Input should be"),
        ("tables 2 --manifest MANIFEST --seeds 1 1", "--seeds 1 1: give each seed once"),
        ("evaluate bundled MANIFEST --person 1", "--person: not for a network"),
        ("evaluate bundled MANIFEST --fps-hz 30", "--fps-hz: not for a network"),
        ("evaluate bundled MANIFEST --predictions-body IN", "--predictions-body: a network's"),
        ("evaluate IN MANIFEST --original gaps --dry-run", "give --protocol too"),
        ("evaluate IN MANIFEST --dry-run --json", "--json: a dry run is told as text"),
        ("video IN --dry-run --json", "--json: a dry run is told as text"),
        ("baseline camera_as_world MANIFEST --cameras IN", "--cameras: for --camera recovered"),
        ("demo --trials 02_03 --dry-run", "--trials: names of files of --motions"),
        ("floor --twins IN --sequences 3", "--twins: no twins are sampled then"),
        ("floor --twins IN --motions IN", "--twins: no twins are sampled then"),
        ("motions IN --layout emdb --fps-hz 25", "--fps-hz: --layout emdb is read as its format"),
        ("motions IN --layout emdb --workers 2", "--workers, --scheduler and --shard are for"),
        ("motions IN --rest-pose tpose --dry-run", "tpose: no such file. --rest-pose takes a BVH"),
        ("motions IN --rest-pose t", "--rest-pose: is for BVH and AMC, and all files are .npz"),
        ("motions IN --joint-map IN --dry-run", "--joint-map: is for BVH and AMC, and all"),
        ("masks IN --camera-body CLIP", "--camera-body is for silhouette, which is not named"),
        ("infer CLIP --joint-map IN", "--joint-map: names joints of a .bvh or .amc, and walk"),
        ("infer CLIP --bridge-frames 3 --dry-run", "--bridge-frames: fills gaps in people"),
        ("motions IN --shard 3/2", "--shard 3/2: give it as 2/4"),
        ("render synthetic --preview --shard 1/2", "--preview: draws all clips at once. Leave"),
        ("render synthetic --preview --dry-run", "--preview: draws all clips at once. Leave"),
        ("export MANIFEST --to", "nothing given. Name a format"),
        ("export MANIFEST --to tum --clips nobody", "no clip nobody; there are walk"),
        ("export CLIP --to tum --which best", "--which: is for onnx alone"),
        ("export bundled --to onnx --clips 02_01", "--clips: onnx is of a training run"),
        ("export CLIP --to tum bvh --observations all", "--observations: is for colmap alone"),
        ("export CLIP --to bvh --of person", "--of: is for tum and kitti alone"),
        ("export IN --to onnx --threedpw IN", "--threedpw: is for 3dpw alone"),
        ("export CLIP --to glb mp4 --truth CLIP", "--truth: is for rrd alone"),
    ],
)
def test_a_number_that_cannot_be_and_a_flag_that_does_nothing_are_refused(
    typed, said, gmrdata, small_body, tmp_path
):
    fails_cleanly(gmrdata(*_with_files(typed, small_body, tmp_path)), said)
    assert not (tmp_path / "out").exists()


def _with_files(typed: str, body: BodyModel, folder: Path) -> list[str]:
    """A command line on a folder, a clip and a manifest of it, with an `--out`."""
    manifest = write_clips(folder / "in", body, walking_clips(body, ["walk"], duration_s=0.2))
    files = {"IN": folder / "in", "MANIFEST": manifest, "CLIP": next(folder.rglob("*.npz"))}
    words = [str(files.get(word, word)) for word in typed.split()]
    return [*words, "--out", str(folder / "out")]


def test_missing_things_are_named(gmrdata, tmp_path):
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
    fails_cleanly(given, f"{tmp_path / 'no'}: no such file or folder")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    "words",
    [
        "video nofile.mp4 --out o",
        "masks nofile.mp4 --out o",
        "motions nofile --layout emdb --out o",
        "infer nofile.npz --out o",
        "evaluate bundled nofile.yaml --out o",
        "evaluate . nofile.yaml --out o",
        "evaluate nofile --out o",
        "train nofile.yaml --out o",
        "train . --body nofile.npz --out o --dry-run",
        "run gmr --manifest nofile.yaml --out o",
        "fuse nofile --out o",
        "compare nofile.json --out o",
        "page nofile",
        "merge nofile",
        "sfm nofile",
        "export nofile",
        "report nofile",
    ],
)
def test_a_file_that_is_not_there_is_named_before_anything_else(
    words, gmrdata, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    answer = gmrdata(*words.split())
    fails_cleanly(answer, "no such file or folder")
    assert answer.stderr.startswith("gmrdata: nofile")


@pytest.mark.parametrize("flag", ["--help", "--version", "--tyro-print-completion"])
def test_a_word_after_a_flag_without_a_verb_is_no_file(flag, gmrdata):
    answer = gmrdata(flag, "bash")
    assert "Traceback" not in answer.stderr and "no such file" not in answer.stderr


@pytest.mark.parametrize("verb", ["run", "render", "floor --recipe", "demo --recipe"])
def test_a_name_too_long_for_a_file_is_said_in_a_line(verb, gmrdata, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = gmrdata(*verb.split(), f"{'r' * 300}.yaml", "--out", "o")
    fails_cleanly(answer, "File name too long")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("manifest check rows.npz", "not a manifest: not UTF-8 text"),
        ("manifest check .", "not a manifest; it is a folder"),
        ("manifest check recipe.yaml", "no top key 'format'; it is a recipe"),
        ("train manifest.yaml --recipe manifest.yaml --out o", "not a recipe; it is a manifest"),
        ("infer manifest.yaml --out o", "holds no poses; it is a manifest"),
    ],
)
def test_a_file_of_another_kind_is_named(words, said, gmrdata, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez(tmp_path / "rows.npz", poses=np.zeros((2, 72)))
    (tmp_path / "recipe.yaml").write_text("recipe: gmr\ntrain: {}\n")
    (tmp_path / "manifest.yaml").write_text("format: gmrdata/1\nname: a\n")
    fails_cleanly(gmrdata(*words.split()), said)


@pytest.mark.parametrize("named", ["training: [a.yaml]", "scored: [a.yaml]", "body: body.npz"])
def test_train_refuses_a_recipe_with_what_it_takes_as_flags(named, gmrdata, tmp_path, monkeypatch):
    """It was trained on the manifests of the command line and scored on none, without a word."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(f"recipe: gmr\n{named}\n")
    (tmp_path / "b.yaml").touch()
    answer = gmrdata("train", "b.yaml", "--recipe", "mine.yaml", "--out", "o")
    fails_cleanly(answer, "mine.yaml: names manifests or a body", "or use `gmrdata run mine.yaml`")


@pytest.mark.parametrize(
    ("named", "flag"), [("training: [a.yaml]", "--manifest"), ("body: body.npz", "--body")]
)
def test_what_a_recipe_names_is_not_given_again(named, flag, gmrdata, tmp_path, monkeypatch):
    """Another body was given, and the recipe's was taken without a word."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(f"recipe: gmr\n{named}\n")
    (tmp_path / "b").touch()
    answer = gmrdata("run", "mine.yaml", flag, "b", "--out", "o")
    key = named.partition(":")[0]
    fails_cleanly(answer, f"mine.yaml: names its `{key}`", f"Leave {flag} out")


@pytest.mark.parametrize(
    ("body", "said"), [("anny", "b.yaml: not a manifest"), ("~/mine.npz", "home/mine.npz: no such")]
)
def test_a_recipe_names_a_body_as_a_flag_does(body, said, gmrdata, tmp_path, monkeypatch):
    """Both were sought as files below the recipe's folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    recipe = tmp_path / "recipes" / "mine.yaml"
    recipe.parent.mkdir()
    recipe.write_text(f"recipe: gmr\nbody: {body}\ntraining: [b.yaml]\n")
    recipe.with_name("b.yaml").touch()
    fails_cleanly(gmrdata("run", recipe, "--out", "o"), said)


TERMINATED = """
import os, signal, time
from gmrdata import cli
def waits() -> None:
    import gmrdata.cameras.colmap
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(60)
def other() -> None: ...
cli.VERBS = {"waits": waits, "other": other}
cli.main(["waits"])
"""


def test_sigterm_ends_as_ctrl_c_does():
    """A cluster's time limit; pycolmap's log would print a stack."""
    call = [sys.executable, "-c", TERMINATED]
    ended = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 143
    assert ended.stderr == "gmrdata: stopped. The same command goes on where it was\n"


def test_a_dry_run_of_the_demo_does_nothing(works, tmp_path):
    out = tmp_path / "demo"
    answer = works("demo", "--dry-run", "--out", out)
    assert "render circular" in answer.stdout and "to do" in answer.stdout
    assert not out.exists()


def test_a_dry_run_of_the_floor_samples_and_does_nothing(works, tmp_path, cmu_dir):
    out = tmp_path / "floor"
    asked = ["floor", "--sequences", 2, "--seed", 5, "--motions", cmu_dir, "--out", out]
    answer = works(*asked, "--clip-frames", 60, "--dry-run", "--no-probe")
    assert "2 clips, 120 frames; to do: 2 clips, 120 frames" in answer.stdout
    assert not out.exists()


def test_a_folder_without_write_permission_and_a_file_limit_end_without_half_files(
    works, tmp_path, cmu_dir
):
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
    works("motions", trial, "--out", out)
    works("manifest", "check", out / "motions.yaml")


def test_motions_are_listed(works, cmu_dir):
    answer = works("motions", cmu_dir / "amc" / "02_03.amc", cmu_dir / "bvh" / "08_02.bvh")
    assert "02_03.amc" in answer.stdout and "08_02.bvh" in answer.stdout


NEEDED = {"threedpw": "--threedpw", "masks": "--frames", "gmr": "--manifest", "table": "--manifest"}
"""Flag without which no recipe of a kind does anything."""


@pytest.mark.parametrize("name", recipe_names())
def test_each_recipe_runs_or_names_the_flag_that_it_lacks(name, gmrdata, works, tmp_path):
    kind = recipe_kind(find_recipe(name))
    out = tmp_path / "out"
    if kind in NEEDED:
        fails_cleanly(gmrdata("run", name, "--out", out), NEEDED[kind])
    else:
        fails_without_motions = name in ("synthetic", "synthetic_more", "twins")
        answer = works("run", name, "--out", out, "--dry-run")
        assert ("no motion file" in answer.stdout) == fails_without_motions
        if fails_without_motions:
            fails_cleanly(gmrdata("run", name, "--out", out), "--motions")
    assert not out.exists()


def test_version(gmrdata):
    said = gmrdata("--version")
    assert (said.returncode, said.stdout) == (0, f"gmrdata {__version__}\n")


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("manifest", "show", LISTED)])
def test_an_answer_that_nobody_takes_ends_in_a_line_at_most(words):
    """`| head` left "writing: Broken pipe" behind, and a full disk a traceback."""
    call = [sys.executable, "-m", "gmrdata", *map(str, words)]
    reader, writer = os.pipe()
    os.close(reader)
    left = subprocess.run(call, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (left.returncode, left.stderr) == (1, "")
    with Path("/dev/full").open("w") as full:
        failed = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True)
    said = "gmrdata: writing: the disk is full. Free some space and run the same command again\n"
    assert (failed.returncode, failed.stderr) == (1, said)


def test_no_text_of_others_commands_the_terminal(tmp_path):
    """Colours and worse of a note were obeyed; letters that an encoding lacks ended it."""
    path = tmp_path / "list.yaml"
    path.write_text(re.sub("note: .*", r'note: "a\\e[31m\\u8d70"', LISTED.read_text()))
    wide = os.environ | {"PYTHONIOENCODING": "ascii", "COLUMNS": "200"}
    answer = in_a_process("manifest", "show", path, env=wide)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert r"a\x1b[31m\u8d70" in answer.stdout and "\x1b" not in answer.stdout


def test_a_name_of_no_letters_is_said(works, walks_command, tmp_path):
    """All was made, and then its path ended in a traceback."""
    out = os.fsdecode(os.fsencode(tmp_path) + b"/\xfc")
    assert works(*walks_command(1), "--out", out).stdout == f"{tmp_path}/\\xfc/motions.yaml\n"


@pytest.mark.parametrize(
    ("typed", "code", "said"),
    [
        ("vidoe x", 2, "there is no verb 'vidoe'; did you mean 'video'?"),
        ("evalute x", 2, "there is no verb 'evalute'; did you mean 'evaluate'?"),
        ("evaluate . --out o", 2, "Missing from gmrdata evaluate: PATH Manifest file."),
        ("xyzzy", 2, "there is no verb 'xyzzy'. `gmrdata --help` lists them"),
        ("run syntetic --out x", 1, "twins_small; did you mean 'synthetic'?"),
        ("infer out/gmr v.pkl --out x", 2, "gmrdata infer v.pkl --network out/gmr"),
        (
            "delta-errors m --network=a --network b --out c",
            2,
            "--network is given 2 times. Give it once, with all its values after it",
        ),
        (
            "video v.mp4 --out c --height-m person_0=1.78 --height_m person_1=1.65",
            2,
            "--height-m is given 2 times. Give it once, with all its values after it",
        ),
        ("export x --to tum --out o --to=bvh", 2, "--to is given 2 times. Give it once"),
        ("baseline mean m --training a --training b", 2, "--training is given 2 times."),
    ],
)
def test_a_wrong_word_gets_the_right_one(gmrdata, typed, code, said):
    fails_cleanly(gmrdata(*typed.split()), said, code=code)


def test_flags_of_several_values_are_found_by_their_types():
    found = {verb: set(lists_of(VERBS[verb])) for verb in VERBS}
    assert {verb: flags for verb, flags in found.items() if flags} == {
        "demo": {"--trials"},
        "masks": {"--classes", "--masks"},
        "sfm": {"--classes", "--masks"},
        "video": {"--classes", "--height-m", "--masks"},
        "threedpw": {"--sequences"},
        "train": {"--held-out"},
        "delta-errors": {"--network", "--people"},
        "fuse": {"--loops"},
        "evaluate": {"--original", "--person"},
        "compare": {"--names"},
        "export": {"--clips", "--to"},
        "baseline": {"--person", "--training"},
        "tables": {"--held-out-subjects", "--seeds"},  # --manifest and --videos may be repeated
    }


def test_every_manifest_is_checked(gmrdata, small_body, tmp_path):
    """It stopped at the first bad one."""
    walk = walking_clips(small_body, ["walk"], duration_s=0.2)
    good = write_clips(tmp_path, small_body, walk)
    gone = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    answer = gmrdata("manifest", "check", gone[0], good, gone[1])
    fails_cleanly(answer, *(f"{path}: no such" for path in gone))
    assert answer.stdout == f"{good}: good\n"


def test_an_old_flag_names_the_new_one(gmrdata):
    assert set(RENAMED) <= set(VERBS)
    for verb, flags in RENAMED.items():
        for flag, now in flags.items():
            for typed in (flag, "--" + flag[2:].replace("-", "_"), f"{flag}=x"):
                said = gmrdata(verb, "x", typed)
                assert said.returncode == 2
                told = f"gmrdata: {verb} {flag} has another name now: {now}"
                assert " ".join(said.stderr.split()) == told


doctor = import_module("gmrdata.cli.doctor")  # beside the verb of that name


@pytest.fixture
def empty_cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/gmrdata"


def test_it_finds_what_the_tests_run_with(works, empty_cache, monkeypatch):
    said = works("doctor", "--json")
    found = json.loads(said.stdout)
    assert found["good"]
    parts = {part["name"]: part for part in found["parts"]}
    for package in ("numpy", "torch", "pycolmap"):
        assert parts[package]["found"] == metadata.version(package)
    assert re.fullmatch(r"5\.\d\.\d", parts["Blender"]["found"])
    assert parts["Blender"]["note"].endswith(f" in {blender_python()}")
    assert [parts[name]["state"] for name in ("export", "view", "tensorboard")] == ["there"] * 3
    assert parts["SMPL"]["state"] == "missing"
    assert f"free in {empty_cache}" in parts["cache"]["found"]
    # The same as a table, with its remedies.
    monkeypatch.setattr(doctor, "find_parts", lambda: [doctor.Finding(**p) for p in parts.values()])
    table = works("doctor")
    said = " ".join(table.stdout.split())  # a note may take several lines
    assert "gmrdata fetch models" in said and "All that" in said


def test_every_extra_of_users_is_looked_for():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert set(doctor.EXTRAS) == set(project["optional-dependencies"]) - {"dev", "docs"}
    for name, extra in doctor.EXTRAS.items():
        assert any(
            line.startswith(extra.package) for line in project["optional-dependencies"][name]
        )


def test_a_missing_required_part_ends_with_1(gmrdata, monkeypatch):
    part = doctor.Finding("packages", "torch", "missing", "", "pip install 'torch>=2.4'", True)
    monkeypatch.setattr(doctor, "find_parts", lambda: [part])
    for flags in ((), ("--json",)):
        said = gmrdata("doctor", *flags)
        fails_cleanly(said, "can't work without: torch")
    assert json.loads(said.stdout)["good"] is False


def test_a_library_that_does_not_load_is_said():
    names = ("json", "no_such_module")
    loaded = doctor._loaded(doctor._start("-c", doctor.LIBRARIES, *names), names)
    assert loaded == ({"json": None, "no_such_module": "No module named 'no_such_module'"}, [])
    died = doctor._loaded(doctor._start("-c", "raise SystemExit(3)"), names)
    assert died == (dict.fromkeys(names, "ended with exit code 3"), [])


def test_blender_that_does_not_start_is_said_with_its_remedy(monkeypatch):
    def part() -> Any:
        return doctor._blender(doctor._start("-c", "raise ImportError('libX.so: not there')"))

    lacking = {"libSM.so.6": "libsm6", "libGL.so.1": "libgl1"}
    monkeypatch.setattr(doctor.environment, "missing_system_libraries", lambda: lacking)
    ended = part()
    assert ended.state == "broken" and ended.required
    assert ended.found == "ImportError: libX.so: not there"
    assert ended.note.endswith("apt-get install --no-install-recommends libsm6 libgl1")
    monkeypatch.setattr(doctor.environment, "missing_system_libraries", dict)
    monkeypatch.delenv(PYTHON_NAME, raising=False)
    assert part().note.endswith("gmrdata blender setup --redo")
    monkeypatch.setenv(PYTHON_NAME, "/no/python")
    assert part().note.endswith("name another one, or unset it")
    gone = doctor.blender_part()
    assert gone.state == "missing" and gone.required and "/no/python: no such program" in gone.note


def test_blender_setup_says_what_it_made_or_why_that_does_not_start(
    gmrdata, works, tmp_path, monkeypatch
):
    asked = Mock(return_value=tmp_path)
    monkeypatch.setattr(doctor.environment, "set_up", asked)
    part = doctor.Finding("blender", "Blender", "there", "5.0.1", "python 3.11.7 in /there")
    monkeypatch.setattr(doctor, "blender_part", lambda: part)
    said = works("blender", "setup", "--python", "3.13", "--redo")
    assert said.stdout == "Blender 5.0.1: python 3.11.7 in /there\n"
    asked.assert_called_once_with("3.13", redo=True)
    part = part._replace(
        state="broken", found="libSM.so.6: no such file", note="render. apt-get it"
    )
    told = f"{tmp_path}: Blender does not start: libSM.so.6: no such file. It is needed for render"
    fails_cleanly(gmrdata("blender", "setup"), told, "apt-get it")


def test_models_and_bodies_are_looked_into(empty_cache):
    assert {part.state for part in doctor._models()} == {"missing"}
    models_dir().mkdir(parents=True)
    (models_dir() / MODELS[0].name).write_bytes(b"not a network")
    first = next(doctor._models())
    assert first.state == "broken" and "--redo" in first.note
    assert not any(part.required and part.state == "missing" for part in doctor._bodies())
