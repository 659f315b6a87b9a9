"""Floors and feet: tilted floors are levelled, flat feet are flat, soles are on z = 0."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.motion.files import read_motion
from gmrdata.motion.ground import (
    floor_height_m,
    foot_corrections,
    motion_of,
    put_on_floor,
    sole_points_m,
)
from gmrdata.values.body import JOINT, WORLD_FROM_REST, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.values.transforms import smallest_rotation


def _world(body: BodyModel, rotmats: np.ndarray, pelvis_m: np.ndarray) -> Motion:
    return motion_of(body, np.zeros(body.n_shape), rotmats, pelvis_m, 60.0, "made up")


def _steps(body: BodyModel, n_stands: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A stiff body that stands 20 frames in each of some places along x and y: rotations, path."""
    rotmats = np.tile(np.eye(3), (20 * n_stands, 24, 1, 1))
    rotmats[:, 0] = WORLD_FROM_REST
    places = np.stack([np.arange(n_stands) * 0.3, np.arange(n_stands) % 3 * 1.0], axis=1)
    height_m = body.rest_joints_m(np.zeros(body.n_shape))[0, 1] - body.template_m[:, 1].min()
    path_m = np.concatenate([places, np.full((n_stands, 1), height_m)], axis=1)
    return rotmats, np.repeat(path_m, 20, axis=0)


def test_a_tilted_floor_is_levelled(small_body):
    rotmats, pelvis_m = _steps(small_body)
    tilt = Rotation.from_euler("xy", [1.0, -1.2], degrees=True).as_matrix()
    tilted = rotmats.copy()
    tilted[:, 0] = tilt @ rotmats[:, 0]
    moved = _world(small_body, tilted, pelvis_m @ tilt.T + [0, 0, 5.0])
    floored, tilt_deg = put_on_floor(small_body, moved)
    assert tilt_deg == pytest.approx(np.rad2deg(np.arccos(tilt[2, 2])), abs=0.05)
    np.testing.assert_allclose(floored.root_rotmats[:, 2], rotmats[:, 0, 2], atol=1e-3)
    np.testing.assert_allclose(floored.pelvis_m[:, 2], pelvis_m[:, 2], atol=3e-3)


