"""What a set's recipe may say, and each clip's own person and place."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from benchmarks.training.default_body import (
    BMI_KG_PER_M2,
    STATURES_M,
    coefficients,
    further_directions,
    principal_directions,
    within_bounds,
)
from gmrdata.film.character import phenotypes_of, sample_person
from gmrdata.film.render import RenderConfig
from gmrdata.film.scene import Extras, SceneConfig
from gmrdata.film.set_plan import (
    SyntheticRecipe,
    clip_rng,
    plan_takes,
    planned_clip,
    render_config,
    select,
)
from gmrdata.motion.files import read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import on_ground
from gmrdata.motion.library import library_files
from gmrdata.read.body_file import read_body, save_body
from gmrdata.read.source_motion import ReadConfig
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.values.body import JOINT, PHENOTYPES
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadBodyFile, BadRecipe
from gmrdata.values.records import with_absolute_paths
from gmrdata.values.skinning import motion_vertices_m
from tests.motions import save_bare

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


def plan(recipe: SyntheticRecipe, body_path: Path, folder: Path) -> dict[str, Path]:
    """Files of the planned clips."""
    jobs, reasons = plan_takes(select(recipe, None), body_path, folder, folder)
    assert not reasons
    return {id: job.clip_path for id, job in jobs.items()}


def test_a_clip_is_the_same_whatever_others_there_are(body_path, tmp_path):
    many, few = recipe_of(), recipe_of(("side_step", "walk"))
    plans = plan(many, body_path, tmp_path / "many"), plan(few, body_path, tmp_path / "few")
    for clip in few.clips:
        first, second = (planned[clip.id].read_bytes() for planned in plans)
        assert first == second
        assert render_config(many, clip) == render_config(few, clip)


def test_every_clip_has_another_person(body_path, tmp_path):
    recipe = recipe_of()
    planned = plan(recipe, body_path, tmp_path)
    shapes = np.stack([load_clip(planned[kind]).motion.shape for kind in KINDS])
    assert (shapes.std(axis=0) > 0.2).all()
    seeds = {render_config(recipe, clip).person.seed for clip in recipe.clips}
    assert len(seeds) == len(KINDS) and None not in seeds
    again = plan(recipe, body_path, tmp_path / "again")
    for kind in KINDS:
        assert planned[kind].read_bytes() == again[kind].read_bytes()


def test_another_seed_gives_other_people_and_places():
    first, second = recipe_of(), recipe_of(seed=4)
    for clip in first.clips:
        assert render_config(first, clip).person != render_config(second, clip).person
    assert [render_config(first, c).scene for c in first.clips] != [
        render_config(second, c).scene for c in first.clips
    ]


def test_a_twin_has_the_person_and_the_place_of_its_clip(body_path, tmp_path):
    recipe = recipe_of(("walk",), camera_off=True)
    selection = select(recipe, None)
    jobs, _ = plan_takes(selection, body_path, tmp_path, tmp_path)
    clip, twin = selection.takes
    assert (clip.id, twin.id) == ("walk", "walk_off")
    of_clip, of_twin = (load_clip(jobs[take.id].clip_path).motion for take in selection.takes)
    np.testing.assert_array_equal(of_twin.shape, of_clip.shape)
    assert render_config(recipe, twin.clip) == render_config(recipe, clip.clip)


def test_a_trial_s_name_that_two_motions_have_is_refused(tmp_path):
    clip = {"id": "walk", "trial": "walk", "programme": {"kind": "static"}}
    recipe = SyntheticRecipe.model_validate({"recipe": "synthetic", "name": "set", "clips": [clip]})
    paths = [tmp_path / name / "walk.bvh" for name in ("a", "b")]
    for path in paths:
        path.parent.mkdir()
        path.write_text("HIERARCHY")
    assert select(recipe, tmp_path).files.keys() == {"walk"}  # a copy is no other motion
    paths[1].write_text("HIERARCHY of another")
    with pytest.raises(BadRecipe, match=r"trial walk: .*a/walk.bvh and .*b/walk.bvh both"):
        select(recipe, tmp_path)
    paths[1].rename(tmp_path / "b" / "run.bvh")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "run.bvh").write_text("HIERARCHY")
    assert select(recipe, tmp_path).files["walk"] == paths[0]


def test_a_shape_that_is_nobodys_leaves_the_others(body_path, small_body, tmp_path):
    """A giant was filmed without a word, and somebody turned inside out ended the set."""
    walk = {"gait": "walk", "programme": {"kind": "small"}}
    sizes = {"giant": 1e4, "inside_out": -1e4, "usual": 2.0}
    clips = [walk | {"id": id, "shape": [size] * small_body.n_shape} for id, size in sizes.items()]
    recipe = recipe_of(clips=[*clips, walk | {"id": "short", "shape": [1.0]}])
    jobs, reasons = plan_takes(select(recipe, None), body_path, tmp_path / "plan", tmp_path)
    assert jobs.keys() == {"usual"} and reasons.keys() == {"giant", "inside_out", "short"}
    for id in ("giant", "inside_out"):
        assert re.fullmatch(
            rf"clip {id}: shape: its legs are [\d.e+]+ m long, which nobody's are; .*", reasons[id]
        )
    assert f"takes a shape of {small_body.n_shape} finite numbers" in reasons["short"]


def test_a_motion_that_lacks_its_skeleton_leaves_the_others(body_path, tmp_path):
    """The whole set ended with it."""
    (tmp_path / "02_01.amc").write_text(":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 0 0 0 0 0\n")
    walk = {"id": "walk", "gait": "walk", "programme": {"kind": "small"}}
    recipe = recipe_of(
        clips=[walk, {"id": "cmu", "trial": "02_01", "programme": {"kind": "small"}}]
    )
    jobs, reasons = plan_takes(select(recipe, tmp_path), body_path, tmp_path / "plan", tmp_path)
    assert jobs.keys() == {"walk"} and reasons.keys() == {"cmu"}
    assert "its skeleton 02.asf is not beside it" in reasons["cmu"]


def test_a_file_that_is_not_there_leaves_the_others(body_path, tmp_path):
    """A dry run said that such a clip is to do, and the run found out in its turn."""
    extras, gone = {"passers_by": 1, "motions": ["gone.bvh"]}, {"path": "gone.blend"}
    lacking = {
        "gone.hdr": {"scene": {"hdri_path": "gone.hdr"}},
        "gone.blend": {"scene": {"kind": "blend", "backdrop": gone}},
        "gone.bvh": {"scene": {"extras": extras}},
        "gone.glb": {"character": {"path": "gone.glb"}},
    }
    walk = {"gait": "walk", "programme": {"kind": "small"}}
    clips = [walk | {"id": name[5:]} | said for name, said in lacking.items()]
    recipe = recipe_of(clips=[*clips, walk | {"id": "walk"}], camera_off=True)
    jobs, reasons = plan_takes(select(recipe, None), body_path, tmp_path / "plan", tmp_path)
    assert jobs.keys() == {"walk", "walk_off"}
    wanted = {name[5:] + off: f"{name}: no such file" for name in lacking for off in ("", "_off")}
    assert reasons == wanted


def test_files_of_passers_by_are_read_once_and_before_the_set(
    small_body, body_path, tmp_path, monkeypatch
):
    """One that chance did not take was told of when all was rendered, and at each run again."""
    walk = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0))
    (tmp_path / "cut.bvh").write_text("HIERARCHY")
    paths = [save_bare(tmp_path / "walk.npz", small_body, walk), tmp_path / "cut.bvh"]
    place, walk_by = tmp_path / "plan", {"gait": "walk", "programme": {"kind": "small"}}
    clips = [
        walk_by | {"id": id, "scene": {"extras": {"passers_by": 1, "motions": motions}}}
        for id, motions in (("one", paths[:1]), ("both", paths))
    ]
    chosen = select(recipe_of(clips=clips), None)
    jobs, reasons = plan_takes(chosen, body_path, place, tmp_path)
    assert jobs.keys() == {"one"} and "cut.bvh: no BVH file" in reasons["both"]
    monkeypatch.setattr("gmrdata.film.set_plan.read_file", None)
    again = select(recipe_of(clips=clips[:1]), None)
    assert plan_takes(again, body_path, place, tmp_path)[0] == jobs


@pytest.mark.parametrize("off_m", [0.4, -0.3, 0.0])
def test_a_motion_of_the_sets_own_body_is_put_on_the_ground(small_body, tmp_path, off_m):
    """In a world whose floor is elsewhere it was filmed in the air, or below the ground."""
    walk = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0))
    off_floor = replace(walk, pelvis_m=walk.pelvis_m + np.array([0, 0, off_m]))
    path = save_bare(tmp_path / "walk.npz", small_body, off_floor)
    clip = {"id": "walk", "trial": "walk", "programme": {"kind": "small"}}
    recipe = recipe_of(clips=[clip], people={})
    motion = planned_clip(recipe.clips[0], recipe, path, small_body)[0].motion
    assert np.abs(motion_vertices_m(small_body, motion)[..., 2].min(axis=1)).max() < 0.03
    assert motion.source.endswith(", put on the floor") == (off_m != 0.0)
    turned = Rotation.from_euler("x", 180, degrees=True).as_matrix() @ walk.root_rotmats
    upside_down = replace(walk, root_rotmats=turned, pelvis_m=[0, 0, 1.2] - walk.pelvis_m)
    assert on_ground(small_body, upside_down) is upside_down


def test_passers_by_from_files_are_read_as_the_set_says(tmp_path):
    names = tmp_path / "names.yaml"
    extras = {"passers_by": 1, "motions": ["walk.bvh"]}
    said = {"fps_hz": 30, "joint_map": names}

    def found(read: dict[str, object], /, **own: object) -> Extras:
        recipe = recipe_of(read=read, scenes=[{"kind": "park", "extras": extras | own}])
        return render_config(recipe, recipe.clips[0]).scene.extras

    of_set = found(said)
    assert of_set.read == ReadConfig(fps_hz=30, joint_map=names)
    assert of_set.inputs == {"extras_motion0": Path("walk.bvh"), "extras_joint_map": names}
    assert found(said, read={"up": "y"}).read == ReadConfig(up="y")
    assert found(said, motions=[]).read is None
    assert Extras.model_validate_json(of_set.model_dump_json()) == of_set
    # What was rendered before there was the key is not made again.
    before = {"company": 0, "passers_by": 1, "cars": 0, "hold_s": None, "motions": ["walk.bvh"]}
    assert found({}).model_dump(mode="json") == before


def test_motions_have_the_origin_that_the_library_gives_them(tmp_path):
    for name in ("AMASS/KIT/3/kick_poses.npz", "AMASS/02_03.bvh"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"broken, so that reading says so")
    clips = [
        {"id": f"c{n}", **motion, "programme": {"kind": "small"}}
        for n, motion in enumerate(({"trial": "kick_poses"}, {"trial": "02_03"}, {"gait": "run"}))
    ]
    recipe, folder = recipe_of(clips=clips), tmp_path / "AMASS"
    selection = select(recipe, folder)
    found = [selection.source(clip) for clip in recipe.clips]
    assert [(source.dataset, source.sequence) for source in found] == [
        ("AMASS", "KIT/3/kick_poses"),
        ("CMU", "02_03"),
        ("gmrdata", "run"),
    ]
    known = {file.path: file.source for file in library_files((folder,))}
    assert found[:2] == [known[selection.files[trial]] for trial in ("kick_poses", "02_03")]


def test_places_are_those_of_the_list_and_seeds_are_drawn_unless_given():
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


def test_what_a_clip_says_itself_counts(body_path, tmp_path):
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


def test_without_variety_all_clips_are_rendered_alike():
    recipe = recipe_of(people={}, scenes=[], render={"samples": 2, "scene": {"seed": 9}})
    for clip in recipe.clips:
        assert render_config(recipe, clip) == recipe.render
    said = recipe_of(render={"person": {"seed": 1}})
    assert {render_config(said, clip).person.seed for clip in said.clips} == {1}
    assert recipe_of().render == RenderConfig()


def test_choices_do_not_share_their_numbers():
    drawn = [clip_rng(0, "a", c).random() for c in ("motion", "person", "looks", "place")]
    assert (
        len({*drawn, clip_rng(0, "b", "motion").random(), clip_rng(1, "a", "motion").random()}) == 6
    )


def test_table_8_varies_people_and_places():
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
def test_light_suits_the_place(said, lit_by):
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
        ({"extras": {"motions": ["walk.bvh"]}}, "extras.motions: are for passers-by; give"),
        ({"extras": {"cars": 1, "hold_s": 0.5}}, "extras.hold_s: nobody is asked for who"),
        ({"kind": "moon"}, "Input should be 'courtyard', 'street', 'park', 'room' or 'blend'"),
    ],
)
def test_what_cannot_be(said, message):
    with pytest.raises(ValidationError, match=message):
        SceneConfig.model_validate(said)


def test_a_sky_is_an_input_with_a_full_path_for_the_renderer(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = SceneConfig(hdri_path=Path("sky.hdr"))
    assert scene.inputs == {"hdri": Path("sky.hdr")}
    assert with_absolute_paths(scene).hdri_path == tmp_path / "sky.hdr"
    (tmp_path / "a.bvh").touch()
    scene = SceneConfig.model_validate({"extras": {"passers_by": 1, "motions": ["a.bvh"]}})
    assert scene.inputs == {"extras_motion0": Path("a.bvh")}
    assert with_absolute_paths(scene).extras.motions == (tmp_path / "a.bvh",)
    assert SceneConfig().inputs == {}
    assert with_absolute_paths(SceneConfig()) == SceneConfig()


@pytest.fixture(scope="module")
def shapes(anny) -> np.ndarray:
    """200 people."""
    return np.stack([sample_person(anny, np.random.default_rng(seed)) for seed in range(200)])


def test_200_people_are_within_the_bounds_of_usual_adults(anny, shapes):
    vertices_m = anny.template_m + np.einsum("vcs,ns->nvc", anny.shape_dirs_m, shapes)
    stature_m = np.ptp(vertices_m[:, :, 1], axis=1)
    a, b, c = (vertices_m[:, anny.faces[:, k]] for k in range(3))
    bmi = 1000 * np.einsum("nfi,nfi->n", a, np.cross(b, c)) / 6 / stature_m**2
    # Drawn people differ a little from the listed ones, who are within.
    assert STATURES_M[0] - 0.03 < stature_m.min() < 1.55
    assert 1.88 < stature_m.max() < STATURES_M[1] + 0.03
    assert BMI_KG_PER_M2[0] - 1 < bmi.min() < 18 and 30 < bmi.max() < BMI_KG_PER_M2[1] + 1
    joints_m = np.stack([anny.rest_joints_m(shape) for shape in shapes])
    leg_m = joints_m[:, JOINT["left_hip"], 1] - joints_m[:, JOINT["left_ankle"], 1]
    assert (leg_m / stature_m).min() > 0.41 and (leg_m / stature_m).max() < 0.53


def test_all_phenotypes_and_coefficients_vary(anny, shapes):
    assert (shapes.std(axis=0) > 0.5).all()
    drawn = [phenotypes_of(anny, shape) for shape in shapes]
    spread = {name: np.ptp([person[name] for person in drawn if person]) for name in PHENOTYPES}
    assert min(spread.values()) > 0.25, spread
    assert anny.adult_phenotypes is not None
    gender = anny.adult_phenotypes[:, PHENOTYPES.index("gender")]
    assert ((gender < 0.1) | (gender > 0.9)).mean() > 0.5


def test_every_person_is_whole(anny, shapes):
    """No shape turns triangles over: all are within a right angle of the mean person's."""

    def normals(vertices_m: np.ndarray) -> np.ndarray:
        a, b, c = (vertices_m[anny.faces[:, k]] for k in range(3))
        crossed = np.cross(b - a, c - a)
        return crossed / np.maximum(np.linalg.norm(crossed, axis=1), 1e-12)[:, None]

    usual = normals(anny.template_m)
    for shape in shapes[::10]:
        turned = (normals(anny.template_m + anny.shape_dirs_m @ shape) * usual).sum(axis=1) < 0
        assert turned.mean() < 0.002


