"""Prediction at the poses' own rate: exact at the network's moments, whole at both ends."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.gmr.infer import predict_at_source_rate
from gmrdata.gmr.predict import TrainedGmr, predict_deltas, predict_world_motion
from gmrdata.motion.resample import resample
from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion

RATES = [(30.0, 46), (30.0, 47), (30.0, 48), (25.0, 40), (29.97, 40), (10.0, 20), (120.0, 200)]


@pytest.mark.parametrize(("fps_hz", "n_frames"), RATES)
def test_every_pose_gets_a_root_and_the_networks_moments_stand(
    fps_hz: float, n_frames: int, walk: Callable[..., Motion], untrained: TrainedGmr
) -> None:
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
def test_a_constant_motion_is_the_same_at_any_rate(
    fps_hz: float,
    n_frames: int,
    walk: Callable[..., Motion],
    constant: Callable[..., TrainedGmr],
) -> None:
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


def test_the_end_is_what_the_network_sees_in_the_last_poses(
    walk: Callable[..., Motion], untrained: TrainedGmr
) -> None:
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


def test_the_given_root_is_not_looked_at(
    walk: Callable[..., Motion], untrained: TrainedGmr
) -> None:
    motion = walk(30.0, 47)
    shaken = replace(
        motion,
        root_rotmats=Rotation.random(47, random_state=1).as_matrix(),
        pelvis_m=np.full((47, 3), np.nan),
    )
    a = predict_at_source_rate(untrained, motion)
    b = predict_at_source_rate(untrained, shaken)
    assert a.root_rotmats.tobytes() == b.root_rotmats.tobytes()
    assert a.pelvis_m.tobytes() == b.pelvis_m.tobytes()


def test_too_slow_too_short_and_nan_are_refused(
    walk: Callable[..., Motion], untrained: TrainedGmr
) -> None:
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


def test_the_record_says_what_was_done(walk: Callable[..., Motion], untrained: TrainedGmr) -> None:
    at_30 = predict_at_source_rate(untrained, walk(30.0, 47)).source
    assert at_30.endswith("resampled from 30 to 10 fps, and back")
    assert at_30.startswith("world motion predicted by GMR untrained (step 3) from: ")
    assert "resampled" not in predict_at_source_rate(untrained, walk(10.0, 20)).source
