"""Where up is, from feet that stand still."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.infer import stand, up_of_standing_feet
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.motion_metrics import angles_rad


def tilted(motion: Motion, rotmat: np.ndarray, shift_m: np.ndarray) -> Motion:
    return replace(
        motion,
        root_rotmats=rotmat @ motion.root_rotmats,
        pelvis_m=motion.pelvis_m @ rotmat.T + shift_m,
    )


@settings(max_examples=25)
@given(
    angles=st.tuples(*[st.floats(-1.2, 1.2)] * 2),
    shift=st.tuples(*[st.floats(-5, 5)] * 3),
)
def test_a_tilted_world_is_made_upright_again(
    angles: tuple[float, float],
    shift: tuple[float, float, float],
    walk: Callable[..., Motion],
    small_body: BodyModel,
) -> None:
    motion = walk(30.0, 60)
    tilt = Rotation.from_euler("xy", angles).as_matrix()
    found = stand(tilted(motion, tilt, np.array(shift)), small_body)
    level = stand(motion, small_body)
    # Heading is free: what is compared is each frame's up and height, and steps over the ground.
    up_found, up_level = found.root_rotmats[:, 2], level.root_rotmats[:, 2]
    np.testing.assert_allclose(up_found, up_level, atol=1e-6)
    np.testing.assert_allclose(found.pelvis_m[:, 2], level.pelvis_m[:, 2], atol=1e-6)
    steps = [np.linalg.norm(np.diff(m.pelvis_m, axis=0), axis=1) for m in (found, level)]
    np.testing.assert_allclose(steps[0], steps[1], atol=1e-9)


def test_the_walk_stands_within_a_degree_or_two_of_its_true_world(
    walk: Callable[..., Motion], small_body: BodyModel
) -> None:
    motion = walk(30.0, 90)
    found = stand(motion, small_body)
    turned = found.root_rotmats[0] @ motion.root_rotmats[0].T
    up = turned @ (0.0, 0.0, 1.0)
    assert np.rad2deg(np.arccos(up[2])) < 2.0
    np.testing.assert_allclose(found.pelvis_m[0, :2], 0.0, atol=1e-12)
    assert abs(found.pelvis_m[:, 2].mean() - motion.pelvis_m[:, 2].mean()) < 0.03
    relative = turned.T @ found.root_rotmats @ np.swapaxes(motion.root_rotmats, 1, 2)
    assert angles_rad(relative).max() < 1e-6


def test_without_standing_feet_the_world_is_kept(
    walk: Callable[..., Motion], small_body: BodyModel
) -> None:
    motion = walk(30.0, 40)
    flying = replace(motion, pelvis_m=motion.pelvis_m + np.arange(40)[:, None] * [0.5, 0, 0])
    assert up_of_standing_feet(flying, small_body) is None
    found = stand(flying, small_body)
    np.testing.assert_allclose(found.root_rotmats, motion.root_rotmats, atol=1e-12)
    assert found.source.endswith("no foot stands still; up from the first pelvis")


@pytest.mark.parametrize("n_frames", [2, 3])
def test_few_frames_do(n_frames: int, walk: Callable[..., Motion], small_body: BodyModel) -> None:
    assert stand(walk(10.0, n_frames), small_body).n_frames == n_frames
