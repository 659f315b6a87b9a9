"""A network's error is carried over to like poses that no camera sees, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.fusion.network_evidence import corrected_by_like_poses
from gmrdata.fusion.smoothing import ErrorProcess, SeenMotions, SeenPoses
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.motion import Motion, deltas

N, FPS_HZ, CYCLE = 240, 30.0, 30
PHASE = 2 * np.pi * np.arange(N) / CYCLE
BUT_A_GAP = (np.arange(N) < 100) | (np.arange(N) >= 160)  # frames with a camera
TURN = Rotation.from_rotvec([0.02, 0.0, 0.0])


@pytest.fixture
def stepping(small_body: BodyModel) -> Motion:
    """Who swings both legs and goes ahead, a cycle a second."""
    local = np.tile(np.eye(3), (N, 23, 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = np.outer(0.6 * sign * np.sin(PHASE), [1.0, 0.0, 0.0])
        lift = np.outer(0.4 * (1 + sign * np.cos(PHASE)), [1.0, 0.0, 0.0])
        local[:, JOINT[f"{side}_hip"] - 1] = Rotation.from_rotvec(swing).as_matrix()
        local[:, JOINT[f"{side}_knee"] - 1] = Rotation.from_rotvec(lift).as_matrix()
    return Motion(
        local_rotmats=local,
        root_rotmats=Rotation.from_rotvec(np.outer(0.1 * np.sin(PHASE), [0, 1, 0])).as_matrix(),
        pelvis_m=np.outer(np.arange(N) / FPS_HZ, [0.3, 0.0, 1.0]),
        shape=np.zeros(10),
        fps_hz=FPS_HZ,
        body=small_body.name,
        gender="neutral",
        frame="world",
        source="steps",
    )


def error_m() -> np.ndarray:
    """A step that is wrong to the side of the leg in front, and ahead twice a cycle, (N - 1, 3)."""
    middle = (PHASE[:-1] + PHASE[1:]) / 2
    return 0.01 * np.stack([np.sin(middle), 0 * middle, np.cos(2 * middle)], axis=1)


def seen_by_network(motion: Motion) -> SeenMotions:
    turns, steps_m = deltas(motion.root_rotmats, motion.pelvis_m)
    parts = [ErrorProcess(np.full((N - 1, 6), 0.3), np.full(6, time_s)) for time_s in (0.2, 5.0)]
    return SeenMotions(turns @ TURN.inv().as_matrix(), steps_m - error_m(), *parts)


def seen_by_cameras(motion: Motion, known: np.ndarray, noise_m: float = 0.0005) -> SeenPoses:
    covariances = np.tile(noise_m**2 * np.eye(3), (N, 1, 1))
    return SeenPoses(motion.root_rotmats, motion.pelvis_m, known, np.full(N, 0.0005), covariances)


def left_of(motion: Motion, motions: SeenMotions) -> tuple[np.ndarray, np.ndarray]:
    """What is left of the network's errors, (N - 1,) of turns [rad] and steps [m]."""
    turns, steps_m = deltas(motion.root_rotmats, motion.pelvis_m)
    wrong = Rotation.from_matrix(motions.delta_rotmats.swapaxes(-1, -2) @ turns)
    return wrong.magnitude(), np.linalg.norm(steps_m - motions.delta_m, axis=1)


def test_an_error_that_comes_with_each_step_is_taken_off_where_no_camera_sees(
    stepping: Motion, small_body: BodyModel
) -> None:
    before, seen = seen_by_network(stepping), seen_by_cameras(stepping, BUT_A_GAP)
    after = corrected_by_like_poses(small_body, stepping, before, seen)
    hidden = ~(BUT_A_GAP[:-1] & BUT_A_GAP[1:])
    turn_rad, step_m = left_of(stepping, after)
    assert turn_rad[hidden].max() < 0.1 * 0.02
    assert step_m[hidden].max() < 0.1 * 0.01
    np.testing.assert_array_equal(after.delta_m[~hidden], before.delta_m[~hidden])
    np.testing.assert_array_equal(after.delta_rotmats[~hidden], before.delta_rotmats[~hidden])
    assert after.fast is before.fast and after.slow is before.slow


def test_steps_with_the_left_foot_tell_of_those_with_the_right(
    stepping: Motion, small_body: BodyModel
) -> None:
    known = PHASE % (2 * np.pi) < np.pi - 1e-9
    motions, seen = seen_by_network(stepping), seen_by_cameras(stepping, known)
    hidden = ~known[:-1] & ~known[1:]
    before_m = left_of(stepping, motions)[1][hidden]
    after_m = left_of(stepping, corrected_by_like_poses(small_body, stepping, motions, seen))[1]
    assert after_m[hidden].max() < 0.25 * before_m.max()


def test_cameras_that_are_noisier_than_the_network_say_little(
    stepping: Motion, small_body: BodyModel
) -> None:
    motions = seen_by_network(stepping)
    noisy = seen_by_cameras(stepping, BUT_A_GAP, noise_m=1.0)
    after = corrected_by_like_poses(small_body, stepping, motions, noisy)
    assert np.abs(after.delta_m - motions.delta_m).max() < 0.1 * 0.01


def test_nothing_is_carried_over_from_nothing_or_to_nowhere(
    stepping: Motion, small_body: BodyModel
) -> None:
    motions = seen_by_network(stepping)
    for known in (np.zeros(N, dtype=bool), np.arange(N) < 8, np.ones(N, dtype=bool)):
        seen = seen_by_cameras(stepping, known)
        assert corrected_by_like_poses(small_body, stepping, motions, seen) is motions


def test_rows_that_no_camera_knows_may_hold_anything(
    stepping: Motion, small_body: BodyModel
) -> None:
    known = np.arange(N) < 150
    motions, seen = seen_by_network(stepping), seen_by_cameras(stepping, known)
    rotmats, pelvis_m = seen.rotmats.copy(), seen.pelvis_m.copy()
    rotmats[~known], pelvis_m[~known] = np.nan, np.nan
    same = corrected_by_like_poses(small_body, stepping, motions, seen)
    after = corrected_by_like_poses(
        small_body, stepping, motions, replace(seen, rotmats=rotmats, pelvis_m=pelvis_m)
    )
    np.testing.assert_array_equal(after.delta_m, same.delta_m)
