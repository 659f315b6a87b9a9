"""Recipes: those that travel load; wrong ones are refused with their reason or limit."""

from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cli.demo_recipe import DemoRecipe, Training
from gmrdata.cli.recipes import _folders_of_scores, run
from gmrdata.film.programmes import Film
from gmrdata.film.set_plan import SyntheticRecipe, select
from gmrdata.gmr.config import ModelConfig, TrainConfig
from gmrdata.gmr.train import GmrRecipe
from gmrdata.paper.plan import JointConfig, TableRecipe
from gmrdata.people.silhouette import SilhouetteConfig
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
def test_each_recipe_that_travels_with_gmrdata_loads(name):
    path = find_recipe(name)
    loaded = load_recipe(path, MODELS[recipe_kind(path)])
    assert loaded.model_dump()["recipe"] == recipe_kind(path)


def test_a_recipe_may_name_ten_thousand_clips_and_not_any_number(tmp_path, monkeypatch):
    path = tmp_path / "large.yaml"
    clip = (
        "- {id: walk_%06d, gait: walk, programme: {kind: static, distance_m: 4.0, around_m: 0.5}}\n"
    )
    head = "recipe: synthetic\nname: large\nfilm: {fps_hz: 10}\nclips:\n"
    path.write_text(head + "".join(clip % number for number in range(14_000)))
    assert path.stat().st_size > 1 << 20
    assert recipe_kind(path) == "synthetic"
    monkeypatch.setattr(recipes, "MOST_RECIPE_BYTES", 1 << 20)
    with pytest.raises(BadRecipe, match="more than a recipe. Split it"):
        recipe_kind(path)


def test_scores_of_manifests_of_one_name_have_folders_of_their_own(tmp_path):
    """Each library's is motions.yaml: the second was refused after the training, or lay on the
    first."""
    paths = [tmp_path / name for name in ("cmu/motions.yaml", "bmlrub/motions.yaml", "walks.yaml")]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    named = dict(zip(("cmu_motions", "bmlrub_motions", "walks"), paths, strict=True))
    assert _folders_of_scores(paths) == named
    with pytest.raises(BadRecipe, match="their scores are both cmu_motions"):
        _folders_of_scores([paths[0], paths[0]])
    with pytest.raises(MissingInput, match=r"none\.yaml: no such manifest, which the recipe names"):
        _folders_of_scores([paths[2], tmp_path / "none.yaml"])


def test_the_demo_has_the_three_cameras():
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
def test_a_wrong_recipe_is_refused_with_file_and_place(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="latin1")
    with pytest.raises(BadRecipe) as caught:
        load_recipe(path, DemoRecipe)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


def test_an_unknown_kind_and_an_unknown_name_say_what_there_is(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("recipe: sing\n")
    with pytest.raises(BadRecipe, match="unknown kind 'sing'; there are demo, synthetic, threed"):
        run(str(path), tmp_path / "out", run=DEFAULT_RUN)
    path.write_text("recipe: masks\nsources: [{kind: silhouette}]\n")
    with pytest.raises(MissingInput, match="this recipe needs --frames"):
        run(str(path), tmp_path / "out", run=DEFAULT_RUN)
    with pytest.raises(MissingInput, match="carries only: demo, gmr, gmr_bundled, gmr_cmu, masks"):
        find_recipe("nothing")


def test_a_published_list_is_rendered_as_far_as_its_motions_are_there(cmu_dir, tmp_path):
    recipe = load_recipe(find_recipe("synthetic"), SyntheticRecipe)
    selection = select(recipe, cmu_dir)
    assert [take.id for take in selection.takes] == ["02_03", "08_02", "08_04", "08_05"]
    assert {take.camera_motion for take in selection.takes} == {"panning"}
    assert len(selection.missing) == 46
    with pytest.raises(MissingInput, match="Give their folder with --motions"):
        run("synthetic", tmp_path / "out", run=DEFAULT_RUN)


def test_a_gmr_recipe_without_manifests_says_what_to_do(tmp_path):
    with pytest.raises(MissingInput, match="this recipe needs --manifest"):
        run("gmr", tmp_path / "out", run=DEFAULT_RUN)


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        (ModelConfig, {"hidden": 10**6}, "hidden\n.*less than or equal to 65536"),
        (ModelConfig, {"layers": 10**7}, "layers\n.*less than or equal to 64"),
        (ModelConfig, {"hidden": 60_000}, "hidden 60000 in 4 layers are more than 2000000000"),
        (TrainConfig, {"batch_size": 10**9}, "batch_size\n.*less than or equal to 65536"),
        (TrainConfig, {"batch_size": 65_000}, "batch_size 65000 of windows of 64 frames"),
        (TrainConfig, {"windows": {"frames": 10**9}}, r"windows.frames\n.*equal to 1000000"),
        (TrainConfig, {"windows": {"fps_hz": 1e-9}}, r"windows.fps_hz\n.*equal to 0.1"),
        (TrainConfig, {"threads": 10**6}, "threads\n.*less than or equal to 1024"),
        (TrainConfig, {"seed": 2**64}, "seed\n.*less than or equal to"),
        (TrainConfig, {"learning_rate": float("inf")}, "learning_rate\n.*finite number"),
        (JointConfig, {"frames": 600_000}, "batch_size 32 of windows of 600000 frames"),
        (Film, {"duration_s": 1e9}, "duration_s\n.*less than or equal to 86400"),
        (Film, {"width_px": 10**6}, "width_px\n.*less than or equal to 16384"),
        (Training, {"fps_hz": 1e-9}, "fps_hz\n.*greater than or equal to 1"),
        (SfmConfig, {"max_image_size_px": 10**9}, "max_image_size_px\n.*equal to 16384"),
        (SfmConfig, {"max_reprojection_px": float("inf")}, "max_reprojection_px\n.*finite"),
        (ThreedpwRecipe, {"recipe": "threedpw", "workers": 10**6}, "workers\n.*equal to 1024"),
        (SilhouetteConfig, {"dilate_px": 10**9}, "dilate_px\n.*equal to 1000"),
    ],
)
def test_absurd_sizes(kind, values, said):
    with pytest.raises(ValidationError, match=said):
        kind.model_validate(values)


def test_a_recipe_names_file_key_and_limit(tmp_path):
    path = tmp_path / "gmr.yaml"
    path.write_text(yaml.safe_dump({"recipe": "gmr", "train": {"model": {"hidden": 10**6}}}))
    with pytest.raises(BadRecipe, match=r"gmr\.yaml: 1 wrong:\n  train\.model\.hidden: .* 65536"):
        load_recipe(path, GmrRecipe)


def test_a_hundred_thousand_clips_are_no_problem():
    clip = {"gait": "walk", "programme": {"kind": "static"}}
    clips = [{"id": f"c{n}", **clip} for n in range(1000)] * 100
    recipe: dict[str, Any] = {"recipe": "synthetic", "name": "many", "clips": clips}
    assert len(SyntheticRecipe.model_validate(recipe).clips) == 100_000
    with pytest.raises(ValidationError, match="clips\n.*at most 100000 items"):
        SyntheticRecipe.model_validate(recipe | {"clips": [*clips, clips[0]]})
