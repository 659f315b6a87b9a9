"""The motion files of a demo: which are filmed, which trained on, and what is said of each."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.cli.demo import choose_files, make_motions, training_entries
from gmrdata.cli.demo_figures import _data_source
from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe
from gmrdata.motion.gait import make_gait
from gmrdata.motion.library import LICENCES, motions_head, write_motions
from gmrdata.motion.resample import resample
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput
from gmrdata.values.files import read_json
from tests.cli.small_demos import TINY
from tests.motion.test_library import write_amass
from tests.motions import save_bare

NAMESAKES = ["BMLrub/rub001/0005_walk1_poses", "BMLrub/rub002/0005_walk1_poses"]
ANEW = Run(redo=True)
FILMED = "BMLrub/rub001/0001_circle_poses"


def test_a_file_that_cannot_be_read_is_left_out_of_those_that_nobody_named(
    tmp_path, small_body, capsys
):
    """One of many ended the demo."""
    folder, paths = tmp_path / "in", DemoPaths(tmp_path / "demo")
    trans = np.linspace([0, 0, 0.9], [2, 0, 0.9], 80)
    write_amass(folder, ["a/0001_circle_poses", "a/0002_walk_poses"], n_frames=80, trans=trans)
    for name in ("0_first.bvh", "z_last.bvh"):
        (folder / name).write_text("HIERARCHY\n")
    changed = {"film": {"duration_s": 1.3}, "training": {"gait_count": 1, "max_files": 5}}
    recipe = DemoRecipe.model_validate(TINY | changed)
    paths.body_dir.mkdir(parents=True)
    save_body(paths.body, small_body)
    files = choose_files(folder, (), recipe, small_body)
    assert [file.id for file in files.filmed] == ["a.0001_circle_poses"]
    make_motions(paths, recipe, files, run=DEFAULT_RUN)
    made = {path.stem for path in paths.training_dir.iterdir()}
    assert made == {"a.0002_walk_poses", "gait_000"}
    said = "".join(capsys.readouterr().err.split())
    assert said.count("0_first.bvh") == 2 and "z_last.bvh" in said
    with pytest.raises(BadMotionFile, match=r"z_last\.bvh"):
        make_motions(paths, recipe, choose_files(folder, ("z_last",), recipe, small_body), run=ANEW)


def test_a_rate_at_which_no_report_can_be_written_is_refused():
    for fps_hz in (10, 20, 30.0, None):
        DemoRecipe.model_validate(TINY | {"film": {"fps_hz": fps_hz}})
    for fps_hz in (24, 25, 5):
        with pytest.raises(ValidationError, match=r"film\.fps_hz: .* Film at 10, 20 or 30"):
            DemoRecipe.model_validate(TINY | {"film": {"fps_hz": fps_hz}})


def test_trials_of_one_name_are_all_trained_on(tmp_path, small_body):
    """AMASS's subjects have trials of the same names."""
    amass, paths = tmp_path / "AMASS", DemoPaths(tmp_path / "demo")
    write_amass(amass, [FILMED, *NAMESAKES], n_frames=80)
    recipe = DemoRecipe.model_validate(TINY | {"training": {"gait_count": 1, "max_files": 5}})
    paths.body_dir.mkdir(parents=True)
    save_body(paths.body, small_body)
    with pytest.raises(BadRecipe, match=r"0005_walk1_poses: .*AMASS has several. Name one of BMLr"):
        choose_files(amass, ("0005_walk1_poses",), recipe, small_body)
    files = choose_files(amass, ("0001_circle_poses",), recipe, small_body)
    made = make_motions(paths, recipe, files, run=DEFAULT_RUN)
    entries = training_entries(paths, files)
    of_files = [(name.replace("/", "."), "AMASS", name, LICENCES["AMASS"]) for name in NAMESAKES]
    assert [(one.id, one.source.dataset, one.source.sequence, one.licence) for one in entries] == [
        *of_files, ("gait_000", "gmrdata", "gait_000", "CC0-1.0")
    ]  # fmt: skip
    ids = [name.replace("/", ".") for name in (FILMED, *NAMESAKES)]
    inputs = read_json(made / "stage.json")["inputs"]
    assert set(inputs) == {"body", *(f"file {id}.npz" for id in ids)}


def demo_of(folder: Path, body: BodyModel) -> tuple[DemoPaths, DemoRecipe]:
    """A demo's folder with its body, and a recipe that films one clip of 1.3 s."""
    paths = DemoPaths(folder)
    paths.body_dir.mkdir(parents=True)
    save_body(paths.body, body)
    training = {"gait_count": 1, "max_files": 5, "fps_hz": 10}
    changed = {"film": {"duration_s": 1.3}, "training": training}
    return paths, DemoRecipe.model_validate(TINY | changed)


