"""Extras: they keep their distance, cross the view and repeat, or hold a pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmrdata.film.programmes import (
    Circular,
    Film,
    Linear,
    LinearPanning,
    Panning,
    Small,
    Static,
    film_motion,
    plan_clip,
    static_twin,
)
from gmrdata.film.scene import Cast, Extras, load_cast, looks_of, make_cast, save_cast, save_extras
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe, planned_clip
from gmrdata.film.walkers import CAR_SIZE_M, HALF_DRIVE_M, move_motion, way_driven_m
from gmrdata.motion.gait import make_gait
from gmrdata.motion.resample import hold_pose
from gmrdata.read.source_motion import ReadConfig
from gmrdata.score.camera_as_world import find_cameras, recovered_cameras
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, in_frame, person_box, project
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.files import read_npz
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.values.transforms import angles_rad
from gmrdata.world.compose import motion_in_camera, motion_in_world
from gmrdata.write.bvh import write_bvh
from tests.motions import random_motion, save_bare

PROGRAMMES = (Circular(), Linear(), Panning(), LinearPanning(), Small(), Static())
EVERYONE = Extras(company=1, passers_by=2, cars=1)


def clip_of(body: BodyModel, number: int, kind: str = "walk", duration_s: float = 4.0) -> Clip:
    rng = np.random.default_rng(number)
    film = Film(fps_hz=10, duration_s=duration_s)
    motion = film_motion(make_gait(kind, duration_s, 10.0, body, rng), film)
    return plan_clip("clip", motion, PROGRAMMES[number % len(PROGRAMMES)], film, rng)


def piece_of(clip: Clip) -> Clip:
    """Two frames, as a dry run's probe renders them."""
    return clip.take(slice(10, 12))


@pytest.fixture(scope="module")
def casts(small_body) -> list[tuple[Clip, Cast]]:
    clips = [clip_of(small_body, number) for number in range(12)]
    return [(clip, make_cast(EVERYONE, [clip], small_body, n)) for n, clip in enumerate(clips)]


def seen(camera: CameraPath, points_m: np.ndarray) -> np.ndarray:
    """(T,) bool: whether a moving point is in the image."""
    points_px = project(camera.world_from_cam, points_m[:, None], camera.intrinsics_px)[:, 0]
    return ((points_px >= 0) & (points_px <= (camera.width_px, camera.height_px))).all(axis=1)


def least_m(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm((a - b)[:, :2], axis=1).min())


def test_people_keep_apart_and_away_from_the_camera(casts):
    for clip, cast in casts:
        people = [clip.motion, *cast.walkers]
        for n, one in enumerate(people):
            for other in people[:n]:
                assert least_m(one.pelvis_m, other.pelvis_m) >= 0.6
        for walker in cast.walkers:
            assert least_m(walker.pelvis_m, camera_of(clip).centres_world_m) >= 1.2


def test_cars_keep_away_from_people_and_the_camera(casts):
    for clip, cast in casts:
        paths_m = [m.pelvis_m for m in (clip.motion, *cast.walkers)]
        for car in cast.cars:
            for path_m, room_m in [
                *((path_m, 0.6) for path_m in paths_m),
                (camera_of(clip).centres_world_m, 1.2),
            ]:
                car_from_world = np.linalg.inv(car.world_from_car)
                local_m = np.einsum("tij,tj->ti", car_from_world, np.c_[path_m, np.ones(40)])
                outside_m = np.abs(local_m[:, :2]) - CAR_SIZE_M[:2] / 2 - room_m / np.sqrt(2)
                assert (outside_m.max(axis=1) > 0).all()


def test_they_are_seen_long_enough(casts):
    for clip, cast in casts:
        company, *passers_by = cast.walkers
        assert seen(camera_of(clip), company.pelvis_m).mean() >= 0.8
        for walker in passers_by:
            assert seen(camera_of(clip), walker.pelvis_m).mean() >= 0.15
        for car in cast.cars:
            assert seen(camera_of(clip), car.world_from_car[:, :3, 3] + (0, 0, 0.7)).sum() >= 4


def bearing_rad(clip: Clip, path_m: np.ndarray) -> np.ndarray:
    """(T,) angle at the camera, on the ground, from the subject to a moving point."""
    centres_m = camera_of(clip).centres_world_m
    rays = [(path - centres_m)[:, :2] @ (1, 1j) for path in (path_m, clip.motion.pelvis_m)]
    return np.asarray(np.angle(rays[0] / rays[1]))


