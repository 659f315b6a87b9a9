"""Metric scale from planted feet, the ground and a data set's own path, with exact cameras."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.programmes import Circular, Linear, Programme, Small, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import motion_of
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, invert, rigid
from gmrdata.world import scale
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.planted_feet import (
    SOLE_POINTS,
    SeenFeet,
    foot_points_m,
    ground_contact_scale,
    standing,
)
from gmrdata.world.recipe import CueEstimate, ScaleConfig
from gmrdata.world.scale import ScaleEstimate, SeenPerson, estimate_scale, fuse, short_windows_scale

CONFIG = ScaleConfig()
CIRCULAR, LINEAR = Circular(), Linear()


@cache
def filmed(
    gait: str, programme: Programme, body: BodyModel, seed: int, fps_hz: float = 10.0
) -> tuple[Motion, CameraPath]:
    """A world motion, and the exact camera that films it; nobody changes them."""
    motion = make_gait(gait, 4.8, fps_hz, body, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    return motion, camera_path(programme, motion.pelvis_m, fps_hz, 640, 360, 60.0, rng)


def seen_through(
    path: CameraPath, metres_per_unit: float, noise_m: float, noise_rad: float, seed: int
) -> CameraPath:
    """The path as a reconstruction gives it: in its own unit, with errors."""
    rng = np.random.default_rng(seed)
    noisy = path.world_from_cam.copy()
    turns = rng.normal(0, noise_rad, (len(noisy), 3))
    noisy[:, :3, :3] = noisy[:, :3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    noisy[:, :3, 3] = (noisy[:, :3, 3] + rng.normal(0, noise_m, (len(noisy), 3))) / metres_per_unit
    return replace(path, world_from_cam=noisy)


def scale_of(
    body: BodyModel,
    motion: Motion,
    path: CameraPath,
    found: CameraPath | None = None,
    config: ScaleConfig = CONFIG,
) -> ScaleEstimate:
    """Of one person whom a camera films, with the path as it was found; the true one for None."""
    return estimate_scale([seen_person(body, motion, path, found)], "full", config)


def seen_person(
    body: BodyModel, motion: Motion, path: CameraPath, found: CameraPath | None = None
) -> SeenPerson:
    person = motion_in_camera(motion, path.world_from_cam)
    return SeenPerson(person, body, path if found is None else found)


@pytest.mark.parametrize("programme", [CIRCULAR, LINEAR], ids=str)
@pytest.mark.parametrize("gait", ["walk", "run", "circle", "side_step"])
@pytest.mark.parametrize("metres_per_unit", [0.13, 7.0])
def test_scale_is_found_to_two_percent(gait, programme, metres_per_unit, small_body):
    motion, path = filmed(gait, programme, small_body, seed=3)
    found = seen_through(path, metres_per_unit, 0.002, 0.0003, seed=1)
    estimate = scale_of(small_body, motion, path, found)
    assert estimate.scale == pytest.approx(metres_per_unit, rel=0.02)
    (cue,) = estimate.cues
    assert cue.name == "planted_feet" and cue.support >= 5 and cue.residual_m < 0.01


def test_the_unit_of_length_does_not_matter(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    scales = []
    for unit in (1.0, 1e-3, 1e3):
        found = seen_through(path, unit, 0.0, 0.0, seed=0)
        estimate = scale_of(small_body, motion, path, found)
        assert estimate.scale is not None and estimate.sigma is not None
        scales.append((estimate.scale / unit, estimate.sigma / unit))
    assert np.ptp(scales, axis=0) == pytest.approx([0, 0], abs=1e-6)


def test_errors_stay_within_their_bars(small_body):
    inside, total = 0, 0
    for seed in range(6):
        for programme in (CIRCULAR, LINEAR):
            motion, path = filmed("walk", programme, small_body, seed)
            found = seen_through(path, 2.0, 0.006, 0.001, seed)
            estimate = scale_of(small_body, motion, path, found)
            assert estimate.scale is not None and estimate.sigma is not None
            assert estimate.sigma < 0.03 * estimate.scale
            inside += abs(estimate.scale - 2.0) < 2 * estimate.sigma
            total += 1
    assert total == 12 and inside >= 11


def test_frames_without_a_camera_are_left_out(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    found = seen_through(path, 3.0, 0.0, 0.0, seed=0)
    found.world_from_cam[[0, 9, 10, 30]] = np.nan
    estimate = scale_of(small_body, motion, path, found)
    assert estimate.scale == pytest.approx(3.0, rel=0.01)


def test_frames_between_those_that_are_watched_for_feet_tell_the_scale(small_body):
    """Of 120 fps every second frame is watched, from the first with a camera on: here the odd."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=1, fps_hz=120.0)
    found = seen_through(path, 2.5, 0.0, 0.0, seed=0)
    odd = np.arange(path.n_frames) % 2 == 1
    known = np.where(odd[:, None, None], found.world_from_cam, np.nan)
    estimate = scale_of(
        small_body, motion, path, replace(found, world_from_cam=known, has_camera=odd)
    )
    assert estimate.scale == pytest.approx(2.5, rel=0.02)


