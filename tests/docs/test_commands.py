"""Each command of the pages is run at small size, here or by another test, or says what it needs.

What stands in a page is tried as it is typed up to the verb: its flags are there, and its values
are of the right kind.  A verb with these flags is run by `RUN`, or by a test that `ELSEWHERE`
names.  A command that neither has must say in the page what it needs: licensed data, a cluster.
"""

import ast
import inspect
import re
import shlex
import shutil
import subprocess
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from gmrdata.cli import main
from gmrdata.cli.options import RunFlags
from gmrdata.cli.recipes import UNSHARED
from gmrdata.cli.shards import SHARED_VERBS
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.train import GmrRecipe
from gmrdata.solve.request import AGAIN, BODY
from gmrdata.solve.verdict import OVERLAY
from gmrdata.solve.videos import PARTS
from gmrdata.stage.recipes import find_recipe, load_recipe, recipe_names
from tests.docs import page_commands as found
from tests.docs.page_commands import Command
from tests.folders import REPOSITORY

pytest_plugins = ("tests.docs.small_world",)

RUN = (
    "motions path/to/cmu --out out/cmu",
    "train out/cmu/motions.yaml --recipe gmr.yaml --held-out out/cmu/motions.yaml --out out/gmr",
    "evaluate out/gmr out/cmu/motions.yaml --out out/scores --protocol wham",
    "baseline zero filmed/manifest.yaml --out out/zero",
    "baseline mean filmed/manifest.yaml --training out/cmu/motions.yaml --out out/mean",
    "baseline camera_as_world filmed/manifest.yaml --camera true --out out/true",
    "evaluate out/zero/predictions filmed/manifest.yaml --out out/zero_scores "
    "--protocol wham --original all",
    "evaluate out/mean/predictions filmed/manifest.yaml --out out/mean_scores "
    "--protocol wham --original all",
    "compare out/zero_scores/scores.json out/mean_scores/scores.json --out out/compared",
    "infer path/to/cmu/16_01.bvh --network out/gmr --fps-hz 100 --out out/world --no-video",
    "export out/gmr --to onnx --out out/exported",
    "manifest check out/cmu/motions.yaml",
    "render synthetic --motions path/to/cmu --out out/synthetic --dry-run --no-probe",
    "render places.yaml --motions path/to/cmu --out out/places --shard 1/1",
    "threedpw list --threedpw 3DPW",
    "threedpw show arc_00 --threedpw 3DPW",
    "threedpw regenerate --threedpw 3DPW --out out/3dpw --recipe my.yaml --dry-run",
    "threedpw regenerate --threedpw 3DPW --out out/3dpw --recipe my.yaml",
    "threedpw compare out/3dpw",
    "export out/3dpw --to colmap tum rrd --images 3DPW/imageFiles --out out/exported",
    "export out/3dpw --to tum kitti --of person --clips arc_00.p0 --out out/people",
    "export out/3dpw --to 3dpw --threedpw 3DPW --out out/again",
    "export out/3dpw --to gem-x --out out/again --dry-run",
)
"""Arguments of `gmrdata` in a folder of small files, in an order in which each finds its input."""