def test_frames_without_a_motion_are_neither_filmed_nor_trained_on(tmp_path, small_body):
    """They are filled in where a clip drops them, and counted as truth."""
    paths, recipe = demo_of(tmp_path / "demo", small_body)
    motion = make_gait("walk", 4.0, 30.0, small_body, np.random.default_rng(0))
    (tmp_path / "in").mkdir()
    known = {
        "a_late": np.arange(120) >= 20,
        "b_early": np.arange(120) < 50,
        "c": np.arange(120) < 9,
    }
    for name, valid in known.items():
        save_bare(tmp_path / "in" / f"{name}.npz", small_body, motion, valid)
    files = choose_files(tmp_path / "in", (), recipe, small_body)
    assert [file.id for file in files.filmed] == ["b_early"]
    made = make_motions(paths, recipe, files, run=DEFAULT_RUN)
    assert {path.stem for path in paths.training_dir.iterdir()} == {"a_late", "gait_000"}
    clip = load_clip(made / "training" / "a_late.npz")
    assert clip.motion.fps_hz == 10.0 and clip.valid.tolist() == [n > 6 for n in range(40)]
    named = choose_files(tmp_path / "in", ("a_late",), recipe, small_body)
    with pytest.raises(
        BadMotionFile, match=r"a_late\.npz: 20 of its frames, from frame 0 on, hold"
    ):
        make_motions(paths, recipe, named, run=ANEW)


def test_short_and_slow_motions_are_said_to_be_so_before_they_are_filmed(
    tmp_path, small_body, capsys
):
    """A clip of 8 Hz was rendered and trained beside, and then could not be scored.  With clips
    shorter than 1.2 s no file at all was found to fit; what is too short was not said."""
    paths, recipe = demo_of(tmp_path / "demo", small_body)
    motion = make_gait("walk", 4.0, 30.0, small_body, np.random.default_rng(0))
    for name, one in {
        "a_slow": resample(motion, 8.0),
        "b_short": motion.take(np.arange(33)),
        "c_good": motion,
    }.items():
        valid = np.ones(one.n_frames, dtype=bool)
        save_bare(tmp_path / "in" / f"{name}.npz", small_body, one, valid)
    files = choose_files(tmp_path / "in", (), recipe, small_body)
    assert [file.id for file in files.filmed] == ["c_good"]
    make_motions(paths, recipe, files, run=DEFAULT_RUN)
    assert {path.stem for path in paths.training_dir.iterdir()} == {"gait_000"}
    said = "".join(capsys.readouterr().err.split())
    assert "a_slow.npz:4sat8Hzaretoolittletotrainon" in said
    assert "b_short.npz:1.1sat30Hzaretoolittletotrainon" in said
    named = choose_files(tmp_path / "in", ("a_slow",), recipe, small_body)
    with pytest.raises(BadMotionFile, match=r"a_slow\.npz: 8 Hz, and errors are measured at 10\."):
        make_motions(paths, recipe, named, run=ANEW)
    shorter = DemoRecipe.model_validate(TINY | {"film": {"duration_s": 1.0}})
    files = choose_files(tmp_path / "in", (), shorter, small_body)
    assert [file.id for file in files.filmed] == ["b_short"]
    (tmp_path / "in" / "c_good.npz").unlink()
    found = "0 of 2 files were found to fit: at least 1.2 s, 10 Hz and 0.5 m, at most 7 m"
    with pytest.raises(MissingInput, match=found):
        choose_files(tmp_path / "in", (), recipe, small_body)


def test_a_motion_without_its_skeleton_is_left_out_where_nobody_named_it(tmp_path, small_body):
    """One AMC alone among many files ended the demo."""
    paths, recipe = demo_of(tmp_path / "in" / "demo", small_body)
    trans = np.linspace([0, 0, 0.9], [2, 0, 0.9], 80)
    write_amass(tmp_path / "in", ["a/0001_circle_poses"], n_frames=80, trans=trans)
    for name in ("00_lonely.amc", "zz_lonely.amc"):
        (tmp_path / "in" / name).write_text(":FULLY-SPECIFIED\n:DEGREES\n1\n")
    files = choose_files(tmp_path / "in", (), recipe, small_body)
    make_motions(paths, recipe, files, run=DEFAULT_RUN)
    assert {path.stem for path in paths.training_dir.iterdir()} == {"gait_000"}
    # The demo lies below its motions: a second run takes none of its own clips, and goes on.
    assert choose_files(tmp_path / "in", (), recipe, small_body) == files
    named = choose_files(tmp_path / "in", ("zz_lonely",), recipe, small_body)
    with pytest.raises(MissingInput, match=r"zz_lonely\.amc: its skeleton"):
        make_motions(paths, recipe, named, run=ANEW)


def test_the_report_counts_the_files_that_were_trained_on(tmp_path, small_body):
    """Not those that could not be read, nor those that are never trained on."""
    paths, recipe = demo_of(tmp_path / "demo", small_body)
    trans = np.linspace([0, 0, 0.9], [2, 0, 0.9], 80)
    names = ["a/0001_circle_poses", "a/0002_walk_poses", "CMU/02/02_03_poses"]
    write_amass(tmp_path / "in", names, n_frames=80, trans=trans)
    (tmp_path / "in" / "z_broken.bvh").write_text("HIERARCHY\n")
    files = choose_files(tmp_path / "in", ("0001_circle_poses",), recipe, small_body)
    make_motions(paths, recipe, files, run=DEFAULT_RUN)
    head = motions_head("demo-training", "Motions.", "each its own")
    write_motions(paths.training_manifest, head, training_entries(paths, files))
    said = _data_source(paths, recipe)
    assert said.startswith("Motion files 0001_circle_poses.npz; GMR trained on 1 other files")
