"""Verdicts on clips whose faults are put in one at a time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.camera import CameraPath
from gmrdata.geometry.transforms import rigid
from gmrdata.motion.motion import Motion
from gmrdata.pseudogt.verdict import Dropped, Verdict, VerdictConfig, judge
from gmrdata.sfm.cues import CueEstimate
from gmrdata.sfm.scale import ScaleEstimate, fuse

N, FPS_HZ = 90, 30.0
CONFIG = VerdictConfig()
GOOD: dict[str, Any] = {
    "registered_share": 1.0,
    "mean_reprojection_px": 0.3,
    "frames": N,
    "cuts_after_frames": [],
    "inliers_per_frame": [200] * N,
}
SCALE = fuse((CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01),))


def clip_of(world_from_cam: np.ndarray) -> Clip:
    eye = np.tile(np.eye(3), (N, 23, 1, 1))
    motion = Motion(
        eye, eye[:, 0], np.zeros((N, 3)), np.zeros(10), FPS_HZ, "b", "neutral", "world", "test"
    )
    has_camera = np.isfinite(world_from_cam[:, 0, 0])
    camera = CameraPath(np.diag([500.0, 500, 1]), 640, 360, world_from_cam, has_camera)
    return Clip("c", motion, has_camera, np.arange(N), camera)


def circling() -> np.ndarray:
    angles = np.deg2rad(25) * np.arange(N) / FPS_HZ
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    return rigid(turns, turns @ [4.0, 0.0, 1.5])


@pytest.fixture
def clip() -> Clip:
    return clip_of(circling())


def changed(clip: Clip, rows: slice, value: Any) -> Clip:
    world_from_cam = camera_of(clip).world_from_cam.copy()
    world_from_cam[rows] = value
    return clip_of(world_from_cam)


def test_a_good_sequence_is_accepted_whole(clip: Clip) -> None:
    tracked = circling() @ rigid(Rotation.from_rotvec([0, 1.0, 0]).as_matrix(), np.zeros(3))
    same_motion = rigid(np.eye(3), np.array([5.0, 1, 0])) @ circling()
    for other in (None, same_motion):
        assert judge(clip, GOOD, SCALE, CONFIG, tracked=other) == Verdict(True, (), (), 1.0)
    # Another direction of view of the data set's camera is another motion in its own axes.
    assert not judge(clip, GOOD, SCALE, CONFIG, tracked=tracked).accepted


@pytest.mark.parametrize(
    ("figures", "reason"),
    [
        ({"registered_share": 0.6}, "60% of the images have a camera, fewer than 70%"),
        ({"mean_reprojection_px": 1.5}, "reprojection error is 1.50 px, more than 1 px"),
        ({"cuts_after_frames": list(range(0, 88, 2))}, "to another place 44 times"),
    ],
)
def test_a_sequence_that_misses_a_limit_is_rejected_with_both_figures(
    clip: Clip, figures: dict[str, Any], reason: str
) -> None:
    verdict = judge(clip, GOOD | figures, SCALE, CONFIG)
    assert not verdict.accepted and len(verdict.reasons) == 1 and reason in verdict.reasons[0]


def test_an_uncertain_scale_and_cues_that_disagree_reject(clip: Clip) -> None:
    vague = fuse((CueEstimate("planted_feet", 2.0, 0.2, 9, 0.01),))
    assert "uncertain by 10.0%" in judge(clip, GOOD, vague, CONFIG).reasons[0]
    apart = fuse(
        (
            CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01),
            CueEstimate("ground_contact", 2.15, 0.02, 99, 0.01),
        )
    )
    (reason,) = judge(clip, GOOD, apart, CONFIG).reasons
    assert "5.3 standard errors apart" in reason
    # Where scale doesn't enter, nothing is said of it.
    assert judge(clip, GOOD, ScaleEstimate(None, None, ()), CONFIG).accepted


def test_frames_without_a_camera_are_dropped(clip: Clip) -> None:
    verdict = judge(changed(clip, slice(40, 52), np.nan), GOOD, SCALE, CONFIG)
    assert verdict.accepted and verdict.kept_share == pytest.approx(78 / 90)
    assert verdict.dropped == (Dropped(40, 52, "no camera was found"),)


def test_what_the_data_set_does_not_vouch_for_is_dropped_with_its_own_reason(clip: Clip) -> None:
    unusable = ["campose_valid is 0" if row < 20 else "" for row in range(N)]
    verdict = judge(clip, GOOD, SCALE, CONFIG, unusable=unusable)
    assert verdict.dropped == (Dropped(0, 20, "campose_valid is 0"),)


def test_few_inliers_drop_a_frame_and_what_is_too_short_beside_it(clip: Clip) -> None:
    inliers = [200] * N
    inliers[30:35] = inliers[40:45] = [10] * 5
    verdict = judge(clip, GOOD | {"inliers_per_frame": inliers}, SCALE, CONFIG)
    assert verdict.dropped == (
        Dropped(30, 35, "fewer than 25 inliers"),
        Dropped(35, 40, "only 5 usable frames in a row"),
        Dropped(40, 45, "fewer than 25 inliers"),
    )


def test_a_jump_drops_the_frames_beside_it(clip: Clip) -> None:
    after = camera_of(clip).world_from_cam[50:].copy()
    after[:, :3, 3] += [0.0, 0.0, 0.5]  # 15 m/s for one frame
    verdict = judge(changed(clip, slice(50, N), after), GOOD, SCALE, CONFIG)
    assert verdict.dropped == (Dropped(49, 51, "the camera jumps"),)
    turned = camera_of(clip).world_from_cam[50:].copy()
    turned[:, :3, :3] = turned[:, :3, :3] @ Rotation.from_rotvec([0, 0.4, 0]).as_matrix()
    verdict = judge(changed(clip, slice(50, N), turned), GOOD, SCALE, CONFIG)
    assert verdict.dropped == (Dropped(49, 51, "the camera jumps"),)


def test_slow_drift_of_the_data_set_is_no_fault_but_another_motion_is(clip: Clip) -> None:
    time = np.linspace(0, 1, N)
    drift = rigid(
        Rotation.from_rotvec(np.deg2rad(8) * time[:, None] * [0.0, 0.0, 1.0]).as_matrix(),
        0.6 * time[:, None] * [1.0, 0.0, 0.0],
    )
    assert judge(clip, GOOD, SCALE, CONFIG, tracked=drift @ circling()).accepted
    slower = circling()[np.arange(N) // 2]  # wrong intrinsics look like this
    (reason,) = judge(clip, GOOD, SCALE, CONFIG, tracked=slower).reasons
    assert reason.startswith("0% of the frames can be used")
    unknown = np.full((N, 4, 4), np.nan)
    assert judge(clip, GOOD, SCALE, CONFIG, tracked=unknown).accepted


def test_no_usable_frame_is_a_rejection(clip: Clip) -> None:
    verdict = judge(replace(clip, id="x"), GOOD, SCALE, CONFIG, unusable=["bad"] * N)
    assert not verdict.accepted and verdict.kept_share == 0.0
    assert verdict.dropped == (Dropped(0, N, "bad"),)
