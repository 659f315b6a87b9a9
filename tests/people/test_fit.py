"""The fit: a body that lies on landmarks without errors, and what it does with wild ones."""

from dataclasses import replace

import numpy as np

from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.lifter import LiftedPose
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.motion import Motion
from tests.people.exact import aligned_mm, seen_exactly, some_of

STEPS = FitConfig(steps=60)
N = 8


def some(motion: Motion) -> Motion:
    return motion.take(slice(0, N))


def test_exact_landmarks_give_the_pose_and_the_place(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    found = fit(some_of(seen_exactly(walk, anny), slice(0, N)), rest_joints_m, STEPS)
    assert aligned_mm(some(walk), anny, found.rotmats) < 45
    depth = found.pelvis_m[:, 2] / walk.pelvis_m[:N, 2]
    # A person of unknown size: what is not as large stands nearer.
    size = found.leg_m / leg_length_m(rest_joints_m)
    np.testing.assert_allclose(depth / size, 1, atol=0.03)
    np.testing.assert_allclose(np.linalg.det(found.rotmats), 1, atol=1e-5)


def test_from_the_true_poses_it_stays_there(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    start = LiftedPose(walk.rotmats[:N], np.full(N, leg_length_m(rest_joints_m)))
    seen = some_of(seen_exactly(walk, anny), slice(0, N))
    found = fit(seen, rest_joints_m, FitConfig(steps_from_start=20), start)
    assert aligned_mm(some(walk), anny, found.rotmats) < 12


def test_a_frame_of_wild_landmarks_is_bridged(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    seen = some_of(seen_exactly(walk, anny), slice(0, N))
    world_m, rays = seen.world_m.copy(), seen.rays.copy()
    rng = np.random.default_rng(0)
    world_m[5, :23] += rng.normal(0, 0.5, (23, 3))
    rays[5, :23] += rng.normal(0, 0.1, (23, 2))
    start = LiftedPose(walk.rotmats[:N], np.full(N, leg_length_m(rest_joints_m)))
    wild = fit(
        replace(seen, world_m=world_m, rays=rays),
        rest_joints_m,
        FitConfig(steps_from_start=20),
        start,
    )
    assert aligned_mm(some(walk), anny, wild.rotmats) < 20


def test_two_frames_are_enough(walk: Motion, anny: BodyModel) -> None:
    seen = some_of(seen_exactly(walk, anny), slice(0, 2))
    found = fit(seen, anny.rest_joints_m(walk.shape), FitConfig(steps=5))
    assert np.isfinite(found.pelvis_m).all() and found.rotmats.shape == (2, 24, 3, 3)
