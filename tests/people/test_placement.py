"""Where a body of known pose stands."""

from dataclasses import replace

import numpy as np

from gmrdata.people.local_poses import place
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from tests.people.exact import seen_exactly, some_of


def test_a_known_body_stands_on_its_landmarks(walk: Motion, anny: BodyModel) -> None:
    found = place(seen_exactly(walk, anny), walk.rotmats, anny.rest_joints_m(walk.shape))
    np.testing.assert_allclose(found, walk.pelvis_m, atol=0.02)  # it is smooth


def test_a_body_that_is_a_tenth_too_large_stands_a_tenth_too_far(
    walk: Motion, anny: BodyModel
) -> None:
    larger_m = 1.1 * anny.rest_joints_m(walk.shape)
    found = place(seen_exactly(walk, anny), walk.rotmats, larger_m)
    np.testing.assert_allclose(found[:, 2] / walk.pelvis_m[:, 2], 1.1, atol=0.01)


def test_noise_of_one_frame_is_no_leap(walk: Motion, anny: BodyModel) -> None:
    seen = seen_exactly(walk, anny)
    rays = seen.rays.copy()
    rays[10] = rays[10].mean(0) + 1.3 * (rays[10] - rays[10].mean(0))  # as if it were much nearer
    found = place(replace(seen, rays=rays), walk.rotmats, anny.rest_joints_m(walk.shape))
    assert np.abs(found[10, 2] - walk.pelvis_m[10, 2]) < 0.45  # 0.92 m nearer by itself


def test_one_frame_has_a_place(walk: Motion, anny: BodyModel) -> None:
    seen = some_of(seen_exactly(walk, anny), slice(3, 4))
    found = place(seen, walk.rotmats[3:4], anny.rest_joints_m(walk.shape))
    np.testing.assert_allclose(found[0], walk.pelvis_m[3], atol=0.01)