def test_passers_by_cross_the_line_of_sight_to_the_subject(casts):
    in_front = []
    for clip, cast in casts:
        for walker in cast.walkers[1:]:
            row = int(np.abs(bearing_rad(clip, walker.pelvis_m)).argmin())
            assert np.abs(bearing_rad(clip, walker.pelvis_m)[row]) < 1e-6
            away_m = [
                np.linalg.norm((path_m - camera_of(clip).centres_world_m)[row, :2])
                for path_m in (walker.pelvis_m, clip.motion.pelvis_m)
            ]
            in_front.append(away_m[0] < away_m[1])
    assert 4 <= sum(in_front) <= len(in_front) - 4


def test_company_goes_beside_its_subject_at_its_pace(casts):
    for clip, cast in casts:
        company, subject = cast.walkers[0].pelvis_m[:, :2], clip.motion.pelvis_m[:, :2]
        assert 0.9 <= np.linalg.norm((company - subject).mean(axis=0)) <= 1.5
        ways = [path[-1] - path[0] for path in (company, subject)]
        assert np.linalg.norm(ways[0] - ways[1]) < 0.2 * np.linalg.norm(ways[1])
        assert np.linalg.norm(company - subject, axis=1).max() < 2.0


def test_feet_stay_on_the_ground(casts, small_body):
    for _, cast in casts[:3]:
        for walker in cast.walkers:
            lowest_m = motion_vertices_m(small_body, walker)[..., 2].min(axis=1)
            assert np.abs(lowest_m).max() < 0.03


def test_extras_reach_blender_as_they_are(casts, tmp_path):
    cast = casts[0][1]
    save_cast(tmp_path / "cast.npz", cast)
    there = load_cast(tmp_path / "cast.npz")
    assert len(there.walkers) == 3 and len(there.cars) == 1
    for one, other in zip((*cast.walkers, *cast.cars), (*there.walkers, *there.cars), strict=True):
        for name, value in vars(one).items():
            assert type(vars(other)[name]) is type(value)
            np.testing.assert_array_equal(vars(other)[name], value)


def test_each_choice_is_its_own(small_body):
    clip = clip_of(small_body, 2)
    full = make_cast(EVERYONE, [clip], small_body, 3)
    again = make_cast(EVERYONE, [clip], small_body, 3)
    fewer = make_cast(Extras(company=1, passers_by=1), [clip], small_body, 3)
    for one, two in ((full, again), (full, fewer)):
        for a, b in zip(one.walkers, two.walkers, strict=False):
            assert a.pelvis_m.tobytes() == b.pelvis_m.tobytes()
            assert a.local_rotmats.tobytes() == b.local_rotmats.tobytes()
    assert full.cars[0].world_from_car.tobytes() == again.cars[0].world_from_car.tobytes()
    other = make_cast(EVERYONE, [clip], small_body, 4)
    assert other.walkers[0].pelvis_m.tobytes() != full.walkers[0].pelvis_m.tobytes()
    assert make_cast(Extras(), [clip], small_body, 3).ground_m.shape == (0, 3)
    draws = [looks_of(name, 3).random() for name in EVERYONE.names]
    assert len(set(draws)) == len(EVERYONE.names) == 4


def test_a_twin_has_the_same_extras_and_they_suit_both_cameras(small_body):
    clip = clip_of(small_body, 0)
    twin = replace(clip, camera=static_twin(camera_of(clip), clip.motion.pelvis_m))
    cast = make_cast(EVERYONE, [clip, twin], small_body, 1)
    for each in (clip, twin):
        for walker in cast.walkers:
            assert least_m(walker.pelvis_m, camera_of(each).centres_world_m) >= 1.2
            assert seen(camera_of(each), walker.pelvis_m).mean() >= 0.15


def test_a_shorter_clip_rests_at_its_end_while_the_extras_go_on(small_body):
    long, short = clip_of(small_body, 2), clip_of(small_body, 2, duration_s=2.0)
    cast = make_cast(Extras(passers_by=1), [short, long], small_body, 1)
    assert cast.walkers[0].n_frames == 40


@pytest.mark.parametrize("kind", ["circle", "side_step", "turn"])
def test_other_subjects_and_long_clips_find_extras_too(small_body, kind):
    clip = clip_of(small_body, 2, kind, duration_s=12.0)
    cast = make_cast(Extras(passers_by=1, cars=1, company=1), [clip], small_body, 0)
    assert np.ptp(cast.walkers[1].pelvis_m[:, :2], axis=0).max() < 14