def test_the_same_state_gives_the_same_person_and_no_two_are_alike(anny, shapes):
    np.testing.assert_array_equal(sample_person(anny, np.random.default_rng(7)), shapes[7])
    assert len(np.unique(shapes, axis=0)) == len(shapes)
    np.testing.assert_array_equal(
        sample_person(anny, np.random.default_rng(7), spread=0.5), 0.5 * shapes[7]
    )


def test_a_body_without_a_list_gets_coefficients_within_two_deviations(small_body):
    drawn = np.stack([sample_person(small_body, np.random.default_rng(n)) for n in range(100)])
    assert drawn.shape == (100, 10) and 1.5 < np.abs(drawn).max() <= 2
    assert phenotypes_of(small_body, drawn[0]) is None


def test_feet_are_on_the_ground_for_each_shape(anny, shapes, cmu_dir):
    """The short, the tall and someone between, on a captured level walk and the embedded one."""
    legs_m = [-anny.rest_joints_m(shape)[JOINT["left_ankle"], 1] for shape in shapes]
    for person in np.argsort(legs_m)[[0, 100, -1]]:
        shape = shapes[person]
        captured = read_motion(cmu_dir / "amc" / "02_01.amc", anny, shape=shape)
        generated = make_gait("walk", 3.0, 10.0, anny, np.random.default_rng(1), shape=shape)
        for motion, step in ((captured, 24), (generated, 3)):
            np.testing.assert_array_equal(motion.shape, shape)
            rows = np.arange(0, motion.n_frames, step)
            lowest_m = motion_vertices_m(anny, motion, rows)[..., 2].min(axis=1)
            assert np.abs(lowest_m).mean() < 0.02


