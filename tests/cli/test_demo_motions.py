"""The motion files of a demo: which are filmed, which trained on, and what is said of each."""

import pytest

from gmrdata.cli.demo import choose_files, make_motions, training_entries
from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe
from gmrdata.motion.library import LICENCES
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import DEFAULT_RUN
from gmrdata.values.errors import BadRecipe
from gmrdata.values.files import read_json
from tests.cli.small_demos import TINY
from tests.motion.test_library import write_amass

NAMESAKES = ["BMLrub/rub001/0005_walk1_poses", "BMLrub/rub002/0005_walk1_poses"]
FILMED = "BMLrub/rub001/0001_circle_poses"


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
