"""Landmarks on the body: the tree as elsewhere, sides alike, sizes as the legs."""

import numpy as np
import torch

from gmrdata.motion.gait import make_gait
from gmrdata.people.landmark_network import (
    LANDMARKS,
    LEG_M,
    MIRRORED_LANDMARKS,
    landmark_offsets_m,
    landmarks_on,
    tree_joints,
)
from gmrdata.values.body import JOINT, BodyModel, leg_length_m
from gmrdata.values.skinning import posed_joints_m


def test_joints_are_those_of_the_body(anny: BodyModel) -> None:
    motion = make_gait("walk", 0.5, 10.0, anny, np.random.default_rng(0))
    rest_joints_m = anny.rest_joints_m(motion.shape)
    wanted, turned = posed_joints_m(rest_joints_m, motion.rotmats, np.zeros((motion.n_frames, 3)))
    found, rotmats = tree_joints(torch.as_tensor(rest_joints_m), torch.as_tensor(motion.rotmats))
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-9)
    np.testing.assert_allclose(rotmats.numpy(), turned, atol=1e-9)


def test_the_offsets_that_travel_have_two_like_sides() -> None:
    offsets_m = landmark_offsets_m()
    other_side_m = offsets_m[list(MIRRORED_LANDMARKS)] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose((offsets_m + other_side_m) / 2, offsets_m, atol=1e-4)
    assert [LANDMARKS[n] for n in MIRRORED_LANDMARKS[11:13]] == ["right_shoulder", "left_shoulder"]
    assert np.linalg.norm(offsets_m, axis=1).max() < 0.3


def test_landmarks_lie_where_anatomy_has_them(anny: BodyModel) -> None:
    """On a body in its rest pose: the nose in front of the head, ears beside it, heels behind."""
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    rotmats = torch.eye(3, dtype=torch.float64).expand(24, 3, 3)
    joints_m, turned = tree_joints(torch.as_tensor(rest_joints_m), rotmats)
    leg_m = torch.tensor(leg_length_m(rest_joints_m))
    found = landmarks_on(joints_m, turned, leg_m, torch.as_tensor(landmark_offsets_m())).numpy()
    at = dict(zip(LANDMARKS, found, strict=True))
    ankle_m = joints_m[JOINT["left_ankle"]].numpy()
    assert at["nose"][2] > at["left_ear"][2] + 0.05
    assert at["left_ear"][0] > 0.03 > -0.03 > at["right_ear"][0]
    assert at["left_heel"][2] < ankle_m[2] < at["left_foot_index"][2]
    assert at["left_hip"][0] > 0.05 and at["left_shoulder"][0] > at["left_hip"][0]


def test_offsets_grow_with_the_legs() -> None:
    joints_m, turned = torch.zeros(24, 3), torch.eye(3).expand(24, 3, 3)
    offsets_m = torch.ones(33, 3)
    found = landmarks_on(joints_m, turned, torch.tensor(1.5 * LEG_M), offsets_m)
    np.testing.assert_allclose(found.numpy(), 1.5, rtol=1e-6)
