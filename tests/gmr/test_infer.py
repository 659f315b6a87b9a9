"""Prediction: from local poses to a world that is level, at the poses' own rate."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.infer import predict_at_source_rate, stand, stand_and_say
from gmrdata.gmr.predict import predict_deltas, predict_world_motion
from gmrdata.motion.ground import sole_points_m
from gmrdata.motion.resample import resample
from gmrdata.values import transforms
from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.transforms import angles_rad
from gmrdata.world.upright import up_of_standing_feet
from tests.motions import moved


@pytest.fixture
def motion(make_clips) -> Motion:
    return make_clips(1, 3, fps_hz=10.0)[0].motion


def test_the_motion_between_frames_is_the_networks(untrained, motion):
    world = predict_world_motion(untrained, motion)
    assert world.n_frames == motion.n_frames
    assert np.array_equal(world.root_rotmats[0], np.eye(3))
    assert np.array_equal(world.pelvis_m[0], np.zeros(3))
    found = deltas(world.root_rotmats, world.pelvis_m)
    expected = predict_deltas(untrained, motion.local_rotmats)
    np.testing.assert_allclose(found[0], expected[0], atol=1e-12)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-12)
    assert np.abs(expected[1]).max() > 1e-3
    assert np.array_equal(world.local_rotmats, motion.local_rotmats)
    assert world.frame == "world"
    assert world.source == (
        f"world motion predicted by GMR untrained (step 3) from: {motion.source}"
    )


def test_a_first_pose_moves_the_whole(untrained, motion):
    first = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix()
    place_m = np.array([1.0, 2.0, 3.0])
    placed = predict_world_motion(
        untrained, motion, first_root_rotmat=first, first_pelvis_m=place_m
    )
    still = predict_world_motion(untrained, motion)
    expected = transforms.rigid(first, place_m) @ transforms.rigid(
        still.root_rotmats, still.pelvis_m
    )
    np.testing.assert_allclose(
        transforms.rigid(placed.root_rotmats, placed.pelvis_m), expected, atol=1e-11
    )


@pytest.mark.parametrize(
    "first",
    [
        {"first_pelvis_m": np.array([0.0, np.nan, 0.0])},
        {"first_root_rotmat": np.full((3, 3), np.nan)},
        {"first_root_rotmat": -np.eye(3)},
    ],
)
def test_a_first_pose_that_is_none_is_refused(first, untrained, motion):
    """It gave a path of NaN, or of a mirrored world."""
    with pytest.raises(BadMotionFile, match="first pose is no rotation"):
        predict_world_motion(untrained, motion, **first)


@pytest.mark.parametrize("predict", [predict_world_motion, predict_at_source_rate])
def test_the_given_root_is_not_looked_at(predict, walk, untrained):
    """Camera-motion agnostic: any root gives the same bytes, even none at all."""
    motion = walk(30.0, 47)
    shaken = replace(
        motion,
        root_rotmats=Rotation.random(47, random_state=1).as_matrix(),
        pelvis_m=np.full((47, 3), np.nan),
        frame="camera",
    )
    a, b = predict(untrained, motion), predict(untrained, shaken)
    assert a.root_rotmats.tobytes() == b.root_rotmats.tobytes()
    assert a.pelvis_m.tobytes() == b.pelvis_m.tobytes()


def test_another_rate_is_brought_to_the_networks_and_said(untrained, make_clips):
    motion = make_clips(1, 3, fps_hz=30.0)[0].motion
    world = predict_world_motion(untrained, motion)
    assert world.fps_hz == 10.0
    assert world.n_frames == 40
    assert np.array_equal(world.local_rotmats, motion.local_rotmats[::3])
    assert world.source.endswith("resampled from 30 to 10 fps")


def test_a_rate_that_is_no_multiple_is_resampled(untrained, make_clips):
    motion = make_clips(1, 3, fps_hz=25.0)[0].motion
    world = predict_world_motion(untrained, motion)
    assert (world.fps_hz, world.n_frames) == (10.0, 40)
    np.testing.assert_allclose(world.local_rotmats[::2], motion.local_rotmats[::5], atol=1e-9)
    assert world.source.endswith("resampled from 25 to 10 fps")
    with pytest.raises(BadMotionFile, match="5 fps is lower than 10 fps"):
        predict_world_motion(untrained, replace(motion, fps_hz=5.0))


def test_other_joints_are_named_and_arrays_may_be_read_only(untrained, motion):
    """torch said that of the sizes of its tensors, and warned of arrays that can't be written."""
    for local in (motion.rotmats, motion.local_rotmats[:, :21], motion.local_rotmats[1:]):
        with pytest.raises(BadMotionFile, match=r"local rotations .*, and not \(40, 23, 3, 3"):
            predict_world_motion(untrained, replace(motion, local_rotmats=local))
    kept = motion.local_rotmats.copy()
    kept.flags.writeable = False
    world = predict_world_motion(untrained, replace(motion, local_rotmats=kept))
    assert np.array_equal(world.pelvis_m, predict_world_motion(untrained, motion).pelvis_m)


