"""Clips to arrays: 60 Hz, keypoints, and what can't become a sequence."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gmrdata.read.threedpw_files import SequenceArrays
from gmrdata.threedpw.clips import sequence_arrays
from gmrdata.twins.faults import FEWEST_JOINTS, KeypointConfig, detected_keypoints
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadSequence
from gmrdata.values.skinning import motion_joints_m


def test_60_hz_arrays_hold_the_30_hz_rows_and_their_middles(walk_arrays: SequenceArrays) -> None:
    person = walk_arrays.people[0]
    poses, trans = person.poses_60hz_rad, person.trans_60hz_m
    assert poses is not None and trans is not None
    assert poses.shape == (60, 72) and trans.shape == (60, 3)
    assert np.array_equal(poses[walk_arrays.img_frame_ids], person.poses_rad)
    assert np.array_equal(trans[walk_arrays.img_frame_ids], person.trans_m)
    assert np.allclose(trans[1:-1:2], (trans[0:-2:2] + trans[2::2]) / 2, atol=1e-12)
    assert np.array_equal(trans[-1], trans[-2])  # nothing comes after the last frame


def test_people_share_the_camera_and_stand_on_a_y_up_floor(
    walk_arrays: SequenceArrays, small_body: BodyModel, walkers: list[Clip]
) -> None:
    for person, clip in zip(walk_arrays.people, walkers, strict=True):
        joints_m = person.joints_world_m
        assert joints_m is not None
        exact_m = motion_joints_m(small_body, clip.motion)
        assert np.allclose(joints_m[..., 1], exact_m[..., 2], atol=1e-12)
        assert 0.7 < np.median(joints_m[:, 0, 1]) < 1.2  # the pelvis is up along y
        assert person.template_clothed_m is not None
        assert person.template_clothed_m.shape == small_body.template_m.shape


def test_keypoints_are_noisy_cut_at_the_border_and_gone_below_six(
    walkers: list[Clip], small_body: BodyModel
) -> None:
    clip = walkers[0]
    joints_m = motion_joints_m(small_body, clip.motion)
    camera = camera_of(clip)
    exact = detected_keypoints(
        joints_m, camera, KeypointConfig(noise_px=0.0), np.random.default_rng(0)
    )
    noisy = detected_keypoints(
        joints_m, camera, KeypointConfig(noise_px=1.5), np.random.default_rng(0)
    )
    both = (exact[..., 2] > 0) & (noisy[..., 2] > 0)
    assert (noisy - exact)[both][:, :2].std() == pytest.approx(1.5, rel=0.1)
    assert (exact[both][:, 2] >= 0.6).all() and (exact[both][:, 2] <= 0.95).all()
    assert not exact[:, [0, 14, 15, 16, 17]].any()  # the face is no joint of SMPL
    narrow = replace(camera, width_px=52)
    cut = detected_keypoints(
        joints_m, narrow, KeypointConfig(noise_px=0.0), np.random.default_rng(0)
    )
    n_joints = (cut[..., 2] > 0).sum(axis=1)
    assert ((n_joints == 0) | (n_joints >= FEWEST_JOINTS)).all()
    assert n_joints.min() == 0 or n_joints.min() < (exact[..., 2] > 0).sum(axis=1).min()
    assert (cut[..., 0] < 52).all()


def other_camera(clip: Clip) -> Clip:
    camera = camera_of(clip)
    return replace(clip, camera=replace(camera, world_from_cam=camera.world_from_cam[::-1]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda clip: replace(clip, motion=replace(clip.motion, fps_hz=10.0)), "at 10 Hz"),
        (lambda clip: replace(clip, motion=replace(clip.motion, frame="camera")), "camera frame"),
        (other_camera, "has another camera"),
    ],
)
def test_clips_that_are_no_sequence_are_refused(
    walkers: list[Clip], small_body: BodyModel, change: Callable[[Clip], Clip], said: str
) -> None:
    points_px = [np.zeros((30, 18, 3))] * 2
    with pytest.raises(BadSequence, match=rf"seq: clip walk\.p1 .*{said}"):
        sequence_arrays(
            "seq", [walkers[0], change(walkers[1])], [small_body] * 2, ["female", "male"], points_px
        )
