"""Shots: pointing, following, what each programme promises, and a twin that stands."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from gmrdata.film import programmes as film
from gmrdata.film.camera_moves import look_at, smooth_path
from gmrdata.film.programmes import (
    Circular,
    Film,
    Linear,
    LinearPanning,
    Panning,
    Programme,
    Small,
    Static,
    camera_path,
    camera_programme,
    film_motion,
    frame_rate_hz,
    plan_clip,
    static_twin,
)
from gmrdata.motion.gait import make_gait
from gmrdata.values.camera import CameraPath, in_frame, intrinsics_from_fov, person_box, project
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.transforms import rigid

FPS_HZ, N_FRAMES = 10.0, 48
PROGRAMMES = (
    Circular(),
    Circular(direction="clockwise", rate_deg_per_s=30),
    Linear(),
    LinearPanning(speed_m_per_s=0.5),
    Linear(move="dolly"),
    Panning(),
    LinearPanning(),
    LinearPanning(move="dolly"),
    Small(),
    Static(),
)
programmes = st.sampled_from(PROGRAMMES)


@st.composite
def walks(draw: st.DrawFn) -> np.ndarray:
    """Pelvis paths (48, 3) of people who walk, turn or stand, anywhere, in any direction."""
    speed, turn = draw(st.floats(0, 1.6)), draw(st.floats(-0.4, 0.4))
    heading = draw(st.floats(-np.pi, np.pi))
    start = np.array([draw(st.floats(-20, 20)), draw(st.floats(-20, 20))])
    time_s = np.arange(N_FRAMES) / FPS_HZ
    angle = heading + turn * time_s
    steps = speed / FPS_HZ * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    bob = 0.93 + 0.025 * np.sin(2 * np.pi * 1.9 * time_s)
    return np.c_[start + np.cumsum(steps, axis=0), bob]


def straight(speed_m_per_s: float, n_frames: int = N_FRAMES) -> np.ndarray:
    """The pelvis (T, 3) of someone who goes along x."""
    way_m = speed_m_per_s / FPS_HZ * np.arange(n_frames)
    return np.c_[way_m, np.zeros(n_frames), np.full(n_frames, 0.93)]


def assert_rotations(rotmats: np.ndarray, atol: float) -> None:
    identities = np.broadcast_to(np.eye(3), rotmats.shape)
    np.testing.assert_allclose(rotmats @ np.swapaxes(rotmats, -1, -2), identities, atol=atol)
    np.testing.assert_allclose(np.linalg.det(rotmats), 1.0, atol=atol)


def filmed_by(programme: Programme, pelvis: np.ndarray, seed: int = 0) -> CameraPath:
    return camera_path(programme, pelvis, FPS_HZ, 640, 360, 60.0, np.random.default_rng(seed))


def turn_deg(camera: CameraPath) -> np.ndarray:
    rotmats = camera.world_from_cam[:, :3, :3]
    trace = np.einsum("ij,tij->t", rotmats[0], rotmats)
    return np.rad2deg(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


@given(programmes, walks(), st.integers(0, 2**32 - 1))
def test_every_programme_gives_real_cameras_with_the_person_in_frame(programme, pelvis, seed):
    camera = filmed_by(programme, pelvis, seed)
    rotmats = camera.world_from_cam[:, :3, :3]
    assert camera.n_frames == N_FRAMES and camera.has_camera.all()
    assert np.isfinite(camera.world_from_cam).all()
    assert_rotations(rotmats, atol=1e-9)
    assert in_frame(camera, person_box(pelvis)).mean() == 1.0
    assert np.linalg.norm(camera.centres_world_m - pelvis, axis=1).min() > 1.0
    again = filmed_by(programme, pelvis, seed)
    assert again.world_from_cam.tobytes() == camera.world_from_cam.tobytes()


@settings(max_examples=20)
@given(walks(), st.sampled_from(["clockwise", "counterclockwise"]), st.floats(20, 30))
def test_circular_keeps_its_distance_and_turns_far(pelvis, direction, rate_deg_per_s):
    programme = TypeAdapter(Programme).validate_python(
        {"kind": "circular", "direction": direction, "rate_deg_per_s": rate_deg_per_s}
    )
    centres = filmed_by(programme, pelvis).centres_world_m
    middle = (pelvis.min(axis=0) + pelvis.max(axis=0))[:2] / 2
    arms = centres[:, :2] - middle
    distance = np.linalg.norm(arms, axis=1)
    np.testing.assert_allclose(distance, distance[0], rtol=1e-9)
    angles_deg = np.rad2deg(np.unwrap(np.arctan2(arms[:, 1], arms[:, 0])))
    sign = 1 if direction == "counterclockwise" else -1
    total_deg = rate_deg_per_s * (N_FRAMES - 1) / FPS_HZ
    np.testing.assert_allclose(angles_deg[-1] - angles_deg[0], sign * total_deg, rtol=1e-6)
    np.testing.assert_allclose(centres[:, 2], programme.height_m)


@settings(max_examples=20)
@given(walks())
def test_panning_is_a_pure_rotation(pelvis):
    camera = filmed_by(Panning(), pelvis)
    assert np.all(camera.centres_world_m == camera.centres_world_m[0])


def test_panning_follows_a_walk_across_the_picture():
    assert turn_deg(filmed_by(Panning(), straight(1.3)))[-1] > 40


@settings(max_examples=20)
@given(walks(), st.sampled_from(["truck", "dolly"]))
def test_linear_translates_only_at_constant_speed_on_a_line(pelvis, move):
    camera = filmed_by(
        TypeAdapter(Programme).validate_python({"kind": "linear", "move": move}), pelvis
    )
    np.testing.assert_allclose(turn_deg(camera), 0, atol=1e-5)
    steps = np.diff(camera.centres_world_m, axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (N_FRAMES - 1, 1)), atol=1e-9)
    assert np.linalg.norm(steps[0]) * FPS_HZ >= 0.3 - 1e-9


def test_linear_panning_does_both():
    camera = filmed_by(LinearPanning(), straight(1.3))
    steps = np.diff(camera.centres_world_m, axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (N_FRAMES - 1, 1)), atol=1e-9)
    assert turn_deg(camera)[-1] > 15
    assert np.linalg.norm(steps[0]) * FPS_HZ > 0.5


def test_small_drifts_by_centimetres():
    pelvis = np.tile([1.0, 2.0, 0.93], (300, 1))
    centres = filmed_by(Small(drift_m=0.03), pelvis, seed=3).centres_world_m
    spread_m = centres.std(axis=0)
    assert np.all((spread_m > 0.01) & (spread_m < 0.05))
    assert turn_deg(filmed_by(Small(), pelvis)).max() < 4


def test_static_does_not_move():
    world_from_cam = filmed_by(Static(), straight(0.5)).world_from_cam
    assert np.all(world_from_cam == world_from_cam[0])


def test_what_the_recipe_gives_is_kept():
    pelvis = np.tile([3.0, -1.0, 0.9], (5, 1))
    view = filmed_by(Static(azimuth_deg=90, distance_m=7, height_m=2.5), pelvis).centres_world_m
    np.testing.assert_allclose(view, np.tile([3.0, 6.0, 2.5], (5, 1)), atol=1e-12)
    ring = filmed_by(Circular(radius_m=6.0), pelvis).centres_world_m
    np.testing.assert_allclose(np.linalg.norm((ring - pelvis)[:, :2], axis=1), 6.0)


def test_one_frame_is_enough():
    for programme in PROGRAMMES:
        camera = filmed_by(programme, np.array([[0.0, 0.0, 0.9]]))
        assert camera.world_from_cam.shape == (1, 4, 4)
        assert np.isfinite(camera.world_from_cam).all()


def test_a_subject_that_cannot_be_framed_is_an_error():
    with pytest.raises(BadRecipe, match="static camera can't keep the subject in frame"):
        filmed_by(Static(), straight(30.0))


@pytest.mark.parametrize(
    "lens",
    [
        {"hfov_deg": 200.0}, {"hfov_deg": -60.0}, {"hfov_deg": 0.0}, {"width_px": -640},
        {"height_px": 0}, {"fps_hz": -10.0}, {"fps_hz": np.nan},
    ],
)  # fmt: skip
def test_a_picture_that_no_camera_has_is_an_error(lens):
    """Its focal length was negative, and nothing was said."""
    given = {"fps_hz": 10.0, "width_px": 640, "height_px": 360, "hfov_deg": 60.0} | lens
    with pytest.raises(BadRecipe, match="all are above 0, and hfov_deg is below 180"):
        camera_path(Static(distance_m=4.0), straight(1.0), rng=np.random.default_rng(0), **given)


@pytest.mark.parametrize("path", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_a_broken_path_is_an_error(path):
    with pytest.raises(BadMotionFile, match="finite numbers"):
        filmed_by(Static(), path)


@pytest.mark.parametrize(
    "recipe",
    [{"kind": "spiral"}, {"kind": "circular", "radius": 3}, {"kind": "small", "drift_m": -1}, {}],
)
def test_unknown_kinds_and_keys_are_refused(recipe):
    with pytest.raises(ValidationError):
        TypeAdapter(Programme).validate_python(recipe)


def test_plans_that_say_where_a_linear_camera_looks_are_read():
    assert camera_programme("linear", look="fixed").model_dump()["look"] == Linear().look == "fixed"


def test_out_of_frame_is_counted():
    camera = filmed_by(Static(azimuth_deg=-90, distance_m=5), np.tile([0.0, 0, 0.93], (4, 1)))
    points = np.array([[0.0, 0, 1], [0, -9, 1], [30, 0, 1], [0, 0, 1.2]])  # behind, aside
    assert in_frame(camera, points).mean() == 0.5
    assert in_frame(camera, np.stack([points, points[:1].repeat(4, axis=0)], axis=1)).mean() == 0.5


@pytest.mark.parametrize(
    "programme", [Circular(), Linear(), Panning(), LinearPanning()], ids=lambda p: p.kind
)
def test_a_hand_adds_its_unrest_to_every_moving_camera(programme):
    pelvis = straight(4 / 60, 600)
    wheels = programme.model_copy(update={"distance_m": 9.0})
    hand = wheels.model_copy(update={"handheld_deg": 0.5, "handheld_m": 0.02})
    smooth, held = filmed_by(wheels, pelvis), filmed_by(hand, pelvis)
    moved_m = held.centres_world_m - smooth.centres_world_m
    # 60 s hold the slowest wave seven times or more, so its standard deviation is there.
    np.testing.assert_allclose(moved_m.std(axis=0), 0.02, rtol=0.1)
    turned = smooth.world_from_cam[:, :3, :3].transpose(0, 2, 1) @ held.world_from_cam[:, :3, :3]
    angles_deg = np.rad2deg(Rotation.from_matrix(turned).as_rotvec())
    np.testing.assert_allclose(angles_deg.std(axis=0), 0.5, rtol=0.1)
    # Energy falls with the frequency and ends below 3 Hz.
    power = (np.abs(np.fft.rfft(moved_m * np.hanning(600)[:, None], axis=0)) ** 2).sum(axis=1)
    hz = np.fft.rfftfreq(600, 1 / FPS_HZ)
    bands = [power[(hz >= low) & (hz < high)].sum() for low, high in ((0.1, 0.5), (0.5, 1), (1, 3))]
    assert bands[0] > bands[1] > bands[2] > 100 * power[hz >= 3.2].sum()


def test_a_held_camera_keeps_the_person_in_frame():
    pelvis = straight(0.85)
    camera = filmed_by(Circular(handheld_deg=2.0, handheld_m=0.1), pelvis)
    assert in_frame(camera, person_box(pelvis)).mean() == 1.0


@pytest.mark.parametrize(
    ("programme", "remedied"),
    [
        (Small(height_m=0.1, drift_m=0.3), Small(height_m=0.1, drift_m=0.02)),
        (
            Panning(height_m=0.1, handheld_m=0.3, distance_m=4.0),
            Panning(height_m=2, handheld_m=0.3),
        ),
    ],
)
def test_a_hand_that_would_go_below_the_ground_is_refused(programme, remedied):
    """The ground hid the person from such a camera, and all figures of the clip were the best."""
    pelvis = straight(0.1)
    with pytest.raises(BadRecipe, match=r"to a height of -0\.\d\d m; give more height_m, or less"):
        filmed_by(programme, pelvis)
    assert filmed_by(remedied, pelvis).centres_world_m[:, 2].min() > 0


@given(st.integers(0, 2**32 - 1))
def test_the_target_is_in_the_middle_and_the_horizon_level(seed):
    rng = np.random.default_rng(seed)
    centres, targets = rng.normal(0, 3, (6, 3)), rng.normal(8, 2, (6, 3))
    rotmats = look_at(centres, targets)
    assert_rotations(rotmats, atol=1e-12)
    intrinsics_px = intrinsics_from_fov(60, 640, 360)
    world_from_cam = rigid(rotmats, centres)
    middle_px = project(world_from_cam, targets[:, None], intrinsics_px)[:, 0]
    np.testing.assert_allclose(middle_px, np.tile([320.0, 180.0], (6, 1)), atol=1e-6)
    assert np.all(np.abs(rotmats[:, 2, 0]) < 1e-12)  # the picture's x axis is horizontal
    assert np.all(rotmats[:, 2, 1] < 0)  # the picture's y axis points down


def test_what_is_higher_in_the_world_is_higher_in_the_picture():
    centre_m = np.array([0.0, -4, 1])
    world_from_cam = rigid(look_at(centre_m, np.array([0.0, 0, 1])), centre_m)
    points_m = np.array([[0.0, 0, 1.5], [0.5, 0, 1.0]])
    above_px, right_px = project(world_from_cam, points_m, intrinsics_from_fov(60, 640, 360))
    assert above_px[1] < 180 and right_px[0] > 320


@pytest.mark.parametrize("target", [(0, 0, 0), (0, 0, 5), (0, 0, 2)])
def test_straight_down_up_and_inside_are_refused(target):
    with pytest.raises(BadRecipe, match="straight up or down"):
        look_at(np.array([0.0, 0, 2]), np.array(target, dtype=float))


def test_following_keeps_constant_speed_and_is_late_by_the_lag():
    fps_hz, lag_s = 30.0, 0.2
    line = np.arange(200)[:, None] / fps_hz * np.array([1.2, -0.4, 0.0])
    late = smooth_path(line, fps_hz, 0.3, lag_s)
    inside = slice(60, 140)  # away from the ends, where a Gaussian of constant speed is itself
    np.testing.assert_allclose(
        (line - late)[inside], np.tile([1.2 * lag_s, -0.4 * lag_s, 0], (80, 1)), atol=1e-4
    )


def test_following_takes_the_bobbing_out():
    time_s = np.arange(100) / 10
    bob = np.stack([0 * time_s, 0 * time_s, 0.9 + 0.03 * np.sin(2 * np.pi * 2 * time_s)], axis=-1)
    assert np.ptp(smooth_path(bob, 10.0, 0.35, 0.1)[10:-10, 2]) < 0.002


@pytest.mark.parametrize(
    ("duration_s", "rate_hz"), [(1.44, 30.0), (1.9, 20.0), (2.8, 20.0), (2.9, 10.0), (60.0, 10.0)]
)
def test_short_motions_get_a_higher_rate(duration_s, rate_hz):
    assert frame_rate_hz(duration_s, Film(max_frames=56)) == rate_hz


@pytest.mark.parametrize(("n_frames", "rate_hz"), [(31, 30.0), (62, 30.0), (33, 20.0), (249, 10.0)])
def test_as_many_frames_as_there_may_be_are_not_too_many(n_frames, rate_hz):
    """31 frames of 30 Hz last 1.0333... s, which makes 31.000000000000004 frames of them."""
    film = Film(max_frames=n_frames, duration_s=100.0)
    assert frame_rate_hz(n_frames / rate_hz, film) == rate_hz


def test_a_rate_that_is_given_is_kept():
    assert frame_rate_hz(1.0, Film(fps_hz=10)) == 10.0


@pytest.mark.parametrize(("motion_hz", "rate_hz"), [(24.0, 20.0), (25.0, 20.0), (8.0, 8.0)])
def test_a_rate_that_is_chosen_is_none_that_the_motion_has_not(small_body, motion_hz, rate_hz):
    """At 25 Hz phases of 10 Hz would have frames that nobody filmed."""
    motion = make_gait("walk", 1.0, motion_hz, small_body, np.random.default_rng(3))
    assert film_motion(motion, Film(duration_s=1.0)).fps_hz == rate_hz


def test_a_motion_that_is_slower_than_the_rate_that_is_given_is_refused(small_body):
    motion = make_gait("walk", 1.0, 25.0, small_body, np.random.default_rng(3))
    with pytest.raises(BadMotionFile, match=r"25 Hz are fewer than the 30 of film\.fps_hz"):
        film_motion(motion, Film(duration_s=1.0, fps_hz=30.0))


def test_the_motion_is_cut_and_its_middle_lies_over_the_origin(small_body):
    rng = np.random.default_rng(3)
    motion = make_gait("walk", 6.0, 30.0, small_body, rng)
    filmed = film_motion(motion, Film(duration_s=4.0))
    assert (filmed.n_frames, filmed.fps_hz) == (40, 10.0)
    np.testing.assert_array_equal(filmed.root_rotmats, motion.root_rotmats[:120:3])
    low, high = filmed.pelvis_m.min(axis=0), filmed.pelvis_m.max(axis=0)
    np.testing.assert_allclose((low + high)[:2], 0, atol=1e-12)
    np.testing.assert_allclose(filmed.pelvis_m[:, 2], motion.pelvis_m[:120:3, 2])
    clip = plan_clip("a", filmed, Circular(), Film(), rng)
    assert clip.camera is not None and clip.camera.n_frames == 40
    assert (clip.camera.width_px, clip.camera.height_px) == (640, 360)


def test_too_short_a_motion_is_named(small_body):
    motion = make_gait("walk", 0.5, 30.0, small_body, np.random.default_rng(0))
    motion = replace(motion, source="short.bvh")
    for duration_s in (0.1, 0.01):
        fault = f"{duration_s:.2f} s are too short to film; it takes 0.17 s, 5 f.* or duration_s"
        with pytest.raises(BadMotionFile, match=fault):
            film_motion(motion, Film(duration_s=duration_s))


def test_last_bits_of_a_camera_path_do_not_reach_the_clip(small_body, monkeypatch):
    """Two runs of one recipe once differed by 2e-15 m in one planned camera."""
    motion = film_motion(make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(1)), Film())
    planned = plan_clip("a", motion, Circular(), Film(), np.random.default_rng(2)).camera

    def noisy(*arguments: Any) -> CameraPath:
        path = camera_path(*arguments)
        return replace(path, world_from_cam=path.world_from_cam + 2e-15)

    monkeypatch.setattr(film, "camera_path", noisy)
    again = plan_clip("a", motion, Circular(), Film(), np.random.default_rng(2)).camera
    assert planned is not None and again is not None
    assert planned.world_from_cam.tobytes() == again.world_from_cam.tobytes()


def filmed(programme: Programme, length_m: float) -> tuple[CameraPath, np.ndarray]:
    x_m = np.linspace(-length_m / 2, length_m / 2, 41)
    pelvis_m = np.stack([x_m, np.zeros(41), np.full(41, 0.95)], axis=-1)
    rng = np.random.default_rng(4)
    return camera_path(programme, pelvis_m, 10.0, 640, 360, 60.0, rng), pelvis_m


def test_it_stands_where_the_camera_is_at_the_middle_of_the_clip():
    camera, pelvis_m = filmed(Circular(distance_m=9.0), 2.0)
    twin = static_twin(camera, pelvis_m)
    np.testing.assert_allclose(
        twin.centres_world_m, np.tile(camera.centres_world_m[20], (41, 1)), atol=1e-12
    )
    np.testing.assert_array_equal(twin.world_from_cam, np.tile(twin.world_from_cam[0], (41, 1, 1)))
    # The optical axis goes through the middle of the path, which is over the origin.
    towards = np.array([0.0, 0.0, 0.95]) - twin.centres_world_m[0]
    np.testing.assert_allclose(
        twin.world_from_cam[0, :3, 2], towards / np.linalg.norm(towards), atol=1e-12
    )
    np.testing.assert_array_equal(twin.intrinsics_px, camera.intrinsics_px)


def test_it_steps_back_no_further_than_it_must():
    camera, pelvis_m = filmed(LinearPanning(distance_m=3.0), 6.0)
    twin = static_twin(camera, pelvis_m)
    assert in_frame(twin, person_box(pelvis_m)).mean() == 1.0
    there, moving = twin.centres_world_m[0], camera.centres_world_m[20]
    assert there[2] == moving[2]
    bearing = [np.arctan2(*place[1::-1]) for place in (there, moving)]
    assert bearing[0] == pytest.approx(bearing[1])
    steps = (np.linalg.norm(there[:2]) - np.linalg.norm(moving[:2])) / 0.25
    assert steps >= 1 and steps == pytest.approx(round(steps))
    nearer = there - np.array([*there[:2], 0]) / np.linalg.norm(there[:2]) * 0.25
    pose = np.array(twin.world_from_cam)
    pose[:, :3, 3] = nearer
    assert in_frame(replace(twin, world_from_cam=pose), person_box(pelvis_m), 0.03).mean() < 1.0


@pytest.mark.parametrize(("distance_m", "farthest"), [(6.0, "25 m"), (40.0, "40 m")])
def test_a_path_that_no_static_camera_sees_is_refused(distance_m, farthest):
    camera, pelvis_m = filmed(LinearPanning(distance_m=distance_m), 80.0)
    with pytest.raises(BadRecipe, match=f"from any distance up to {farthest};"):
        static_twin(camera, pelvis_m)


def test_a_middle_frame_without_a_camera_is_refused():
    camera, pelvis_m = filmed(Circular(), 2.0)
    poses = camera.world_from_cam.copy()
    poses[20] = np.nan
    with pytest.raises(BadRecipe, match="middle frame"):
        static_twin(replace(camera, world_from_cam=poses), pelvis_m)


def test_frames_with_a_point_outside_are_told_one_by_one():
    camera, pelvis_m = filmed(Circular(), 2.0)
    twin = static_twin(camera, pelvis_m)
    points = person_box(pelvis_m)
    points[5, 0] = twin.centres_world_m[0] - twin.world_from_cam[0, :3, 2]  # behind the camera
    points[7, 3] += 50 * twin.world_from_cam[0, :3, 0]  # far to the right
    seen = in_frame(twin, points)
    np.testing.assert_array_equal(np.flatnonzero(~seen), [5, 7])
    assert in_frame(twin, points).mean() == 39 / 41
