"""Landmarks on a body, and the camera in which a person's landmarks are compared."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.people.landmark_body import (
    LEG_M,
    SeenLandmarks,
    landmark_offsets_m,
    landmarks_about,
    offsets_of,
)
from gmrdata.people.landmark_network import LANDMARKS, MIRRORED_LANDMARKS
from gmrdata.values.body import JOINT, leg_length_m


def test_the_offsets_that_travel_have_two_like_sides():
    offsets_m = landmark_offsets_m()
    other_side_m = offsets_m[list(MIRRORED_LANDMARKS)] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose((offsets_m + other_side_m) / 2, offsets_m, atol=1e-4)
    assert [LANDMARKS[n] for n in MIRRORED_LANDMARKS[11:13]] == ["right_shoulder", "left_shoulder"]
    assert np.linalg.norm(offsets_m, axis=1).max() < 0.3
    # Limbs' landmarks are above or below joints, and near: the shoulders' on top of them, the heels
    # at the ground.  People whose landmarks were drawn together stood too near by as much.
    limbs = [11, 13, 15, 23, 25, 27]
    assert not offsets_m[limbs][:, [0, 2]].any() and np.abs(offsets_m[limbs, 1]).max() < 0.015
    assert offsets_m[11, 1] > 0.005 and offsets_m[29, 1] < -0.05


def test_landmarks_lie_where_anatomy_has_them(anny):
    """On a body in its rest pose: the nose in front of the head, ears beside it, heels behind."""
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    found = landmarks_about(np.tile(np.eye(3), (1, 24, 1, 1)), rest_joints_m)[0]
    at = dict(zip(LANDMARKS, found, strict=True))
    ankle_m = (rest_joints_m - rest_joints_m[0])[JOINT["left_ankle"]]
    np.testing.assert_allclose(at["left_ankle"], ankle_m, atol=0.014)
    assert at["nose"][2] > at["left_ear"][2] + 0.05
    assert at["left_ear"][0] > 0.03 > -0.03 > at["right_ear"][0]
    assert at["left_heel"][2] < ankle_m[2] < at["left_foot_index"][2]
    assert at["left_hip"][0] > 0.05 and at["left_shoulder"][0] > at["left_hip"][0]


def test_offsets_grow_with_the_legs(anny):
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    grown = offsets_of(rest_joints_m * (1.5 * LEG_M / leg_length_m(rest_joints_m)))
    np.testing.assert_allclose(grown, 1.5 * landmark_offsets_m(), rtol=1e-6)


def cloud(seed: int) -> np.ndarray:
    """(27, 33, 3) points about a person, 4 m before the camera."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.normal(0, 0.4, (27, 33, 3)) + np.array([0.0, 0.0, 4.0]))


def seen_of(points_m: np.ndarray) -> SeenLandmarks:
    rays = points_m[..., :2] / points_m[..., 2:]
    return SeenLandmarks(np.arange(len(rays)) / 15, rays, points_m, np.ones(rays.shape[:2]))


def test_a_person_is_seen_along_its_own_ray():
    points_m = cloud(0)
    points_m[:, [23, 24]] = [[0.1, 0.05, 4.0], [-0.1, 0.05, 4.0]]
    one = seen_of(points_m)
    turned = seen_of(points_m @ Rotation.from_euler("x", 0.3).as_matrix().T)
    ray = turned.rays[:, [23, 24]].mean(axis=1)
    ends = turned.cam_from_ray[..., 2]
    np.testing.assert_allclose(ends[:, :2] / ends[:, 2:], ray, atol=1e-12)
    squares = turned.cam_from_ray @ turned.cam_from_ray.swapaxes(-1, -2)
    np.testing.assert_allclose(squares, np.tile(np.eye(3), (27, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(turned.sizes, one.sizes, rtol=1e-3)
    np.testing.assert_allclose(seen_of(2 * points_m).sizes, one.sizes, rtol=1e-12)