def test_no_room_is_said(small_body):
    clip = clip_of(small_body, 5)
    camera = camera_of(clip)
    away = camera.world_from_cam.copy()
    away[:, :3, 2] *= -1  # it looks the other way
    away[:, :3, 0] *= -1
    blind = replace(clip, camera=replace(camera, world_from_cam=away))
    with pytest.raises(BadRecipe, match="company_1 can't be beside its subject"):
        make_cast(Extras(company=1), [blind], small_body, 0)
    crowd = Extras(company=2, passers_by=8)
    lens_px = camera.intrinsics_px * [[30], [30], [1]]
    far = replace(clip, camera=replace(camera, intrinsics_px=lens_px, width_px=20, height_px=10))
    with pytest.raises(BadRecipe, match="(company|passer_by)_1 .*distance_m"):
        make_cast(crowd.model_copy(update={"company": 0}), [far], small_body, 0)


def test_motions_from_files(small_body, tmp_path):
    clip, rng = clip_of(small_body, 2), np.random.default_rng(5)
    run = make_gait("run", 6.0, 30.0, small_body, rng, shape=np.zeros(10))
    extras = Extras(passers_by=1, motions=(save_bare(tmp_path / "run.npz", small_body, run),))
    walker = make_cast(extras, [clip], small_body, 0).walkers[0]
    speed_m_per_s = np.linalg.norm(np.diff(walker.pelvis_m, axis=0), axis=1).mean() * 10
    assert walker.n_frames == 40 and speed_m_per_s > 2 and "run.npz" in walker.source
    assert walker.shape.any()  # not the runner's build
    lowest_m = motion_vertices_m(small_body, walker)[..., 2].min(axis=1)
    assert lowest_m.min() > -0.05 and np.median(lowest_m) < 0.05
    long = clip_of(small_body, 2, duration_s=8.0)
    with pytest.raises(BadRecipe, match=r"run\.npz lasts 6\.00 s, and it takes 8\.00 s"):
        make_cast(extras, [long], small_body, 0)


def test_frames_that_hold_no_motion_are_not_filmed(small_body, tmp_path):
    """A clip of somebody who left the picture for a second; the frames between are filled."""
    walk = make_gait("walk", 6.0, 30.0, small_body, np.random.default_rng(5))
    seen = ~np.isin(np.arange(180), np.arange(60, 90))
    path = save_bare(tmp_path / "walk.npz", small_body, walk, seen)

    def planned(**said: float) -> Clip:
        given = {"id": "a", "trial": "walk", "programme": {"kind": "static"}} | said
        return planned_clip(SyntheticClip.model_validate(given), RECIPE.set, path, small_body)[0]

    why = r"walk\.npz: 30 of its frames, from frame 60 on, hold no motion\. Take a part that does"
    with pytest.raises(BadMotionFile, match=why):
        planned(duration_s=4.0)
    with pytest.raises(BadMotionFile, match="1 of its frames, from frame 75 on"):
        planned(duration_s=1.0, hold_s=2.5)
    assert planned(duration_s=2.0).valid.all() and planned(duration_s=1.0, hold_s=3.5).valid.all()
    extras = Extras(passers_by=1, motions=(path,))
    with pytest.raises(BadMotionFile, match="hold no motion"):  # any 4 s of it
        make_cast(extras, [clip_of(small_body, 2)], small_body, 0)


@settings(max_examples=25)
@given(yaw_rad=st.floats(-7, 7), seed=st.integers(0, 99))
def test_a_moved_motion_moves_alike(yaw_rad, seed):
    rng = np.random.default_rng(seed)
    motion, to_m = random_motion(rng, 6), rng.normal(size=2)
    path_m = motion.pelvis_m
    moved = move_motion(motion, yaw_rad, path_m[2, :2], to_m)
    np.testing.assert_allclose(moved.pelvis_m[2], [*to_m, path_m[2, 2]], atol=1e-12)
    np.testing.assert_allclose(moved.pelvis_m[:, 2], path_m[:, 2], atol=1e-12)
    for a, b in zip(
        deltas(motion.root_rotmats, motion.pelvis_m),
        deltas(moved.root_rotmats, moved.pelvis_m),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, atol=1e-12)


