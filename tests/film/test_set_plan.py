"""What a set's recipe may say, and each clip's own person and place."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.film.render import RenderConfig, full_json
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import (
    SyntheticRecipe,
    clip_rng,
    plan_takes,
    render_config,
    select,
)
from gmrdata.read.body_file import save_body
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import load_clip

KINDS = ("walk", "run", "turn", "circle", "side_step")
SCENES = [{"kind": "street"}, {"kind": "park", "light": "overcast"}, {"kind": "room", "seed": 5}]


def recipe_of(kinds: tuple[str, ...] = KINDS, **said: object) -> SyntheticRecipe:
    """A set of gaits, each clip called by its kind."""
    clips = [{"id": kind, "gait": kind, "programme": {"kind": "small"}} for kind in kinds]
    film = {"duration_s": 0.6, "fps_hz": 10}
    return SyntheticRecipe.model_validate(
        {"recipe": "synthetic", "name": "s", "seed": 3, "clips": clips, "film": film}
        | {"people": {"vary": True}, "scenes": SCENES}
        | said
    )


@pytest.fixture(scope="module")
def body_path(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("body") / "body.npz"
    save_body(path, small_body)
    return path


def plan(recipe: SyntheticRecipe, body_path: Path, folder: Path) -> dict[str, Path]:
    """Files of the planned clips."""
    jobs, reasons = plan_takes(select(recipe, None), body_path, folder, folder)
    assert not reasons
    return {id: job.clip_path for id, job in jobs.items()}


def test_a_clip_is_the_same_whatever_others_there_are(body_path: Path, tmp_path: Path) -> None:
    many, few = recipe_of(), recipe_of(("side_step", "walk"))
    plans = plan(many, body_path, tmp_path / "many"), plan(few, body_path, tmp_path / "few")
    for clip in few.clips:
        first, second = (planned[clip.id].read_bytes() for planned in plans)
        assert first == second
        assert render_config(many, clip) == render_config(few, clip)


def test_every_clip_has_another_person(body_path: Path, tmp_path: Path) -> None:
    recipe = recipe_of()
    planned = plan(recipe, body_path, tmp_path)
    shapes = np.stack([load_clip(planned[kind]).motion.shape for kind in KINDS])
    assert (shapes.std(axis=0) > 0.2).all()
    seeds = {render_config(recipe, clip).person.seed for clip in recipe.clips}
    assert len(seeds) == len(KINDS) and None not in seeds
    again = plan(recipe, body_path, tmp_path / "again")
    for kind in KINDS:
        assert planned[kind].read_bytes() == again[kind].read_bytes()


def test_another_seed_gives_other_people_and_places() -> None:
    first, second = recipe_of(), recipe_of(seed=4)
    for clip in first.clips:
        assert render_config(first, clip).person != render_config(second, clip).person
    assert [render_config(first, c).scene for c in first.clips] != [
        render_config(second, c).scene for c in first.clips
    ]


def test_a_twin_has_the_person_and_the_place_of_its_clip(body_path: Path, tmp_path: Path) -> None:
    recipe = recipe_of(("walk",), camera_off=True)
    selection = select(recipe, None)
    jobs, _ = plan_takes(selection, body_path, tmp_path, tmp_path)
    clip, twin = selection.takes
    assert (clip.id, twin.id) == ("walk", "walk_off")
    of_clip, of_twin = (load_clip(jobs[take.id].clip_path).motion for take in selection.takes)
    np.testing.assert_array_equal(of_twin.shape, of_clip.shape)
    assert render_config(recipe, twin.clip) == render_config(recipe, clip.clip)


def test_places_are_those_of_the_list_and_seeds_are_drawn_unless_given() -> None:
    recipe = recipe_of()
    clips = [recipe.clips[0].model_copy(update={"id": f"c{n}"}) for n in range(60)]
    scenes = [render_config(recipe, clip).scene for clip in clips]
    assert {(s.kind, s.lit_by) for s in scenes} == {
        ("street", "sun"),
        ("park", "overcast"),
        ("room", "indoor"),
    }
    assert {s.seed for s in scenes if s.kind == "room"} == {5}
    drawn = [s.seed for s in scenes if s.kind != "room"]
    assert len(set(drawn)) == len(drawn)


def test_what_a_clip_says_itself_counts(body_path: Path, tmp_path: Path) -> None:
    clip = {"id": "walk", "gait": "walk", "programme": {"kind": "small"}}
    clip |= {"scene": {"kind": "park", "seed": 8}, "shape": [0.5] * 10}
    recipe = recipe_of(clips=[clip])
    assert render_config(recipe, recipe.clips[0]).scene.model_dump(exclude_defaults=True) == {
        "kind": "park",
        "seed": 8,
    }
    planned = plan(recipe, body_path, tmp_path)
    np.testing.assert_array_equal(load_clip(planned["walk"]).motion.shape, np.full(10, 0.5))
    wrong = recipe_of(clips=[clip | {"shape": [1.0, 2.0]}])
    _, reasons = plan_takes(select(wrong, None), body_path, tmp_path / "wrong", tmp_path)
    assert "takes a shape of 10 finite numbers" in reasons["walk"]


def test_without_variety_all_clips_are_rendered_alike() -> None:
    recipe = recipe_of(people={}, scenes=[], render={"samples": 2, "scene": {"seed": 9}})
    for clip in recipe.clips:
        assert render_config(recipe, clip) == recipe.render
    said = recipe_of(render={"person": {"seed": 1}})
    assert {render_config(said, clip).person.seed for clip in said.clips} == {1}
    assert recipe_of().render == RenderConfig()


def test_choices_do_not_share_their_numbers() -> None:
    drawn = [clip_rng(0, "a", c).random() for c in ("motion", "person", "looks", "place")]
    assert (
        len({*drawn, clip_rng(0, "b", "motion").random(), clip_rng(1, "a", "motion").random()}) == 6
    )


def test_table_8_varies_people_and_places() -> None:
    recipe = load_recipe(find_recipe("synthetic"), SyntheticRecipe)
    clip = recipe_of().clips[0]
    configs = [render_config(recipe, clip.model_copy(update={"id": f"c{n}"})) for n in range(50)]
    assert {config.scene.kind for config in configs} == {"courtyard", "street", "park", "room"}
    assert {config.scene.lit_by for config in configs} == {"sun", "overcast", "indoor"}
    assert len({config.person.seed for config in configs}) == 50


@pytest.mark.parametrize(
    ("said", "lit_by"),
    [
        ({}, "sun"),
        ({"kind": "street"}, "sun"),
        ({"kind": "room"}, "indoor"),
        ({"kind": "park", "light": "overcast"}, "overcast"),
        ({"kind": "room", "light": "indoor"}, "indoor"),
    ],
)
def test_light_suits_the_place(said: dict[str, str], lit_by: str) -> None:
    assert SceneConfig.model_validate(said).lit_by == lit_by


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"kind": "room", "light": "sun"}, "a room has no other"),
        ({"kind": "street", "light": "indoor"}, "`indoor` is for a room"),
        ({"kind": "room", "hdri_path": "sky.hdr"}, "no sky is seen from a room"),
        ({"kind": "room", "extras": {"cars": 1}}, "a car doesn't fit a room"),
        ({"extras": {"dogs": 1}}, "Extra inputs are not permitted"),
        ({"extras": {"passers_by": -1}}, "greater than or equal to 0"),
        ({"kind": "moon"}, "Input should be 'courtyard', 'street', 'park', 'room' or 'blend'"),
    ],
)
def test_what_cannot_be(said: dict[str, str], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SceneConfig.model_validate(said)


def test_a_sky_is_an_input_with_a_full_path_for_the_renderer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = SceneConfig(hdri_path=Path("sky.hdr"))
    assert scene.inputs == {"hdri": Path("sky.hdr")}
    assert json.loads(full_json(scene))["hdri_path"] == str(tmp_path / "sky.hdr")
    (tmp_path / "a.bvh").touch()
    scene = SceneConfig.model_validate({"extras": {"passers_by": 1, "motions": ["a.bvh"]}})
    assert scene.inputs == {"extras_motion0": Path("a.bvh")}
    assert json.loads(full_json(scene))["extras"]["motions"] == [str(tmp_path / "a.bvh")]
    assert SceneConfig().inputs == {}
    assert SceneConfig.model_validate_json(full_json(SceneConfig())) == SceneConfig()