@pytest.mark.parametrize("rise", ["steep", "stairs", "level"])
def test_other_floors_keep_their_form(small_body, rise):
    rotmats, pelvis_m = _steps(small_body)
    heights_m = {
        "steep": 0.15 * pelvis_m[:, 0],
        "stairs": 0.18 * (np.arange(len(pelvis_m)) // 80),
        "level": np.zeros(len(pelvis_m)),
    }[rise]
    path_m = pelvis_m + heights_m[:, None] * [0, 0, 1]
    floored, tilt_deg = put_on_floor(small_body, _world(small_body, rotmats, path_m))
    assert tilt_deg < 1e-4
    np.testing.assert_allclose(floored.root_rotmats, rotmats[:, 0], atol=1e-6)
    expected_m = pelvis_m[:, 2] + heights_m - np.percentile(heights_m, 10)
    np.testing.assert_allclose(floored.pelvis_m[:, 2], expected_m, atol=5e-3)


def _on_hands(body: BodyModel, n_frames: int) -> np.ndarray:
    """Rotations (T, 24, 3, 3) of a stiff body upside down, arms up along the trunk."""
    rotmats = np.tile(np.eye(3), (n_frames, 24, 1, 1))
    rotmats[:, 0] = Rotation.from_euler("x", 180, degrees=True).as_matrix() @ WORLD_FROM_REST
    for side, sign in (("left", 1.0), ("right", -1.0)):
        raised = Rotation.from_euler("z", sign * 85, degrees=True).as_matrix()
        rotmats[:, JOINT[f"{side}_shoulder"]] = raised
    return rotmats


def _sitting(body: BodyModel, n_frames: int) -> np.ndarray:
    """The same of one who sits on the floor with the legs up in the air."""
    rotmats = np.tile(np.eye(3), (n_frames, 24, 1, 1))
    rotmats[:, 0] = WORLD_FROM_REST
    for side in ("left", "right"):
        rotmats[:, JOINT[f"{side}_hip"]] = Rotation.from_euler("x", -2.0).as_matrix()
    return rotmats


@pytest.mark.parametrize("pose", [_on_hands, _sitting])
def test_who_is_not_on_foot_is_not_sunk_into_the_floor(small_body, pose):
    """Feet that were still in the air stood on the floor, and all else was below it."""
    rotmats, pelvis_m = pose(small_body, 60), np.tile([0.3, 0.0, 4.0], (60, 1))
    floored, tilt_deg = put_on_floor(small_body, _world(small_body, rotmats, pelvis_m))
    lowest_m = motion_vertices_m(small_body, floored)[..., 2].min(axis=1)
    np.testing.assert_allclose(lowest_m, 0.0, atol=1e-5)
    assert tilt_deg == 0.0


def test_feet_in_the_air_are_on_no_floor(small_body):
    """Who stood for a third of a second, and on the hands for six, is on the first's floor."""
    rotmats, pelvis_m = _steps(small_body, 1)
    still_m = np.tile(pelvis_m[-1] + [0.0, 0.0, 0.3], (360, 1))
    both = np.concatenate([rotmats, _on_hands(small_body, 360)])
    motion = _world(small_body, both, np.concatenate([pelvis_m, still_m]))
    floored, _ = put_on_floor(small_body, motion)
    np.testing.assert_allclose(floored.pelvis_m[:20, 2], pelvis_m[:, 2], atol=3e-3)


@pytest.mark.parametrize(
    ("share_low", "low_m", "floor_m"),
    [
        (0.15, -0.105, 0.0),  # tiptoes that dip through the floor: CMU 05_05
        (0.2, -0.05, 0.0),  # toes that point down at first: CMU 06_02
        (0.3, -0.1, -0.1),  # as many stand on a floor of its own
        (0.15, -0.4, -0.4),  # too deep for a dip: most of the motion is on a prop
    ],
)
def test_the_floor_is_the_lowest_level_on_which_soles_stand_often(share_low, low_m, floor_m):
    rng = np.random.default_rng(1)
    heights_m = rng.normal(0, 0.003, 400)
    heights_m[: round(share_low * 400)] += low_m
    assert floor_height_m(rng.permutation(heights_m)) == pytest.approx(floor_m, abs=0.006)


@given(
    heights=st.lists(st.integers(-2000, 2000), min_size=1, max_size=60),
    off=st.integers(-5000, 5000),
)
def test_the_floor_is_among_the_heights_and_moves_with_them(heights, off):
    """In steps of 1/1024 m, so that sums are exact and no height lies on a level's edge."""
    heights_m = np.array(heights) / 1024
    floor_m = floor_height_m(heights_m)
    assert heights_m.min() <= floor_m <= heights_m.max()
    assert floor_height_m(heights_m + off / 1024) == pytest.approx(floor_m + off / 1024, abs=1e-9)


def test_sole_points_are_the_bodys_lowest_vertices(anny):
    shape = np.zeros(anny.n_shape)
    motion = _world(anny, np.tile(np.eye(3), (1, 24, 1, 1)), np.zeros((1, 3)))
    soles_m = sole_points_m(anny, motion)
    lowest = anny.template_m[:, 1].min() - anny.rest_joints_m(shape)[0, 1]
    assert soles_m[0, :, 1].min() == pytest.approx(lowest, abs=1e-9)
    assert soles_m.shape[1] < 80


def _legs(
    splay_deg: float, rolled: bool, toes_out_deg: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A zero pose whose legs are splayed, feet rolled with them or flat; and its toe tips."""
    rest_m, tips_m = np.full((24, 3), np.nan), np.zeros((2, 3))
    for row, (side, sign) in enumerate((("left", 1.0), ("right", -1.0))):
        splay = Rotation.from_euler("z", sign * splay_deg, degrees=True).as_matrix()
        foot = splay if rolled else np.eye(3)
        outwards = Rotation.from_euler("y", sign * toes_out_deg, degrees=True).as_matrix()
        hip = np.array([0.1 * sign, 0.0, 0.0])
        ankle = hip + splay @ [0, -0.8, 0]
        rest_m[JOINT[f"{side}_hip"]], rest_m[JOINT[f"{side}_ankle"]] = hip, ankle
        rest_m[JOINT[f"{side}_foot"]] = ankle + foot @ outwards @ [0, -0.04, 0.13]
        tips_m[row] = foot @ [0, 0, 0.06]
    return rest_m, tips_m


@pytest.mark.parametrize(
    ("splay_deg", "rolled", "toes_out_deg"),
    [(20, True, 0), (20, False, 0), (4, False, 8), (15, False, 3)],
)
def test_a_flat_foot_of_the_source_is_flat_on_the_body(small_body, splay_deg, rolled, toes_out_deg):
    rest_m, tips_m = _legs(splay_deg, rolled, toes_out_deg)
    body_rest_m = small_body.rest_joints_m(np.zeros(10))
    corrections, _ = foot_corrections(rest_m, tips_m, body_rest_m, {}, {}, 120.0)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        # How the source's foot turns from the zero pose to standing flat with its leg upright.
        flat = Rotation.from_euler("z", -sign * splay_deg * rolled, degrees=True).as_matrix()
        ankle, foot = JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]
        turned = flat @ corrections[ankle]
        np.testing.assert_allclose(turned @ [0, 1, 0], [0, 1, 0], atol=1e-9)
        bone = flat @ (rest_m[foot] - rest_m[ankle])
        body_bone = turned @ (body_rest_m[foot] - body_rest_m[ankle])
        heading = np.arctan2(bone[0], bone[2])
        assert np.arctan2(body_bone[0], body_bone[2]) == pytest.approx(heading, abs=1e-9)


def test_the_pitch_of_standing_feet_counts_as_flat(small_body):
    rest_m, tips_m = _legs(0.0, False)
    body_rest_m = small_body.rest_joints_m(np.zeros(10))
    toes_down = Rotation.from_euler("x", 9, degrees=True).as_matrix()
    joints = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]
    rotations = {joint: np.tile(toes_down, (60, 1, 1)) for joint in joints}
    still = {joint: np.zeros((60, 3)) for joint in joints}
    corrections, pitch_deg = foot_corrections(rest_m, tips_m, body_rest_m, rotations, still, 120.0)
    assert pitch_deg == pytest.approx(-9)
    up = toes_down @ corrections[JOINT["left_ankle"]] @ [0, 1, 0]
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-9)
    running = {joint: np.arange(180).reshape(60, 3) * 0.1 for joint in joints}
    assert foot_corrections(rest_m, tips_m, body_rest_m, rotations, running, 120.0)[1] == 0.0


def _standing_feet(body: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Tilt of the soles [deg] and speed [m/s] of the feet that stand, over both sides."""
    rotmats = motion.rotmats
    joints_m = motion_joints_m(body, motion)
    tilts_deg, speeds = [], []
    for hip, knee, ankle, foot in ((1, 4, 7, 10), (2, 5, 8, 11)):
        ankle_up = (rotmats[:, 0] @ rotmats[:, hip] @ rotmats[:, knee] @ rotmats[:, ankle])[:, :, 1]
        speed = [
            np.linalg.norm(np.gradient(joints_m[:, j], axis=0), axis=1) * motion.fps_hz
            for j in (ankle, foot)
        ]
        stands = (np.maximum(*speed) < 0.15) & (joints_m[:, foot, 2] < 0.12)
        tilts_deg.append(np.rad2deg(np.arccos(np.clip(ankle_up[stands, 2], -1, 1))))
        speeds.append(np.maximum(*speed)[stands])
    return np.concatenate(tilts_deg), np.concatenate(speeds)


@pytest.mark.parametrize(
    "file", ["bvh/16_32.bvh", "bvh/08_02.bvh", "amc/29_03.amc", "bvh/35_04.bvh"]
)
def test_cmus_walkers_stand_flat_on_the_floor(cmu_dir, anny, file):
    motion = read_motion(cmu_dir / file, anny)
    tilts_deg, _ = _standing_feet(anny, motion)
    assert len(tilts_deg) > 30
    assert np.median(tilts_deg) < 7.5
    rows = np.arange(0, motion.n_frames, 20)
    lowest_m = motion_vertices_m(anny, motion, rows)[:, :, 2].min(axis=1)
    assert np.abs(np.median(lowest_m)) < 0.02
    assert lowest_m.min() > -0.06


def test_cmus_tilted_laboratory_floor(cmu_dir, small_body):
    """Subject 08 climbs 7 cm on a walk through the room, in each of its trials alike."""
    for trial in ("08_02", "08_04", "08_05"):
        path = cmu_dir / "bvh" / f"{trial}.bvh"
        raw, level = (read_motion(path, small_body, ground=g) for g in (False, True))
        turned = level.root_rotmats[0] @ raw.root_rotmats[0].T
        tilt_deg = np.rad2deg(Rotation.from_matrix(turned).magnitude())
        assert 0.7 < tilt_deg < 1.6
        assert f"floor levelled by {tilt_deg:.1f} deg" in level.source
        rise = np.abs(np.polyfit(np.arange(level.n_frames), level.pelvis_m[:, 2], 1)[0])
        assert rise * level.n_frames < 0.02


def test_smallest_rotation_of_a_level_floor_is_nothing():
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(smallest_rotation(up, up), np.eye(3))


def test_blenders_process_which_has_no_scipy_can_load_what_it_needs_of_motions():
    names = "gmrdata.motion.ground, gmrdata.motion.rest_pose, gmrdata.motion.resample"
    code = f"import sys; sys.modules['scipy'] = None; import {names}"
    subprocess.run([sys.executable, "-c", code], check=True)
