"""Drawn twin recipes: a function of the seed, with cameras of all classes, and people in view."""

import numpy as np
import pytest

from gmrdata.film.set_plan import planned_clip, select
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.twins.sampling import CLASSES, twin_recipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.camera import in_frame, person_box
from gmrdata.values.camera_motion import MotionClassConfig, classify
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadRecipe, MissingInput

pytestmark = pytest.mark.slow
N, SEED = 7, 5


@pytest.fixture(scope="module")
def drawn(cmu_dir, anny) -> TwinRecipe:
    return twin_recipe(N, SEED, cmu_dir)


def test_all_classes_and_places_and_a_second_person_are_there(drawn):
    clips = drawn.set.clips
    assert (
        len(clips) == len({clip.id for clip in clips}) == len({clip.trial for clip in clips}) == N
    )
    assert {clip.programme.kind for clip in clips} == set(CLASSES)
    scenes = [clip.scene for clip in clips if clip.scene is not None]
    assert {scene.kind for scene in scenes} == {"courtyard", "street", "park", "room"}
    assert [scene.extras.company for scene in scenes] == [0, 1, 0, 0, 0, 1, 0]


def test_what_is_planned_is_whole_in_view_and_of_its_class(drawn, cmu_dir, anny):
    files = select(drawn.set, cmu_dir).files
    for clip in drawn.set.clips:
        planned, _ = planned_clip(clip, drawn.set, files[clip.trial or ""], anny)
        motion, camera = planned.motion, camera_of(planned)
        assert (motion.n_frames, motion.fps_hz) == (150, 30.0)
        assert in_frame(camera, person_box(motion.pelvis_m)).mean() == 1.0
        found, _ = classify(camera.world_from_cam, motion.pelvis_m, 30.0, MotionClassConfig())
        assert found == clip.programme.kind


def test_the_same_seed_draws_the_same_and_fewer_are_the_first_of_more(drawn, cmu_dir):
    assert twin_recipe(3, SEED, cmu_dir).set.clips == drawn.set.clips[:3]
    other = twin_recipe(3, SEED + 1, cmu_dir).set.clips
    assert not {clip.trial for clip in other} & {clip.trial for clip in drawn.set.clips[:3]}
    assert [clip.scene for clip in other] != [clip.scene for clip in drawn.set.clips[:3]]


def test_trials_of_the_bars_are_not_drawn(drawn):
    bars = load_recipe(find_recipe("twins"), TwinRecipe)
    assert not {clip.trial for clip in bars.set.clips} & {clip.trial for clip in drawn.set.clips}


def test_a_drawn_recipe_survives_its_file(drawn, tmp_path):
    import yaml

    path = tmp_path / "drawn.yaml"
    path.write_text(yaml.safe_dump(drawn.model_dump(mode="json")))
    assert load_recipe(path, TwinRecipe) == drawn


def test_too_few_motions_are_reported(tmp_path, cmu_dir, anny):
    with pytest.raises(MissingInput):
        twin_recipe(1, 0, tmp_path / "nowhere")
    with pytest.raises(BadRecipe, match="no motion is left for sequence 0"):
        twin_recipe(1, 0, tmp_path)
    with pytest.raises(BadRecipe, match="at least one"):
        twin_recipe(0, 0, tmp_path)
    for folder in ("a", "b"):  # which of them a recipe means nobody could tell
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "walk.bvh").write_text(f"HIERARCHY of {folder}")
    with pytest.raises(BadRecipe, match=r"2 called as another is \(walk.bvh, walk.bvh\)"):
        twin_recipe(1, 0, tmp_path)


def test_numbers_in_a_recipe_are_short(drawn):
    """A recipe is read by people: no distance of 4.299999999999999 m."""
    for clip in drawn.set.clips:
        for value in clip.programme.model_dump().values():
            if isinstance(value, float):
                assert value == np.round(value, 4)
