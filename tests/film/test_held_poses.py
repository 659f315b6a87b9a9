"""People who hold a pose before a moving camera, as in the Mannequin Challenge."""

from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import Circular, Film, film_motion, plan_clip
from gmrdata.film.scene import Extras, make_cast
from gmrdata.film.set_plan import SyntheticClip, planned_clip
from gmrdata.motion.gait import make_gait
from gmrdata.motion.resample import hold_pose
from gmrdata.score.camera_as_world import find_cameras, recovered_cameras
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import in_frame, person_box
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.world.compose import motion_in_camera, motion_in_world

RECIPE = load_recipe(find_recipe("twins_frozen"), TwinRecipe)


def holds_still(motion: Motion) -> bool:
    rows = (motion.rotmats, motion.pelvis_m)
    return all(np.array_equal(values, np.repeat(values[:1], len(values), 0)) for values in rows)


def test_the_pose_is_that_of_the_moment(small_body: BodyModel) -> None:
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(1))
    held = hold_pose(walk, 0.7, 90)
    assert (held.n_frames, held.fps_hz) == (90, 30.0) and holds_still(held)
    np.testing.assert_array_equal(held.rotmats[50], walk.rotmats[21])
    np.testing.assert_array_equal(held.pelvis_m[50], walk.pelvis_m[21])
    assert held.source.endswith("held at 0.700 s")
    with pytest.raises(BadRecipe, match=r"no pose to hold at 2 s, it lasts 1\.967 s"):
        hold_pose(walk, 2.0, 90)


@pytest.mark.parametrize("clip", RECIPE.set.clips, ids=lambda clip: clip.id)
def test_nobody_moves_in_the_frozen_twins_but_the_camera(
    clip: SyntheticClip, small_body: BodyModel
) -> None:
    planned = planned_clip(clip, RECIPE.set, None, small_body)
    camera = camera_of(planned)
    n_frames = round(30 * (clip.duration_s or RECIPE.set.film.duration_s))
    assert planned.motion.n_frames == n_frames and clip.scene is not None
    assert np.ptp(camera.centres_world_m, axis=0).max() > 0.5
    cast = make_cast(clip.scene.extras, [planned], small_body, clip.scene.seed)
    assert len(cast.walkers) == clip.scene.extras.company
    for motion in (planned.motion, *cast.walkers):
        assert motion.n_frames == n_frames and holds_still(motion)
        lowest_m = motion_vertices_m(small_body, motion.take(slice(0, 1)))[..., 2].min()
        assert abs(lowest_m) < 0.03  # on the ground
        assert in_frame(camera, person_box(motion.pelvis_m)).mean() > 0.9


def test_a_pose_can_be_held_longer_than_the_clip_lasts(small_body: BodyModel) -> None:
    given = {"id": "a", "gait": "walk", "hold_s": 2.5, "duration_s": 1.0}
    clip = SyntheticClip.model_validate(given | {"programme": {"kind": "circular"}})
    motion = planned_clip(clip, RECIPE.set, None, small_body).motion
    assert motion.n_frames == 30 and holds_still(motion)


def test_passers_by_hold_their_poses_too(small_body: BodyModel) -> None:
    motion = hold_pose(make_gait("walk", 2.0, 10.0, small_body, np.random.default_rng(2)), 1.0, 20)
    film = Film(duration_s=2.0, fps_hz=10)
    clip = plan_clip("a", film_motion(motion, film), Circular(), film, np.random.default_rng(3))
    cast = make_cast(Extras(passers_by=2, hold_s=0.5), [clip], small_body, 4)
    assert len(cast.walkers) == 2 and all(map(holds_still, cast.walkers))


@pytest.mark.slow
def test_held_poses_do_not_move_in_the_world_of_recovered_cameras(
    made_set: Path, filmed_set: object, small_body: BodyModel
) -> None:
    """Fig. 6 of the paper: before the camera they turn and travel, in the world they don't."""
    true = filmed_set.truth["arc_00"][0]  # type: ignore[attr-defined]  # of a fixture module
    cameras = camera_of(true).world_from_cam
    seen = motion_in_camera(hold_pose(true.motion, 0.5, true.motion.n_frames), cameras)
    found, known = recovered_cameras(true, find_cameras(made_set / "sequences", "arc_00"))
    assert known.all()
    before_camera, in_world = (
        deltas(motion.root_rotmats[::3], motion.pelvis_m[::3])
        for motion in (seen, motion_in_world(seen, found))
    )
    turn_deg, way_mm = (
        np.rad2deg(angles_rad(in_world[0])),
        1000 * np.linalg.norm(in_world[1], axis=1),
    )
    assert turn_deg.max() < 0.3 and way_mm.max() < 10
    assert np.rad2deg(angles_rad(before_camera[0])).mean() > 10 * turn_deg.mean()
