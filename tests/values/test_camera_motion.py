"""The class of a camera's motion, from paths whose class is known."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

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
    film_motion,
    plan_clip,
)
from gmrdata.motion.files import read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.values.camera_motion import MotionClassConfig, classify, motion_figures
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.transforms import rigid

CONFIG = MotionClassConfig()
FILM = Film(fps_hz=10)
PROGRAMMES: tuple[Programme, ...] = (
    Static(),
    Small(),
    Panning(),
    Linear(),
    LinearPanning(),
    Circular(),
    Circular(handheld_m=0.02, handheld_deg=0.3),
    Linear(handheld_m=0.02, handheld_deg=0.3),
)


@pytest.mark.parametrize("programme", PROGRAMMES, ids=str)
def test_programmes_are_of_their_own_class(programme, small_body):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        motion = film_motion(make_gait("walk", 4.8, 30.0, small_body, rng), FILM)
        clip = plan_clip("walk", motion, programme, FILM, rng)
        assert clip.camera is not None
        found, _ = classify(clip.camera.world_from_cam, motion.pelvis_m, 10.0, CONFIG)
        assert found == programme.kind


@pytest.mark.parametrize("trial", ["02_03", "08_02", "05_01", "16_15", "35_10"])
def test_so_are_those_that_film_captured_motions(trial, cmu_dir, small_body):
    path = next(path for path in sorted(cmu_dir.rglob(f"{trial}.*")) if path.suffix != ".asf")
    motion = film_motion(read_motion(path, small_body), FILM)
    for programme in PROGRAMMES:
        clip = plan_clip(trial, motion, programme, FILM, np.random.default_rng(3))
        assert clip.camera is not None
        found, _ = classify(clip.camera.world_from_cam, motion.pelvis_m, 10.0, CONFIG)
        assert found == programme.kind, trial


def cameras_on(places_m: np.ndarray, yaw_rad: np.ndarray) -> np.ndarray:
    return rigid(Rotation.from_rotvec(yaw_rad[:, None] * [0.0, 0.0, 1.0]).as_matrix(), places_m)


def test_figures_are_those_of_the_path():
    angles = np.deg2rad(np.arange(0, 61))
    places_m = np.c_[2 * np.cos(angles), 2 * np.sin(angles), np.full(61, 1.5)]
    person_m = np.tile([0.0, 0.0, 1.5], (61, 1))
    figures = motion_figures(cameras_on(places_m, angles), person_m, 10.0)
    assert figures.extent_m == pytest.approx(2.0)  # the chord of 60 degrees
    assert figures.turn_deg == pytest.approx(60.0)
    assert figures.bend_deg == pytest.approx(60.0)
    assert figures.circle_rms_m == pytest.approx(0.0, abs=1e-9)
    assert figures.path_m == pytest.approx(12 * 4 * np.sin(np.deg2rad(2.5)), rel=1e-9)
    assert figures.distance_m == pytest.approx(2.0)
    assert figures.goes_round
    beside_m = person_m + np.array([5.0, 0.0, 0.0])
    assert not motion_figures(cameras_on(places_m, angles), beside_m, 10.0).goes_round


@cache
def walk_and_cameras(seed: int, kind: int) -> tuple[np.ndarray, np.ndarray]:
    """A pelvis' path (40, 3), and cameras of a programme that film it; nobody changes them."""
    time_s = np.arange(40) / 10
    pelvis_m = np.c_[1.2 * time_s, 0.05 * np.sin(6 * time_s), np.full(40, 0.9)]
    rng = np.random.default_rng(seed)
    path = camera_path(PROGRAMMES[kind], pelvis_m, 10.0, 640, 360, 60.0, rng)
    return pelvis_m, path.world_from_cam


@given(
    yaw=st.floats(-3.1, 3.1),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    seed=st.integers(0, 5),
    kind=st.sampled_from(range(len(PROGRAMMES))),
)
def test_the_world_and_the_direction_of_time_do_not_matter(yaw, shift, seed, kind):
    pelvis_m, cameras = walk_and_cameras(seed, kind)
    world = rigid(Rotation.from_euler("z", yaw).as_matrix(), np.array([*shift, 0.0]))
    moved_m = pelvis_m @ world[:3, :3].T + world[:3, 3]
    before = classify(cameras, pelvis_m, 10.0, CONFIG)[0]
    assert classify(world @ cameras, moved_m, 10.0, CONFIG)[0] == before
    assert classify(cameras[::-1], pelvis_m[::-1], 10.0, CONFIG)[0] == before


def test_one_frame_is_a_static_camera():
    found, figures = classify(np.eye(4)[None], np.array([[0.0, 3.0, 1.0]]), 30.0, CONFIG)
    assert found == "static" and figures.path_m == 0.0


@pytest.mark.parametrize("length", [0, 3])
def test_what_is_no_path_is_refused(length):
    cameras = np.tile(np.eye(4), (length, 1, 1))
    with pytest.raises(BadMotionFile, match="finite cameras"):
        classify(cameras, np.full((length, 3), np.nan), 30.0, CONFIG)