def test_the_list_of_adults_is_kept_and_checked(small_body, tmp_path):
    shapes, phenotypes = np.eye(10)[:4], np.full((4, 6), 0.5)
    body = replace(small_body, adult_shapes=shapes, adult_phenotypes=phenotypes)
    save_body(tmp_path / "body.npz", body)
    found = read_body(tmp_path / "body.npz")
    assert found.adult_shapes is not None
    np.testing.assert_array_equal(found.adult_shapes, shapes)
    assert phenotypes_of(found, shapes[2]) == dict.fromkeys(PHENOTYPES, 0.5)
    for wrong in ({"adult_phenotypes": None}, {"adult_shapes": np.eye(9)[:4]}):
        save_body(tmp_path / "wrong.npz", replace(body, **wrong))
        with pytest.raises(BadBodyFile, match="adult_shapes"):
            read_body(tmp_path / "wrong.npz")


def test_further_directions_take_up_what_the_first_leave():
    rng = np.random.default_rng(0)
    points_m = rng.normal(size=(30, 5, 3)) @ np.diag([3.0, 2.0, 1.0])
    mean_m, dirs_m = principal_directions(points_m, 8)
    others_m = points_m[::2] * 1.5 + 0.1
    more_m = further_directions(others_m, mean_m, dirs_m, 6)
    flat, more = dirs_m.reshape(15, 8), more_m.reshape(15, 6)
    np.testing.assert_allclose(flat.T @ more, 0, atol=1e-10)
    both_m = np.concatenate([dirs_m, more_m], axis=-1)
    shapes = coefficients(others_m, mean_m, both_m)
    left_m = others_m - mean_m - np.einsum("pcs,ns->npc", both_m, shapes)
    np.testing.assert_allclose(left_m.reshape(-1, 15) @ both_m.reshape(15, 14), 0, atol=1e-9)


def test_who_is_too_tall_too_small_too_heavy_or_too_light_is_left_out(anny):
    mean_m = anny.template_m
    wide = np.array([1.35, 1.0, 1.35])
    people_m = np.stack([mean_m, 1.25 * mean_m, 0.8 * mean_m, mean_m * wide, mean_m / wide])
    assert within_bounds(people_m, anny.faces).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(
    ("said", "where"),
    [({"version": "1.0"}, "version"), ({"clips": [{"id": "-a"}]}, r"clips\.0\.id")],
)
def test_what_no_manifest_takes_is_refused_before_any_work(said, where):
    """They were refused when all was rendered."""
    with pytest.raises(ValidationError, match=where):
        SyntheticRecipe.model_validate({"recipe": "synthetic", "name": "set"} | said)
