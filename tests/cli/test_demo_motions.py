"""The motion files of a demo: which are filmed, which trained on, and what is said of each."""

import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.cli.demo import choose_files, make_motions, training_entries
from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe
from gmrdata.motion.library import LICENCES
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.files import read_json
from tests.cli.small_demos import TINY
from tests.motion.test_library import write_amass

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