def test_rotations_stay_orthonormal_over_a_long_sequence(untrained):
    rng = np.random.default_rng(0)
    local = Rotation.from_rotvec(rng.normal(0, 0.2, (3000 * 23, 3))).as_matrix()
    delta_rotmats, _ = predict_deltas(untrained, local.reshape(3000, 23, 3, 3))
    product = delta_rotmats @ np.swapaxes(delta_rotmats, 1, 2)
    assert np.abs(product - np.eye(3)).max() < 1e-14


def test_one_frame_and_nan_are_refused(untrained, motion):
    short = motion.take(slice(1))
    with pytest.raises(BadMotionFile, match="less than two frames"):
        predict_world_motion(untrained, short)
    local = motion.local_rotmats.copy()
    local[5, 2] = np.nan
    with pytest.raises(BadMotionFile, match=r"clip gmrdata gait .*: frame 5 holds NaN"):
        predict_world_motion(untrained, replace(motion, local_rotmats=local))


@settings(max_examples=25)
@given(angles=st.tuples(*[st.floats(-1.2, 1.2)] * 2), shift=st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_tilted_world_is_made_upright_again(angles, shift, walk, small_body):
    motion = walk(30.0, 60)
    tilt = Rotation.from_euler("xy", angles).as_matrix()
    found = stand(moved(motion, transforms.rigid(tilt, np.array(shift))), small_body)
    level = stand(motion, small_body)
    # Heading is free: what is compared is each frame's up and height, and steps over the ground.
    up_found, up_level = found.root_rotmats[:, 2], level.root_rotmats[:, 2]
    np.testing.assert_allclose(up_found, up_level, atol=1e-6)
    np.testing.assert_allclose(found.pelvis_m[:, 2], level.pelvis_m[:, 2], atol=1e-6)
    steps = [np.linalg.norm(np.diff(m.pelvis_m, axis=0), axis=1) for m in (found, level)]
    np.testing.assert_allclose(steps[0], steps[1], atol=1e-9)


def test_the_walk_stands_within_a_degree_or_two_of_its_true_world(walk, small_body):
    motion = walk(30.0, 90)
    found = stand(motion, small_body)
    turned = found.root_rotmats[0] @ motion.root_rotmats[0].T
    up = turned @ (0.0, 0.0, 1.0)
    assert np.rad2deg(np.arccos(up[2])) < 2.0
    np.testing.assert_allclose(found.pelvis_m[0, :2], 0.0, atol=1e-12)
    assert abs(found.pelvis_m[:, 2].mean() - motion.pelvis_m[:, 2].mean()) < 0.03
    relative = turned.T @ found.root_rotmats @ np.swapaxes(motion.root_rotmats, 1, 2)
    # Roll and pitch follow the floor, and the mass over the feet, from step to step.
    assert np.rad2deg(angles_rad(relative).max()) < 1.3


@pytest.mark.parametrize("rise_m", [0.0, 0.6])
def test_a_walk_on_steps_is_said_to_be_one(walk, small_body, rise_m):
    motion = walk(30.0, 90)
    steps_m = rise_m * np.round(4 * np.linspace(0, 1, 90)) / 4
    pelvis_m = motion.pelvis_m + steps_m[:, None] * [0.0, 0.0, 1.0]
    found, level = stand_and_say(replace(motion, pelvis_m=pelvis_m), small_body)
    assert level is not None and level.soles_above_m is not None
    assert (level.soles_above_m > 0.3) == (level.remark is not None) == bool(rise_m)
    soles_m = sole_points_m(small_body, found)[:, :, 2].min(axis=1)
    assert np.percentile(soles_m, 5) > -0.1 and np.percentile(soles_m, 10) < 0.1


def test_without_standing_feet_the_world_is_kept(walk, small_body):
    motion = walk(30.0, 40)
    flying = replace(motion, pelvis_m=motion.pelvis_m + np.arange(40)[:, None] * [0.5, 0, 0])
    assert up_of_standing_feet(flying, small_body) is None
    found = stand(flying, small_body)
    np.testing.assert_allclose(found.root_rotmats, motion.root_rotmats, atol=1e-12)
    assert found.source.endswith("no foot stands still; up from the first pelvis")


@pytest.mark.parametrize("n_frames", [2, 3])
def test_few_frames_do(n_frames, walk, small_body):
    assert stand(walk(10.0, n_frames), small_body).n_frames == n_frames


RATES = [(30.0, 46), (30.0, 47), (30.0, 48), (25.0, 40), (29.97, 40), (10.0, 20), (120.0, 200)]


@pytest.mark.parametrize(("fps_hz", "n_frames"), RATES)
def test_every_pose_gets_a_root_and_the_networks_moments_stand(fps_hz, n_frames, walk, untrained):
    motion = walk(fps_hz, n_frames)
    world = predict_at_source_rate(untrained, motion)
    assert (world.n_frames, world.fps_hz, world.frame) == (n_frames, fps_hz, "world")
    assert world.local_rotmats.tobytes() == motion.local_rotmats.tobytes()
    np.testing.assert_allclose(
        world.root_rotmats @ np.swapaxes(world.root_rotmats, 1, 2),
        np.broadcast_to(np.eye(3), (n_frames, 3, 3)),
        atol=1e-12,
    )
    seen = predict_world_motion(untrained, motion, first_root_rotmat=WORLD_FROM_REST)
    rows = np.arange(seen.n_frames) * fps_hz / 10.0
    on_a_frame = np.abs(rows - rows.round()) < 1e-6
    assert on_a_frame.sum() >= 1
    whole = rows.round().astype(int)[on_a_frame]
    np.testing.assert_allclose(world.pelvis_m[whole], seen.pelvis_m[on_a_frame], atol=1e-12)
    np.testing.assert_allclose(world.root_rotmats[whole], seen.root_rotmats[on_a_frame], atol=1e-12)


@pytest.mark.parametrize(("fps_hz", "n_frames"), RATES)
def test_a_constant_motion_is_the_same_at_any_rate(fps_hz, n_frames, walk, constant):
    """Without turning the path is a straight line, and without moving the turn is steady."""
    motion = walk(fps_hz, n_frames)
    seconds = np.arange(n_frames) / fps_hz
    gliding = predict_at_source_rate(constant((0, 0, 0), (0.0, 0.02, 0.1)), motion)
    speed_m_per_s = WORLD_FROM_REST @ (0.0, 0.2, 1.0)
    np.testing.assert_allclose(gliding.pelvis_m, seconds[:, None] * speed_m_per_s, atol=1e-6)
    turning = predict_at_source_rate(constant((0.0, 0.3, 0.1), (0, 0, 0)), motion)
    rotvecs = seconds[:, None] * np.array([0.0, 3.0, 1.0])
    expected = WORLD_FROM_REST @ Rotation.from_rotvec(rotvecs).as_matrix()
    np.testing.assert_allclose(turning.root_rotmats, expected, atol=1e-6)


def test_the_end_is_what_the_network_sees_in_the_last_poses(walk, untrained):
    """Of 48 frames at 30 fps the network's last is 45; 46 and 47 come from frames 44 and 47."""
    motion = walk(30.0, 48)
    world = predict_at_source_rate(untrained, motion)
    late = resample(motion, 10.0, start_s=2 / 30)
    delta_rotmats, delta_m = predict_deltas(untrained, late.local_rotmats)
    turn, step_m = Rotation.from_matrix(delta_rotmats[-1]).as_rotvec(), delta_m[-1]
    for ahead in (1, 2):
        found = world.root_rotmats[45].T @ world.root_rotmats[45 + ahead]
        expected = Rotation.from_rotvec(turn * ahead / 3).as_matrix()
        np.testing.assert_allclose(found, expected, atol=1e-12)
        # The step is straight in the frame of 44, of which 45 is a third of the turn further.
        in_44 = Rotation.from_rotvec(turn / 3).as_matrix() @ (
            world.root_rotmats[45].T @ (world.pelvis_m[45 + ahead] - world.pelvis_m[45])
        )
        np.testing.assert_allclose(in_44, step_m * ahead / 3, atol=1e-12)


def test_too_slow_too_short_and_nan_are_refused(walk, untrained):
    motion = walk(30.0, 40)
    with pytest.raises(BadMotionFile, match="5 fps is lower than 10 fps"):
        predict_at_source_rate(untrained, replace(motion, fps_hz=5.0))
    with pytest.raises(BadMotionFile, match="less than two frames at 10 fps"):
        predict_at_source_rate(untrained, walk(30.0, 3))
    assert predict_at_source_rate(untrained, walk(30.0, 4)).n_frames == 4
    broken = motion.local_rotmats.copy()
    broken[7, 3] = np.nan
    with pytest.raises(BadMotionFile, match="frame 7 holds NaN"):
        predict_at_source_rate(untrained, replace(motion, local_rotmats=broken))


def test_the_record_says_what_was_done(walk, untrained):
    at_30 = predict_at_source_rate(untrained, walk(30.0, 47)).source
    assert at_30.endswith("resampled from 30 to 10 fps, and back")
    assert at_30.startswith("world motion predicted by GMR untrained (step 3) from: ")
    assert "resampled" not in predict_at_source_rate(untrained, walk(10.0, 20)).source
