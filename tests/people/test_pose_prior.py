"""The pose prior: its derivatives, and what it is of."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.pose_prior import (
    N_PRIOR,
    PRIOR_FILE,
    PRIOR_JOINTS,
    SHAPES,
    TAG,
    prior_by_turn,
    prior_errors,
)
from gmrdata.values.body import JOINT, MIRRORED
from gmrdata.values.records import read_arrays
from gmrdata.values.transforms import rotmats_from_rotvecs


def posed(turns_rad: np.ndarray) -> np.ndarray:
    """(T, 24, 3, 3) of turns (T, 7, 3) of the prior's joints."""
    rotmats = np.tile(np.eye(3), (len(turns_rad), 24, 1, 1))
    rotmats[:, PRIOR_JOINTS] = rotmats_from_rotvecs(turns_rad)
    return rotmats


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-5, 0.02, 0.8, 1.7]))
def test_derivatives_are_those_of_small_turns(seed, size_rad):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(2, len(PRIOR_JOINTS), 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    rotmats = posed(size_rad * directions)
    small_rad = 1e-5 * rng.normal(size=directions.shape)
    turned = rotmats.copy()
    turned[:, PRIOR_JOINTS] = rotmats[:, PRIOR_JOINTS] @ rotmats_from_rotvecs(small_rad)
    wanted = np.einsum("tejl,tjl->te", prior_by_turn(rotmats), small_rad)
    found = prior_errors(turned) - prior_errors(rotmats)
    np.testing.assert_allclose(found, wanted, atol=2e-7)


def test_errors_are_mahalanobis_distances():
    arrays = read_arrays(PRIOR_FILE, TAG, SHAPES)
    turns_rad = np.random.default_rng(0).normal(0, 0.4, (3, len(PRIOR_JOINTS), 3))
    off = turns_rad.reshape(3, -1) - arrays["mean_rad"]
    wanted = np.einsum("ti,ij,tj->t", off, np.linalg.inv(arrays["covariance_rad2"]), off)
    found = (prior_errors(posed(turns_rad)) ** 2).sum(-1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_both_sides_are_alike():
    turns_rad = np.random.default_rng(1).normal(0, 0.4, (4, len(PRIOR_JOINTS), 3))
    sides = [PRIOR_JOINTS.index(MIRRORED[joint]) for joint in PRIOR_JOINTS]
    mirrored = turns_rad[:, sides] * np.array([1.0, -1.0, -1.0])
    found = [(prior_errors(posed(turns)) ** 2).sum(-1) for turns in (turns_rad, mirrored)]
    np.testing.assert_allclose(*found, rtol=1e-3)


def test_who_squats_is_nearly_as_usual_and_who_twists_is_not():
    straight = np.zeros((1, len(PRIOR_JOINTS), 3))
    squat, twist = straight.copy(), straight.copy()
    for side in ("left", "right"):
        squat[0, PRIOR_JOINTS.index(JOINT[f"{side}_hip"]), 0] = np.deg2rad(-100)
        squat[0, PRIOR_JOINTS.index(JOINT[f"{side}_knee"]), 0] = np.deg2rad(120)
    twist[0, PRIOR_JOINTS.index(JOINT["spine2"]), 1] = np.deg2rad(40)
    straight2, squat2, twist2 = (
        (prior_errors(posed(turns)) ** 2).sum() for turns in (straight, squat, twist)
    )
    assert straight2 < N_PRIOR
    assert squat2 < N_PRIOR
    assert twist2 > 2 * N_PRIOR
