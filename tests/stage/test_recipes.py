"""Recipes: those that travel with gmrdata load, and wrong ones are refused with their reason."""

from pathlib import Path

import pytest

from gmrdata.cli.demo_recipe import DemoRecipe
from gmrdata.cli.recipes import run
from gmrdata.film.set_plan import SyntheticRecipe, select
from gmrdata.gmr.train import GmrRecipe
from gmrdata.paper.plan import TableRecipe
from gmrdata.people.sources import MasksRecipe
from gmrdata.stage import recipes
from gmrdata.stage.recipes import find_recipe, load_recipe, recipe_kind
from gmrdata.stage.run import DEFAULT_RUN
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.errors import BadRecipe, MissingInput

MODELS = {
    "demo": DemoRecipe,
    "synthetic": SyntheticRecipe,
    "gmr": GmrRecipe,
    "masks": MasksRecipe,
    "threedpw": ThreedpwRecipe,
    "threedpw_twin": TwinRecipe,
    "table": TableRecipe,
}


@pytest.mark.parametrize("name", recipes.recipe_names())
def test_each_recipe_that_travels_with_gmrdata_loads(name: str) -> None:
    path = find_recipe(name)
    loaded = load_recipe(path, MODELS[recipe_kind(path)])
    assert loaded.model_dump()["recipe"] == recipe_kind(path)


def test_the_demo_has_the_three_cameras() -> None:
    demo = load_recipe(find_recipe("demo"), DemoRecipe)
    assert [clip.programme.kind for clip in demo.clips] == ["circular", "linear", "panning"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recipe: demo\nclips: []\nsede: 1\n", "sede: Extra inputs are not permitted"),
        ("recipe: demo\nclips: []\n", "clips: Tuple should have at least 1 item"),
        ("recipe: demo\nclips: []\nseed: '1'\n", "seed: Input should be a valid integer"),
        ("recipe: demo\nclips: []\nseed: true\n", "seed: Input should be a valid integer"),
        ("recipe: demo\nclips: []\nworkers: 2.0\n", "workers: Input should be a valid integer"),
        ("- a\n- b\n", "a recipe is a mapping"),
        ("recipe: [demo\n", "not plain YAML"),
        ("\x00\xff", "not plain YAML"),
        (
            "recipe: demo\nclips: [{id: a, gait: walk, programme: {kind: spiral}}]\n",
            "clips.0.programme",
        ),
        (
            "recipe: demo\nclips:\n"
            "- {id: a, gait: walk, programme: {kind: static}}\n"
            "- {id: a, gait: run, programme: {kind: static}}\n",
            "clip ids must be unique",
        ),
    ],
)
def test_a_wrong_recipe_is_refused_with_file_and_place(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="latin1")
    with pytest.raises(BadRecipe) as caught:
        load_recipe(path, DemoRecipe)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


def test_an_unknown_kind_and_an_unknown_name_say_what_there_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("recipe: sing\n")
    with pytest.raises(BadRecipe, match="unknown kind 'sing'; there are demo, synthetic, threed"):
        run(str(path), tmp_path / "out", run=DEFAULT_RUN)
    path.write_text("recipe: masks\nsources: [{kind: silhouette}]\n")
    with pytest.raises(MissingInput, match="this recipe needs --frames"):
        run(str(path), tmp_path / "out", run=DEFAULT_RUN)
    with pytest.raises(MissingInput, match="carries only: demo, gmr, gmr_bundled, gmr_cmu, masks"):
        find_recipe("nothing")


def test_a_published_list_is_rendered_as_far_as_its_motions_are_there(
    cmu_dir: Path, tmp_path: Path
) -> None:
    recipe = load_recipe(find_recipe("synthetic"), SyntheticRecipe)
    selection = select(recipe, cmu_dir)
    assert [take.id for take in selection.takes] == ["02_03", "08_02", "08_04", "08_05"]
    assert {take.camera_motion for take in selection.takes} == {"panning"}
    assert len(selection.missing) == 46
    with pytest.raises(MissingInput, match="Give their folder with --motions"):
        run("synthetic", tmp_path / "out", run=DEFAULT_RUN)


def test_a_gmr_recipe_without_manifests_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="this recipe needs --manifest"):
        run("gmr", tmp_path / "out", run=DEFAULT_RUN)