def test_scale_does_not_enter_for_a_camera_that_only_turns(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    estimate = estimate_scale([seen_person(small_body, motion, path)], "rotation_only", CONFIG)
    assert estimate.scale is None and estimate.sigma is None and estimate.cues == ()


def test_a_camera_that_does_not_move_has_no_scale(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    still = replace(path, world_from_cam=np.tile(path.world_from_cam[:1], (path.n_frames, 1, 1)))
    with pytest.raises(NoReconstruction, match="camera hardly moves"):
        scale_of(small_body, motion, still)


def test_who_moves_with_the_camera_for_two_frames_has_no_scale(small_body):
    """It was said of the camera that it hardly moves."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    two, back = np.arange(path.n_frames) < 2, path.world_from_cam.copy()
    back[:, :3, 3] *= -1
    back[~two] = np.nan
    with pytest.raises(NoReconstruction, match="no foot stands still in 1 steps of the camera"):
        scale_of(small_body, motion, path, replace(path, world_from_cam=back, has_camera=two))


def test_why_nobodys_feet_tell_is_said_once(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    still = replace(path, world_from_cam=np.tile(path.world_from_cam[:1], (path.n_frames, 1, 1)))
    person = seen_person(small_body, motion, still)
    with pytest.raises(NoReconstruction) as raised:
        estimate_scale([person] * 20, "full", CONFIG)
    assert str(raised.value).count("camera hardly moves") == 1


def held_by_hand(body: BodyModel, way_m: float, unseen: slice, moved_m: float) -> ScaleEstimate:
    """Of a noisy person before a camera that sways by some way, and moves while nobody is seen."""
    motion, path = filmed("walk", CIRCULAR, body, seed=0)
    rng = np.random.default_rng(2)
    swaying = np.tile(path.world_from_cam[:1], (path.n_frames, 1, 1))
    phase_rad = 2 * np.pi * np.arange(path.n_frames) / 20
    swaying[:, 0, 3] += way_m * np.sin(phase_rad)
    swaying[unseen.stop :, 0, 3] += moved_m
    person = motion_in_camera(motion, swaying)
    noisy = replace(person, pelvis_m=person.pelvis_m + rng.normal(0, 0.004, person.pelvis_m.shape))
    swaying[unseen] = np.nan
    found = replace(path, world_from_cam=swaying)
    estimate = estimate_scale([SeenPerson(noisy, body, found)], "full", CONFIG)
    (cue,) = estimate.cues
    assert cue.name == "planted_feet"
    return estimate


@pytest.mark.parametrize(("way_m", "known"), [(0.004, False), (1.0, True)])
def test_a_camera_that_travels_less_than_feet_can_tell_has_no_scale(small_body, way_m, known):
    """Feet of a noisy body move by centimetres, which a hand-held camera does as well."""
    estimate = held_by_hand(small_body, way_m, slice(0, 0), 0.0)
    assert (estimate.scale is not None) == known == (estimate.sigma is not None)
    assert known or not estimate.matters


@pytest.mark.parametrize(("moved_m", "matters"), [(0.02, False), (5.0, True)])
def test_a_camera_that_walks_while_nobody_is_seen_needs_its_scale(small_body, moved_m, matters):
    """It was put in one place, and people who came back 5 m off, without a word of it."""
    estimate = held_by_hand(small_body, 0.004, slice(16, 32), moved_m)
    assert estimate.matters == matters == (estimate.scale is not None)


def test_an_unknown_scale_that_would_matter_is_kept(small_body):
    """For the verdict to reject it."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    estimate = scale_of(small_body, motion, path, config=ScaleConfig(body_share=0.8))
    assert estimate.scale == pytest.approx(1.0, rel=0.02)
    assert estimate.sigma is not None and estimate.sigma > 0.8 * estimate.scale
    assert estimate.matters
    steps_m = np.linalg.norm(np.diff(path.world_from_cam[:, :3, 3], axis=0), axis=1)
    for share, matters in ((0.75, True), (0.85, False)):
        bound = share * 10.0 * steps_m.mean()
        config = ScaleConfig(body_share=0.8, vague_share=0.9, slow_m_per_s=bound)
        estimate = scale_of(small_body, motion, path, config=config)
        assert estimate.scale == pytest.approx(1.0, rel=0.02) and estimate.matters == matters


def test_cues_of_an_unknown_scale_are_as_far_apart_as_those_of_a_known_one(small_body):
    """Errors of people's sizes were left out: cues that agree were 3.9 standard errors apart."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    person = replace(seen_person(small_body, motion, path), size_sigma=0.07)
    taller = replace(person, motion=replace(person.motion, pelvis_m=1.05 * person.motion.pelvis_m))
    never = ScaleConfig(vague_share=1e-6, slow_m_per_s=1e9, unseen_move_m=1e9)
    known, unknown = (estimate_scale([person, taller], "full", one) for one in (CONFIG, never))
    assert known.scale is not None and unknown.scale is None and not unknown.matters
    assert unknown.disagreement == known.disagreement


def test_feet_that_never_rest_give_no_scale(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    rng = np.random.default_rng(0)
    flying = replace(motion, pelvis_m=rng.normal(0, 3.0, motion.pelvis_m.shape))
    with pytest.raises(NoReconstruction, match="planted feet found"):
        scale_of(small_body, flying, path, config=ScaleConfig(min_stances=4))


def test_a_scale_below_zero_is_none(small_body, monkeypatch):
    """A cyclist's feet asked for -0.016 ± 0.2: the path was mirrored, and the page failed."""
    cue = CueEstimate("planted_feet", -0.016, 0.2, 2, 0.004, None)
    monkeypatch.setattr(scale, "planted_feet_scale", lambda *_: cue)
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    with pytest.raises(NoReconstruction, match=r"stand still at -0.016 ± 0.2 m a unit"):
        scale_of(small_body, motion, path)
    little = replace(path, world_from_cam=path.world_from_cam.copy())
    little.world_from_cam[:, :3, 3] *= 1e-3
    assert scale_of(small_body, motion, path, little).scale is None


def test_cues_are_weighted_by_their_variances():
    near = CueEstimate("planted_feet", 2.0, 0.1, 5, 0.01, None)
    far = CueEstimate("other", 3.0, 0.2, 5, 0.01, None)
    fused = fuse((near, far))
    assert fused.scale == pytest.approx((2.0 / 0.01 + 3.0 / 0.04) / (1 / 0.01 + 1 / 0.04))
    # They are further apart than they say, so the mean is worse than either says.
    chi_square = ((2.0 - fused.scale) / 0.1) ** 2 + ((3.0 - fused.scale) / 0.2) ** 2
    assert chi_square > 1
    assert fused.sigma == pytest.approx((chi_square / (1 / 0.01 + 1 / 0.04)) ** 0.5)
    assert fused.disagreement == pytest.approx(1 / np.hypot(0.1, 0.2))
    alone = fuse((near,))
    assert alone.disagreement is None and alone.sigma == pytest.approx(0.1)


CROWD_SIGMAS = 46 * (0.04,)  # standard errors of their sizes, as shares


def cues_of_a_crowd(seed: int) -> list[CueEstimate]:
    """Two cues of each of 46 people whose sizes differ, drawn at a scale of 1."""
    rng = np.random.default_rng(seed)
    sizes = rng.normal(1.0, CROWD_SIGMAS[0], len(CROWD_SIGMAS))
    return [
        CueEstimate(name, float(rng.normal(size, 0.05)), 0.05, 9, 0.01, person)
        for person, size in enumerate(sizes)
        for name in ("planted_feet", "ground_contact")
    ]


def test_right_cues_of_a_crowd_do_not_disagree():
    """Some two of 92 are 3.5 of their standard errors apart in two of five sequences."""
    apart = [fuse(tuple(cues_of_a_crowd(s)), 0.0, CROWD_SIGMAS).disagreement for s in range(200)]
    assert np.mean([found is not None and found > 3.5 for found in apart]) <= 0.01


@pytest.mark.parametrize("seed", range(10))
def test_a_wrong_cue_among_those_of_a_crowd_is_found(seed):
    cues = cues_of_a_crowd(seed)
    cues[17] = replace(cues[17], scale=1.0 + 8 * float(np.hypot(0.05, CROWD_SIGMAS[0])))
    apart = fuse(tuple(cues), 0.0, CROWD_SIGMAS).disagreement
    assert apart is not None and apart > 3.5


def test_two_cues_are_as_far_apart_as_they_are():
    """Beyond 38 standard errors too, where a float holds no probability."""
    for sigmas in (0.0, 0.1, 3.5, 40.0, 1e4):
        far = CueEstimate("other", 2.0 + 0.1 * sigmas * 2**0.5, 0.1, 5, 0.01, None)
        near = CueEstimate("planted_feet", 2.0, 0.1, 5, 0.01, None)
        assert fuse((near, far)).disagreement == pytest.approx(sigmas, rel=1e-9, abs=1e-9)


def test_sole_points_lie_on_the_ground_while_they_stand(small_body):
    motion = make_gait("walk", 2.0, 60.0, small_body, np.random.default_rng(0))
    soles_m = foot_points_m(small_body, motion)[:, :, SOLE_POINTS]
    down = standing(soles_m, 0.002)
    assert down.any(axis=(0, 2)).all()
    assert np.abs(np.median(soles_m[down][:, 2])) < 0.01
    # Heel behind ball behind toe, along the walking direction.
    heading = motion.pelvis_m[-1] - motion.pelvis_m[0]
    along = soles_m.mean(axis=0) @ (heading / np.linalg.norm(heading))
    assert (np.diff(along, axis=1) > 0).all()


def test_sole_points_are_the_lowest_of_a_round_sole(anny):
    """The hindmost and the foremost points of the default body's soles are 13 mm higher."""
    shape, rotmats = np.zeros(anny.n_shape), np.tile(np.eye(3), (1, 24, 1, 1))
    rest = motion_of(anny, shape, rotmats, anny.rest_pelvis_m(shape)[None], 30.0, "rest")
    soles_m = foot_points_m(anny, rest)[0, :, SOLE_POINTS]
    height_m = soles_m[..., 1] - anny.rest_vertices_m(shape)[:, 1].min()
    assert (height_m < 0.001).all()
    assert (np.diff(soles_m[..., 2], axis=1) > 0.03).all()


def test_two_people_give_a_cue_each(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    other, _ = filmed("side_step", CIRCULAR, small_body, seed=1)
    found = seen_through(path, 3.0, 0.002, 0.0003, seed=0)
    half = replace(found, world_from_cam=found.world_from_cam.copy())
    half.world_from_cam[20:] = np.nan
    n = min(motion.n_frames, other.n_frames)
    assert n == motion.n_frames
    people = [
        seen_person(small_body, motion, path, found),
        seen_person(small_body, other, path, half),
    ]
    estimate = estimate_scale(people, "full", CONFIG)
    assert [cue.person for cue in estimate.cues] == [0, 1]
    assert estimate.scale == pytest.approx(3.0, rel=0.02)


def test_a_person_without_a_stance_leaves_the_scale_to_the_others(small_body):
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    found = seen_through(path, 3.0, 0.0, 0.0, seed=0)
    unknown = replace(found, world_from_cam=np.full_like(found.world_from_cam, np.nan))
    people = [seen_person(small_body, motion, path, one) for one in (unknown, found)]
    estimate = estimate_scale(people, "full", CONFIG)
    assert [cue.person for cue in estimate.cues] == [1]


@pytest.mark.parametrize("fps_hz", [10.0, 120.0])
def test_who_is_known_in_the_last_frame_alone_leaves_the_scale_to_the_others(fps_hz, small_body):
    """No other frame is left to compare it with, which ended the world in a traceback."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0, fps_hz=fps_hz)
    at_last = np.arange(path.n_frames) == path.n_frames - 1
    last = np.where(at_last[:, None, None], path.world_from_cam, np.nan)
    seldom = replace(path, world_from_cam=last, has_camera=at_last)
    people = [seen_person(small_body, motion, path, one) for one in (seldom, path)]
    estimate = estimate_scale(people, "full", CONFIG)
    assert estimate.scale == scale_of(small_body, motion, path).scale
    with pytest.raises(NoReconstruction, match="no two frames in a row have both pose and camera"):
        estimate_scale(people[:1], "full", CONFIG)


def test_what_cues_share_is_not_lowered_by_their_number():
    cues = tuple(CueEstimate(f"cue_{i}", 2.0, 0.02, 9, 0.01, None) for i in range(100))
    assert fuse(cues).sigma == pytest.approx(0.002)
    assert fuse(cues, 0.01).sigma == pytest.approx(np.hypot(0.002, 0.02))


def test_a_camera_that_stands_for_a_while_tells_the_scale_as_well_as_without(small_body):
    """The usual speed of one that stands for 60 % of the time is nothing: the scale of the rest was
    thrown away as unknown."""
    motion, path = filmed("walk", CIRCULAR, small_body, seed=0)
    n = path.n_frames * 6 // 10
    cameras = path.world_from_cam.copy()
    cameras[:n] = cameras[n]
    moving = replace(path, world_from_cam=cameras[n:], has_camera=path.has_camera[n:])
    whole = scale_of(small_body, motion, replace(path, world_from_cam=cameras))
    alone = scale_of(small_body, motion.take(slice(n, None)), moving)
    for estimate in (whole, alone):
        assert estimate.scale == pytest.approx(1.0, rel=0.05) and estimate.sigma is not None
    assert whole.sigma == pytest.approx(alone.sigma, rel=0.5)


@pytest.mark.parametrize("fps_hz", [10.0, 30.0])
def test_feet_creep_as_far_as_a_steady_camera_travels(small_body, fps_hz):
    """Its scale has the error of their speed over its own."""
    motion, path = filmed("walk", LINEAR, small_body, seed=0, fps_hz=fps_hz)
    metres = np.linspace(0, 5, path.n_frames)
    cameras = np.tile(path.world_from_cam[:1], (path.n_frames, 1, 1))
    cameras[:, :3, 3] += metres[:, None] * [0.6, 0.8, 0.0]
    speed_m_per_s = fps_hz * metres[1]
    config = ScaleConfig(creep_m_per_s=0.6, body_share=0.0)
    (cue,) = scale_of(small_body, motion, replace(path, world_from_cam=cameras), None, config).cues
    assert cue.sigma == pytest.approx(0.6 / speed_m_per_s, rel=0.01)


UNIT_M = 0.37
WORLD = rigid(Rotation.from_rotvec([0.4, 1.0, -2.0]).as_matrix(), np.array([3.0, -1.0, 2.0]))


def walk(
    body: BodyModel, programme: Programme = CIRCULAR, seed: int = 3
) -> tuple[Motion, CameraPath]:
    return filmed("walk", programme, body, seed, fps_hz=30.0)


def reconstructed(path: CameraPath, points_m: np.ndarray) -> tuple[CameraPath, np.ndarray]:
    """Path and points in another world and another unit."""
    moved = WORLD @ path.world_from_cam
    moved[:, :3, 3] /= UNIT_M
    return replace(path, world_from_cam=moved), apply(WORLD, points_m) / UNIT_M


def scenery(motion: Motion, noise_m: float, n_ground: int) -> np.ndarray:
    """Points of a floor round the person's path, of a table beside it and of a wall."""
    rng = np.random.default_rng(0)
    middle = motion.pelvis_m.mean(axis=0) * [1, 1, 0]
    floor = np.c_[rng.uniform(-6, 6, (n_ground, 2)), np.zeros(n_ground)]
    table = np.c_[rng.uniform([0.5, 0.5], [1.5, 1.5], (60, 2)), np.full(60, 0.35)]
    wall = np.c_[rng.uniform(-6, 6, 200), np.full(200, 2.0), rng.uniform(0, 3, 200)]
    points = np.concatenate([floor, table, wall]) + middle
    return points + rng.normal(0, noise_m, points.shape)


def ground_cue(
    motion: Motion, path: CameraPath, points_m: np.ndarray, body: BodyModel, rough: float
) -> CueEstimate | None:
    found, points = reconstructed(path, points_m)
    person = motion_in_camera(motion, path.world_from_cam)
    feet_cam_m = foot_points_m(body, person)
    up_cam = person.root_rotmats[:, :, 1]
    seen = SeenFeet(found, feet_cam_m, up_cam, 30.0)
    return ground_contact_scale(seen, points, rough, CONFIG)


@pytest.mark.parametrize("programme", [CIRCULAR, LINEAR, Small()], ids=str)
@pytest.mark.parametrize("rough", [0.85, 1.0, 1.15])
def test_soles_on_the_ground_tell_the_scale(programme, rough, small_body):
    motion, path = walk(small_body, programme)
    cue = ground_cue(motion, path, scenery(motion, 0.01, 600), small_body, rough * UNIT_M)
    assert cue is not None and cue.name == "ground_contact" and cue.support > 50
    assert cue.scale == pytest.approx(UNIT_M, rel=0.012)
    assert abs(cue.scale - UNIT_M) < 2 * cue.sigma < 0.06 * UNIT_M


@pytest.mark.parametrize("lean_deg", [12, 24])
def test_the_foot_in_the_air_and_a_person_who_leans_do_not_lower_the_camera(lean_deg, small_body):
    """The left foot is on the ground heel and all; the right one, in front, waits 4 cm above it."""
    motion, path = walk(small_body)
    middle_m = motion.pelvis_m.mean(axis=0) * [1, 1, 0]
    sole_m = np.array([[0, 0, 0.07], [0.1, 0, 0.03], [-0.05, 0, 0], [0.15, 0, 0], [0.2, 0, 0.005]])
    feet_m = middle_m + np.stack([sole_m, sole_m + np.array([0.6, 0.2, 0.04])])
    cam_from_world = invert(path.world_from_cam)
    feet_cam_m = apply(cam_from_world, np.tile(feet_m.reshape(-1, 3), (path.n_frames, 1, 1)))
    lean = Rotation.from_euler("y", lean_deg, degrees=True).apply([0.0, 0.0, 1.0])
    found, points = reconstructed(path, scenery(motion, 0.0, 600))
    feet_cam_m, up_cam = feet_cam_m.reshape(-1, 2, 5, 3), cam_from_world[:, :3, :3] @ lean
    seen = SeenFeet(found, feet_cam_m, up_cam, 30.0)
    cue = ground_contact_scale(seen, points, 0.9 * UNIT_M, CONFIG)
    assert cue is not None and cue.scale == pytest.approx(UNIT_M, rel=1e-4)


def at_height(path: CameraPath, height_m: float) -> CameraPath:
    world_from_cam = path.world_from_cam.copy()
    world_from_cam[:, 2, 3] = height_m
    return replace(path, world_from_cam=world_from_cam)


def test_without_a_ground_there_is_no_such_cue(small_body):
    motion, path = walk(small_body)
    wall_m = scenery(motion, 0.01, 0)[60:]
    assert ground_cue(motion, path, wall_m, small_body, UNIT_M) is None
    assert ground_cue(motion, path, np.zeros((0, 3)), small_body, UNIT_M) is None
    low = at_height(path, 0.2)  # a camera near the ground sees it too flat
    assert ground_cue(motion, low, scenery(motion, 0.01, 600), small_body, UNIT_M) is None


@pytest.mark.parametrize("table_m", [0.3, 0.35, 0.39])
def test_a_table_is_not_the_ground_of_a_low_camera(table_m, small_body):
    """Hardly below the camera or above it: the scale was 18 times too large, or below zero."""
    motion, path = walk(small_body, Circular(radius_m=2.5))
    path = at_height(path, 0.37)
    rng, middle_m = np.random.default_rng(0), motion.pelvis_m.mean(axis=0)
    table_m = [*middle_m[:2], table_m] + np.c_[rng.uniform(-1, 1, (300, 2)), np.zeros(300)]
    assert ground_cue(motion, path, table_m, small_body, UNIT_M) is None


def test_who_is_hidden_below_the_hips_is_above_the_ground(small_body):
    """Legs that are guessed keep still before the camera, where feet found a scale of 0 ± 1 %."""
    motion, path = walk(small_body, LINEAR)
    rest = np.tile(np.eye(3), (motion.n_frames, 23, 1, 1))
    guessed = replace(motion_in_camera(motion, path.world_from_cam), local_rotmats=rest)
    found, points = reconstructed(path, scenery(motion, 0.01, 600))
    person = SeenPerson(guessed, small_body, found)
    estimate = estimate_scale([person], "full", CONFIG, points=points)
    assert [cue.name for cue in estimate.cues] == ["above_ground"]
    assert estimate.scale is not None and estimate.sigma is not None
    assert estimate.scale / UNIT_M == pytest.approx(1.0, abs=0.05)
    assert 0.05 < estimate.sigma / estimate.scale < 0.25


def drifting(path: CameraPath, drift_m: float, seed: int) -> np.ndarray:
    """A path that drifts slowly by so much over the clip, and trembles by a millimetre."""
    rng = np.random.default_rng(seed)
    n = path.n_frames
    direction = rng.normal(size=3)
    way = np.sin(np.linspace(0, np.pi / 2, n))[:, None] * direction / np.linalg.norm(direction)
    dataset_camera = path.world_from_cam.copy()
    dataset_camera[:, :3, 3] += drift_m * way + rng.normal(0, 0.001, (n, 3))
    turns = np.linspace(0, np.deg2rad(5), n)[:, None] * [0.0, 0.0, 1.0]
    turned = rigid(Rotation.from_rotvec(turns).as_matrix(), np.zeros(3))
    return np.asarray(turned @ dataset_camera)


def test_a_data_sets_own_path_tells_the_scale_where_it_drifts_little(small_body):
    inside = 0
    for seed in range(8):
        _, path = walk(small_body, seed=seed)
        found, _ = reconstructed(path, np.zeros((0, 3)))
        exact = short_windows_scale(found, path.world_from_cam, 30.0, CONFIG)
        assert exact is not None and exact.scale == pytest.approx(UNIT_M, rel=1e-9)
        cue = short_windows_scale(found, drifting(path, 0.4, seed), 30.0, CONFIG)
        assert cue is not None and cue.name == "short_windows"
        assert cue.scale == pytest.approx(UNIT_M, rel=0.15)
        inside += abs(cue.scale - UNIT_M) < 2 * cue.sigma
    assert inside >= 7


def test_frames_that_either_path_lacks_are_left_out(small_body):
    _, path = walk(small_body, LINEAR)
    found, _ = reconstructed(path, np.zeros((0, 3)))
    found.world_from_cam[5:9] = np.nan
    dataset_camera = path.world_from_cam.copy()
    dataset_camera[60:] = np.nan
    cue = short_windows_scale(found, dataset_camera, 30.0, CONFIG)
    assert cue is not None and cue.scale == pytest.approx(UNIT_M, rel=1e-9)
    dataset_camera[:] = np.nan
    assert short_windows_scale(found, dataset_camera, 30.0, CONFIG) is None
    still = np.tile(np.eye(4), (path.n_frames, 1, 1))
    assert short_windows_scale(replace(path, world_from_cam=still), still, 30.0, CONFIG) is None


def test_all_cues_together_are_better_than_feet_alone(small_body):
    motion, path = walk(small_body)
    found, points = reconstructed(path, scenery(motion, 0.01, 600))
    people, dataset_camera = [seen_person(small_body, motion, path, found)], drifting(path, 0.3, 0)
    feet = estimate_scale(people, "full", CONFIG)
    every = estimate_scale(people, "full", CONFIG, points=points, dataset_camera=dataset_camera)
    assert [cue.name for cue in every.cues] == ["planted_feet", "ground_contact", "short_windows"]
    assert feet.sigma is not None and every.sigma is not None and every.scale is not None
    assert every.sigma < feet.sigma
    assert abs(every.scale - UNIT_M) < 2 * every.sigma
    assert every.disagreement is not None and every.disagreement < 2


def test_the_ground_is_found_though_steps_are_too_short(anny):
    """As of poses from pictures, whose planted feet seem to creep."""
    motion, path = walk(anny, Circular(rate_deg_per_s=25.0))
    local = motion.local_rotmats.copy()
    for hip in (0, 1):
        turns = Rotation.from_matrix(local[:, hip]).as_rotvec()
        local[:, hip] = Rotation.from_rotvec(0.3 * turns).as_matrix()
    found, points = reconstructed(path, scenery(motion, 0.005, 400))
    person = seen_person(anny, replace(motion, local_rotmats=local), path, found)
    estimate = estimate_scale([person], "full", CONFIG, points=points)
    feet, ground = estimate.cues
    assert feet.scale < 0.8 * UNIT_M
    assert ground.scale == pytest.approx(UNIT_M, rel=0.05)