@given(speed=st.floats(3, 8))
@settings(max_examples=25)
def test_a_drive_is_even_in_the_middle_and_rests_at_its_ends(speed):
    time_s = np.linspace(-8, 8, 3201)
    way_m = way_driven_m(time_s, speed)
    speeds = np.diff(way_m) / np.diff(time_s)
    np.testing.assert_allclose(way_m, -way_m[::-1], atol=1e-12)
    assert way_m[-1] == pytest.approx(HALF_DRIVE_M) and (speeds > -1e-9).all()
    assert speeds.max() == pytest.approx(speed, rel=1e-6)
    assert np.abs(np.diff(speeds)).max() <= 4.5 * 0.005 + 1e-9  # no jerk of more than its brakes


def test_files_of_the_truth(casts, small_body, tmp_path):
    clip, cast = casts[2]
    save_extras(tmp_path / "extras", EVERYONE.names, cast, clip, small_body)
    assert sorted(path.stem for path in (tmp_path / "extras").iterdir()) == sorted(EVERYONE.names)
    company = load_clip(tmp_path / "extras/company_1.npz")
    assert company.id == "clip_company_1" and company.valid.all()
    np.testing.assert_allclose(company.motion.pelvis_m, cast.walkers[0].pelvis_m, atol=1e-12)
    np.testing.assert_array_equal(camera_of(company).world_from_cam, camera_of(clip).world_from_cam)
    car = read_npz(tmp_path / "extras/car_1.npz")
    assert car.keys() == {"world_from_car", "size_m"}
    np.testing.assert_array_equal(car["world_from_car"], cast.cars[0].world_from_car)
    np.testing.assert_array_equal(car["size_m"], CAR_SIZE_M)


@pytest.mark.parametrize("number", range(6))
def test_two_frames_of_a_clip_are_enough(small_body, number):
    """A dry run's probe renders no more."""
    piece = piece_of(clip_of(small_body, number))
    cast = make_cast(EVERYONE, [piece], small_body, 0)
    assert [walker.n_frames for walker in cast.walkers] == [2, 2, 2]
    assert cast.cars[0].world_from_car.shape == (2, 4, 4)


RECIPE = load_recipe(find_recipe("twins_frozen"), TwinRecipe)


def holds_still(motion: Motion) -> bool:
    rows = (motion.rotmats, motion.pelvis_m)
    return all(np.array_equal(values, np.repeat(values[:1], len(values), 0)) for values in rows)


def test_the_pose_is_that_of_the_moment(small_body):
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(1))
    held = hold_pose(walk, 0.7, 90)
    assert (held.n_frames, held.fps_hz) == (90, 30.0) and holds_still(held)
    np.testing.assert_array_equal(held.rotmats[50], walk.rotmats[21])
    np.testing.assert_array_equal(held.pelvis_m[50], walk.pelvis_m[21])
    assert held.source.endswith("held at 0.700 s")
    with pytest.raises(BadRecipe, match=r"no pose to hold at 2 s, it lasts 1\.967 s"):
        hold_pose(walk, 2.0, 90)


@pytest.mark.parametrize("clip", RECIPE.set.clips, ids=lambda clip: clip.id)
def test_nobody_moves_in_the_frozen_twins_but_the_camera(clip, small_body):
    planned, _ = planned_clip(clip, RECIPE.set, None, small_body)
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


def test_a_pose_can_be_held_longer_than_the_clip_lasts(small_body):
    given = {"id": "a", "gait": "walk", "hold_s": 2.5, "duration_s": 1.0}
    clip = SyntheticClip.model_validate(given | {"programme": {"kind": "circular"}})
    motion = planned_clip(clip, RECIPE.set, None, small_body)[0].motion
    assert motion.n_frames == 30 and holds_still(motion)


def test_passers_by_hold_their_poses_too(small_body):
    motion = hold_pose(make_gait("walk", 2.0, 10.0, small_body, np.random.default_rng(2)), 1.0, 20)
    film = Film(duration_s=2.0, fps_hz=10)
    clip = plan_clip("a", film_motion(motion, film), Circular(), film, np.random.default_rng(3))
    cast = make_cast(Extras(passers_by=2, hold_s=0.5), [clip], small_body, 4)
    assert len(cast.walkers) == 2 and all(map(holds_still, cast.walkers))