ELSEWHERE = {
    "blender setup": (
        "cli/test_cli.py::test_blender_setup_says_what_it_made_or_why_that_does_not_start"
    ),
    "baseline camera_as_world --camera --cameras --out": (
        "paper/test_baselines.py::test_ignored_true_and_recovered"
    ),
    "baseline joint_train --features --out": "paper/test_joint.py::test_it_learns",
    "baseline joint --features --out": "paper/test_joint.py::test_it_learns",
    "baseline own_poses --out": (
        "paper/test_own_poses.py::test_the_record_says_who_was_seen_and_what_was_left_out"
    ),
    "baseline vibe_cam --poses --keypoints --out": "paper/test_vibe_cam.py::test_the_verb",
    "delta-errors --network --out": (
        "fusion/test_network_evidence.py::test_the_verb_measures_a_run_on_whom_it_held_out"
    ),
    "doctor": "cli/test_cli.py::test_it_finds_what_the_tests_run_with",
    "evaluate --body --floor --out": (
        "score/test_score.py::test_a_floor_is_part_of_what_was_asked"
    ),
    "evaluate --body --person --out": (
        "score/test_results.py::test_three_systems_of_one_sequence_are_compared_by_one_command"
    ),
    "fetch cmu --list --out": "motion/test_cmu.py::test_the_command",
    "fetch models": "read/test_models.py::test_the_command_fetches_once_and_says_where_they_are",
    "floor --sequences --seed --motions --out": (
        "cli/test_cli.py::test_a_dry_run_of_the_floor_samples_and_does_nothing"
    ),
    "floor --twins --out": "twins/test_floor.py::test_the_table_is_printed",
    "fuse --network --errors --loops --out": (
        "cli/test_fusion.py::test_fuse_says_what_it_found_and_writes_a_page"
    ),
    "fuse --network --out --dry-run": (
        "cli/test_fusion.py::test_fuse_says_what_it_found_and_writes_a_page"
    ),
    "masks --out --masks": "people/test_sources.py::test_a_video_and_a_folder_of_masks",
    "merge": "cli/test_videos.py::test_shards_and_merge_leave_the_bytes_of_one_process",
    "page --images": (
        "cli/test_page.py::"
        "test_the_page_has_files_of_one_who_is_accepted_and_none_of_one_who_is_rejected"
    ),
    "sfm --camera-body --masks --out": (
        "cli/test_demo.py::test_sfm_unites_the_silhouette_with_a_detector"
    ),
    "tables --scored --network --poses --keypoints --estimator --out": (
        "paper/test_paper_tables.py::test_every_row_is_made_with_the_network_of_the_package"
    ),
    "tables --manifest --out --workers": (
        "paper/test_paper_tables.py::test_a_table_from_the_command_line_and_again"
    ),
    "tables --manifest --out --workers --dry-run": (
        "paper/test_paper_tables.py::test_a_table_from_the_command_line_and_again"
    ),
    "threedpw twin --out": (
        "twins/test_twin_set.py::test_the_reader_finds_sequences_without_a_problem"
    ),
    "video --out --poses --workers --shard": (
        "cli/test_videos.py::test_two_shards_leave_the_bytes_of_one_process"
    ),
    "video --out --dry-run": (
        "cli/test_videos.py::test_a_dry_run_lists_the_videos_and_does_nothing"
    ),
    "video --out --poses --fps-hz --masks": (
        "cli/test_video.py::test_people_of_vibe_move_in_the_world_as_they_did"
    ),
}
"""Verbs with flags, and the test that runs them; the test's file has all of these words."""
TUTORIAL = "docs/tutorial.md"
"""`test_tutorial.py` runs every command of this page in its order."""


@cache
def parses(arguments: tuple[str, ...]) -> bool:
    try:
        found.parse(arguments)
    except SystemExit:
        return False
    return True


@cache
def gmrdata_commands() -> list[Command]:
    return [command for command in found.commands() if command.arguments]


def test_the_command_line_takes_each_as_it_stands(capsys):
    assert len(gmrdata_commands()) > 90
    refused = [str(command) for command in gmrdata_commands() if not parses(command.arguments)]
    assert refused == [], capsys.readouterr().err


def test_a_command_that_does_not_parse_is_seen(capsys):
    assert not parses(("train", "a.yaml", "--out", "o", "--no-such-flag"))
    assert not parses(("floor", "--out", "o", "--sequences", "many"))
    assert "--no-such-flag" in capsys.readouterr().err


def kind(arguments: tuple[str, ...]) -> tuple[str, frozenset[str]]:
    return found.verb_of(arguments), found.flags_of(arguments)


def is_covered(command: Command) -> bool:
    """Something runs the verb with these flags; a dry run stands for dry runs alone."""
    verb, flags = kind(command.arguments)
    if command.page == TUTORIAL:
        return True
    for text in (*RUN, *ELSEWHERE):
        other, others = kind(tuple(shlex.split(text)))
        if verb == other and flags <= others and not {"--dry-run"} & (flags ^ others):
            return True
    return False


