"""Who neither stands nor falls freely is held by the ground; who jumps flies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.gmr.infer import stand
from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import sole_points_m
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.world.heights import flights, held_upright, on_one_floor

G = 9.81


def leap(fps_hz: float, speed_m_per_s: float) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Heights of a mass with the feet on the floor, and in a leap: legs stretch at 10 m/s2, stay as
    they are in the air, and bend as fast."""
    push_s, air_s = speed_m_per_s / 10.0, 2 * speed_m_per_s / G
    start_s = 0.6 + push_s
    at_s = np.arange(0, start_s + air_s + push_s + 0.6, 1 / fps_hz) - start_s
    legs_m = 0.9 + 5.0 * np.clip(at_s + push_s, 0, push_s) ** 2
    legs_m -= 5.0 * (push_s**2 - np.clip(air_s + push_s - at_s, 0, push_s) ** 2)
    in_air = np.clip(at_s, 0, air_s)
    flown_m = legs_m + speed_m_per_s * in_air - G * in_air**2 / 2
    return legs_m, flown_m, (round(start_s * fps_hz), round((start_s + air_s) * fps_hz))


@pytest.mark.parametrize("speed_m_per_s", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("fps_hz", [25.0, 30.0])
def test_a_leap_is_one_flight(fps_hz, speed_m_per_s):
    on_floor_m, seen_m, (start, stop) = leap(fps_hz, speed_m_per_s)
    ((found_start, found_stop),) = flights(on_floor_m, seen_m, fps_hz)
    assert abs(found_start - start) <= 1 and abs(found_stop - stop) <= 1


@pytest.mark.parametrize("height_m", [0.1, 0.36])
def test_what_rises_too_slowly_is_no_flight(height_m):
    on_floor_m, at_s = np.full(90, 0.95), np.arange(90) / 30
    assert flights(on_floor_m, on_floor_m + height_m * np.sin(np.pi * at_s) ** 2, 30.0) == []


@pytest.fixture
def walk(small_body) -> Motion:
    return make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(0))


def lowest_m(body: BodyModel, motion: Motion) -> np.ndarray:
    return np.asarray(sole_points_m(body, motion)[:, :, 2].min(axis=1))


def raised(motion: Motion, heights_m: np.ndarray) -> Motion:
    return replace(motion, pelvis_m=motion.pelvis_m + heights_m[:, None] * [0.0, 0.0, 1.0])


def test_one_frame_stands_still(walk, small_body):
    """NumPy's error was the answer: a gradient takes two."""
    one = walk.take(slice(40, 41))
    for found in (on_one_floor(small_body, held_upright(small_body, one)), stand(one, small_body)):
        assert found is not None
        assert lowest_m(small_body, found) == pytest.approx([0.0], abs=0.01)


def test_a_walk_stays_as_it_is(walk, small_body):
    found = on_one_floor(small_body, walk)
    assert found is not None
    apart_m = found.pelvis_m[:, 2] - walk.pelvis_m[:, 2]
    assert np.abs(apart_m - apart_m.mean()).max() < 0.01 and abs(apart_m.mean()) < 0.02


def test_who_hovers_is_put_on_the_floor(walk, small_body):
    """As a network had it of a man in jumping jacks: up and down by 0.36 m, once a second."""
    at_s = np.arange(walk.n_frames) / walk.fps_hz
    seen = raised(walk, 0.36 * np.sin(np.pi * at_s) ** 2)
    assert np.median(lowest_m(small_body, seen)) > 0.15
    found = on_one_floor(small_body, seen)
    assert found is not None
    assert np.percentile(np.abs(lowest_m(small_body, found)), 95) < 0.05
    assert abs(np.median(lowest_m(small_body, found))) < 0.01


def test_a_drift_is_taken_away_and_steps_are_not(walk, small_body):
    share = np.linspace(0, 1, walk.n_frames)
    drifting = raised(walk, 0.12 * share)
    found = on_one_floor(small_body, drifting)
    assert found is not None and np.abs(lowest_m(small_body, found)).max() < 0.03
    climbing = raised(walk, 0.6 * np.round(4 * share) / 4)
    assert on_one_floor(small_body, climbing) is None


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("angle_deg", [-4.0, -1.5, 1.5, 4.0])
def test_a_floor_that_rises_under_a_walk_is_level(walk, small_body, axis, angle_deg):
    tilt = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix()
    pelvis_m = walk.pelvis_m @ tilt.T
    seen = replace(walk, root_rotmats=tilt @ walk.root_rotmats, pelvis_m=pelvis_m)
    found, most_deg = on_one_floor(small_body, seen), max(0.4, abs(angle_deg) / 8)
    assert found is not None
    up = (found.root_rotmats @ walk.root_rotmats.swapaxes(-1, -2))[:, :, 2]
    along = walk.pelvis_m[-1] - walk.pelvis_m[0]
    # Soles along a line tell of the tilt along it alone.
    assert np.abs(np.rad2deg(up[:, :2] @ along[:2] / np.linalg.norm(along[:2]))).max() < most_deg


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_world_that_turns_over_is_turned_back(small_body, axis):
    """A network's roll and pitch drift, here by 20 degrees over a walk of 8 s."""
    walk = make_gait("walk", 8.0, 30.0, small_body, np.random.default_rng(0))
    angles = np.linspace(-10.0, 10.0, walk.n_frames)
    turns = Rotation.from_euler(axis, angles[:, None], degrees=True).as_matrix()
    steps_m = np.einsum("tij,tj->ti", turns[:-1], np.diff(walk.pelvis_m, axis=0))
    pelvis_m = walk.pelvis_m[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps_m, axis=0)])
    seen = replace(walk, root_rotmats=turns @ walk.root_rotmats, pelvis_m=pelvis_m)
    up = (held_upright(small_body, seen).root_rotmats @ walk.root_rotmats.swapaxes(-1, -2))[:, :, 2]
    assert np.rad2deg(np.arccos(up[:, 2])).max() < 3.5
    held = on_one_floor(small_body, held_upright(small_body, seen))
    assert held is not None
    up = (held.root_rotmats @ walk.root_rotmats.swapaxes(-1, -2))[:, :, 2]
    assert np.rad2deg(np.arccos(up[:, 2])).max() < 3.5


def test_who_leans_all_the_time_stays_leaning(walk, small_body):
    """As a system sees a person: it shows no drift."""
    lean = Rotation.from_euler("x", 6.0, degrees=True).as_matrix()
    leaning = replace(walk, root_rotmats=lean @ walk.root_rotmats)
    found = held_upright(small_body, leaning).root_rotmats @ leaning.root_rotmats.swapaxes(-1, -2)
    assert np.rad2deg(np.arccos(found[:, 2, 2])).mean() < 1.5