@pytest.mark.parametrize(("hold_s", "held_s"), [(6.0, "6.000"), (6.05, "6.067"), (7.25, "7.267")])
def test_a_gait_lasts_until_any_pose_that_is_to_be_held(small_body, hold_s, held_s):
    """A time in the middle between two frames may be nearer to one that the gait lacked."""
    given = {"id": "a", "gait": "walk", "hold_s": hold_s, "programme": {"kind": "static"}}
    recipe = SyntheticRecipe.model_validate({"recipe": "synthetic", "name": "s", "clips": [given]})
    (clip,) = recipe.clips
    assert planned_clip(clip, recipe, None, small_body)[0].motion.source.endswith(f"{held_s} s")
    short = recipe.model_copy(update={"film": Film(duration_s=0.01)})
    with pytest.raises(BadMotionFile, match=r"0\.01 s are too short to film; it takes 0\.17 s"):
        planned_clip(clip, short, None, small_body)


@pytest.mark.parametrize("hold_s", [0.4, 0.35, 2.5])  # 0.35 s lie between two frames
@pytest.mark.parametrize("subject", ["stands", "walks"])
def test_a_pose_can_be_held_that_comes_after_the_end_of_a_piece(small_body, subject, hold_s):
    clip = clip_of(small_body, 2)
    if subject == "stands":
        clip = replace(clip, motion=hold_pose(clip.motion, 1.0, 40))
    extras = Extras(company=1, passers_by=1, hold_s=hold_s)
    cast = make_cast(extras, [piece_of(clip)], small_body, 0)
    assert [walker.n_frames for walker in cast.walkers] == [2, 2]
    assert all(map(holds_still, cast.walkers))
    assert all(f"held at {round(hold_s * 10) / 10:.3f} s" in one.source for one in cast.walkers)


def test_a_pose_of_a_file_can_be_held_that_comes_after_the_end_of_a_piece(small_body, tmp_path):
    walk = make_gait("walk", 1.5, 30.0, small_body, np.random.default_rng(5), shape=np.zeros(10))
    write_bvh(tmp_path / "walk.bvh", walk, small_body)
    extras = Extras(passers_by=1, hold_s=1.0, motions=(tmp_path / "walk.bvh",))
    piece = piece_of(clip_of(small_body, 2))
    (walker,) = make_cast(extras, [piece], small_body, 0).walkers
    assert walker.n_frames == 2 and holds_still(walker)
    late = extras.model_copy(update={"hold_s": 1.5})
    with pytest.raises(BadRecipe, match=r"walk\.bvh lasts 1\.50 s, and it takes 1\.60 s"):
        make_cast(late, [piece], small_body, 0)


def test_motions_are_read_as_the_extras_say(small_body, tmp_path):
    """Of a file whose header has four times its rate, a passer-by went four times too fast."""
    walk = make_gait("walk", 6.0, 30.0, small_body, np.random.default_rng(5), shape=np.zeros(10))
    write_bvh(tmp_path / "walk.bvh", replace(walk, fps_hz=120.0), small_body)
    extras = Extras(passers_by=1, motions=(tmp_path / "walk.bvh",), read=ReadConfig(fps_hz=30))
    (walker,) = make_cast(extras, [clip_of(small_body, 2)], small_body, 0).walkers
    speeds_m_per_s = [
        np.linalg.norm((one.pelvis_m[-1] - one.pelvis_m[0])[:2]) * one.fps_hz / (one.n_frames - 1)
        for one in (walker, walk)
    ]
    assert speeds_m_per_s[0] == pytest.approx(speeds_m_per_s[1], rel=0.2)  # legs differ in length
    unsaid = extras.model_copy(update={"read": None})
    with pytest.raises(BadRecipe, match=r"walk\.bvh lasts 1\.50 s, and it takes 4\.00 s"):
        make_cast(unsaid, [clip_of(small_body, 2)], small_body, 0)


def test_the_pose_that_is_held_is_the_files_at_that_time(small_body, tmp_path):
    """A piece of the file was drawn first, and the time counted from its start."""
    walk = make_gait("walk", 12.0, 10.0, small_body, np.random.default_rng(5))
    path = save_bare(tmp_path / "walk.npz", small_body, walk)
    extras = Extras(passers_by=2, hold_s=0.5, motions=(path,))
    for walker in make_cast(extras, [clip_of(small_body, 2)], small_body, 4).walkers:
        assert holds_still(walker) and walker.source.endswith("held at 0.500 s")
        np.testing.assert_allclose(walker.local_rotmats[0], walk.local_rotmats[5], atol=1e-9)


@pytest.mark.slow
def test_held_poses_do_not_move_in_the_world_of_recovered_cameras(made_set, filmed_set):
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