def test_each_is_run_or_says_what_it_needs():
    left = [c for c in gmrdata_commands() if not is_covered(c) and not c.needs]
    assert [str(command) for command in left] == []


def test_the_tests_that_run_them_are_there():
    for text, test in ELSEWHERE.items():
        file, _, name = test.partition("::")
        source = (REPOSITORY / "tests" / file).read_text(encoding="utf-8")
        names = {node.name for node in ast.walk(ast.parse(source)) if hasattr(node, "name")}
        assert name in names, test
        absent = [word for word in text.split() if f'"{word}"' not in source]
        assert not absent, (test, absent)


def test_targets_and_measurements_are_there():
    """`make` has targets of the Makefile; measurements stand in benchmarks/."""
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    options = (REPOSITORY / "benchmarks/conftest.py").read_text(encoding="utf-8")
    for command in found.commands():
        program, *words = command.words
        if program == "make":
            assert words[0] in targets, command
            given = re.findall(r"--[a-z-]+", " ".join(words[1:]))
            assert all(f'"{flag}"' in options for flag in given), command
        elif "pytest" in words:
            files = [word for word in words if word.startswith("benchmarks/")]
            there = [name for name in files if (REPOSITORY / name).is_file()]
            assert there == [name for name in files if name != "benchmarks/FILE.py"], command


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
def test_make_gives_the_demo_a_folder_with_a_space_in_its_name():
    asked = ["make", "--dry-run", "demo", "MOTIONS=my cmu", "OUT=~/my demo"]
    said = subprocess.run(asked, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    (line,) = [line for line in said.stdout.splitlines() if "gmrdata demo" in line]
    assert shlex.split(line)[1:] == ["demo", "--motions", "my cmu", "--out", "~/my demo"]


def test_recipes_that_are_named_are_carried():
    """`--recipe gmr_cmu`, `render synthetic`: a name without a suffix is one of ours."""
    for command in gmrdata_commands():
        words = command.arguments
        named = [b for a, b in pairwise(words) if a == "--recipe"]
        if found.verb_of(words) in ("render", "run", "threedpw twin"):
            named.append(words[len(found.verb_of(words).split())])
        ours = {name for name in named if not Path(name).suffix and name != "RECIPE"}
        assert ours <= set(recipe_names()), command


def text_of(page: str) -> str:
    return (REPOSITORY / page).read_text(encoding="utf-8")


def test_a_name_stands_for_a_recipe_or_for_a_manifest():
    text = "\n".join(page.read_text(encoding="utf-8") for page in found.pages())
    recipes = set(re.findall(r"gmrdata (?:render|run) (\S+\.yaml)", text))
    pairs = [pair for command in gmrdata_commands() for pair in pairwise(command.arguments)]
    manifests = {b for a, b in pairs if a not in ("--recipe", "render", "run")}
    assert "my_set.yaml" in recipes and "set.yaml" in manifests and not recipes & manifests


@pytest.mark.parametrize("page", ["README.md", "docs/training.md", "docs/inference.md"])
def test_commands_of_a_page_can_be_copied_one_after_the_other(page):
    """None finds its folder made by another one."""
    folders = re.findall(r"(?:--out |\bOUT=)([\w/]+)", text_of(page))
    assert len(folders) > 2 and len(set(folders)) == len(folders)


def test_a_recipe_for_several_manifests_finds_those_of_its_page():
    text = text_of("docs/training_data.md")
    (block,) = re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    recipe = GmrRecipe.of_plain(yaml.safe_load(block))
    named = {path.parent.as_posix() for path in (*recipe.training, *recipe.scored)}
    assert named == {"out/amass", "out/h36m"} <= set(re.findall(r"--out (\S+)", text))


def test_the_pages_name_verbs_with_a_dry_run_and_kinds_without():
    (row,) = re.findall(r"^\| `--dry-run` \|.*", text_of("docs/command_line.md"), re.MULTILINE)
    verbs = {
        verb
        for verb, function in found.FUNCTIONS.items()
        if "dry_run" in inspect.signature(function).parameters
    }
    assert set(re.findall(r"`([a-z_ -]+)`", row)) == {"--dry-run", *verbs, *UNSHARED}


def test_the_pages_name_verbs_that_print_json_or_are_shared():
    told = {verb: inspect.signature(function) for verb, function in found.FUNCTIONS.items()}
    (row,) = re.findall(r"^\| `--json` \|.*", text_of("docs/command_line.md"), re.MULTILINE)
    printing = {verb for verb, flags in told.items() if "as_json" in flags.parameters}
    assert set(re.findall(r"`([a-z_ -]+)`", row)) == {"--json", *printing}
    shared = {verb for verb, flags in told.items() if RunFlags in annotations(flags)} - {"demo"}
    assert {verb.split()[0] for verb in shared} == set(SHARED_VERBS)
    taking = re.findall(r"^(.*) take `--shard I/N`\.(.*)", text_of("docs/scale.md"), re.MULTILINE)
    ((verbs, others),) = taking
    assert set(re.findall(r"`([^`]+)`", verbs)) == shared
    assert [kind for kind in (*UNSHARED, "demo") if f"`{kind}`" not in others] == []


def annotations(flags: inspect.Signature) -> list[object]:
    return [parameter.annotation for parameter in flags.parameters.values()]


LEFT = re.compile(r"^## (?:What it leaves|Output)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)


def left_by(page: str) -> set[str]:
    """Names of files and folders at the left of a page's list of what is left behind."""
    (section,) = LEFT.findall(text_of(page))
    lines = re.findall(r"^(?:- (.*?):|\| (.*?) \|)", section.partition("\n\nThe")[0], re.MULTILINE)
    paths = re.findall(r"`([^`]+)`", str(lines))
    return {part for path in paths for part in path.split("/") if part and "<" not in part}


def test_pages_name_what_stages_leave():
    """A video's parts, all of them; of other stages names that stand in the program."""
    parts = {*PARTS, "view3d.html"} - {AGAIN, BODY, OVERLAY}  # for a next run, and the page
    assert left_by("docs/video.md") == parts
    program = "".join(path.read_text() for path in (REPOSITORY / "gmrdata").rglob("*.py"))
    for page in ("synthetic", "threedpw", "inference"):
        named = left_by(f"docs/{page}.md")
        assert len(named) > 5
        assert [name for name in named if not re.search(rf"[\"/]{name}[\"/]", program)] == [], page


def test_where_a_training_differs_from_the_papers_is_said():
    recipe = load_recipe(find_recipe("gmr"), GmrRecipe).train
    assert recipe.model_dump(exclude_defaults=True) == {
        "loss": {"reduction": "sum"},
        "windows": {"all_phases": False},
        "device": "cuda",
    }
    for text in (inspect.getdoc(TrainConfig) or "", text_of("docs/api.md")):
        assert "except for `loss.reduction` and `windows.all_phases`" in " ".join(text.split())


@pytest.mark.parametrize("page", found.pages(), ids=lambda page: page.name)
def test_verbs_in_the_text_have_the_flags_that_it_says(page, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    for arguments in found.inline_commands(page):
        verb, flags = kind(arguments)
        assert verb in found.FUNCTIONS, arguments
        if flags:
            with pytest.raises(SystemExit):
                found.parse((*verb.split(), "--help"))
            told = set(re.findall(r"--[a-z0-9-]+", capsys.readouterr().out))
            assert flags <= told, arguments


@pytest.mark.slow
def test_they_run_at_small_size(small_world, monkeypatch, capsys):
    monkeypatch.chdir(small_world)
    for text in RUN:
        monkeypatch.setattr(sys, "argv", ["gmrdata", *shlex.split(text)])
        try:
            main()
        except SystemExit as ended:
            pytest.fail(f"gmrdata {text}: {ended.code}\n{capsys.readouterr().err}")
