"""Two-bone inverse kinematics of a leg."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.motion.gait_steps import Leg, turn

BENT = Leg(np.array([0.03, -0.38, 0.02]), np.array([-0.02, -0.41, -0.03]))


@given(
    flexion_rad=st.floats(0.01, 2.4),
    direction=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda v: np.linalg.norm(np.cross(v, (1, 0.2, 0))) > 0.2
    ),
)
def test_the_ankle_arrives(flexion_rad, direction):
    target = BENT.reach_m(flexion_rad) * np.array([direction]) / np.linalg.norm(direction)
    thigh, knee = BENT.solve(target, np.array([[1.0, 0.2, 0.0]]))
    ankle = thigh[0] @ (BENT.thigh_m + knee[0] @ BENT.shank_m)
    np.testing.assert_allclose(ankle, target[0], atol=1e-9)
    np.testing.assert_allclose(knee[0] @ (1, 0, 0), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(thigh[0] @ thigh[0].T, np.eye(3), atol=1e-12)


def test_reach_is_greatest_when_straight_and_shrinks_with_flexion():
    reaches_m = [BENT.reach_m(angle) for angle in np.linspace(0, 2.5, 20)]
    assert (np.diff(reaches_m) < 0).all()


def test_a_plain_leg_bends_like_a_folding_ruler():
    leg = Leg(np.array([0.0, -0.4, 0.0]), np.array([0.0, -0.4, 0.0]))
    right_angle = leg.knee_rad(np.array([0.4 * np.sqrt(2)]))
    assert right_angle == pytest.approx([np.pi / 2])
    # Straight down, half bent: the knee goes to the front (+z), not to the back.
    thigh, _ = leg.solve(np.array([[0.0, -0.4 * np.sqrt(2), 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    assert (thigh[0] @ leg.thigh_m)[2] == pytest.approx(0.4 * np.sin(np.pi / 4))


def test_targets_out_of_reach_give_the_straight_leg():
    far = np.array([[0.0, -2.0, 0.0]])
    thigh, knee = BENT.solve(far, np.array([[1.0, 0.0, 0.0]]))
    ankle = thigh[0] @ (BENT.thigh_m + knee[0] @ BENT.shank_m)
    # The distance is stationary where the leg is straight, so half of the digits are good.
    np.testing.assert_allclose(ankle, [0.0, -BENT.reach_m(0.0), 0.0], atol=1e-7)


def test_turn_follows_the_right_hand():
    np.testing.assert_allclose(turn("x", np.array(np.pi / 2)) @ (0, 1, 0), (0, 0, 1), atol=1e-12)
    assert turn("y", np.zeros((2, 5))).shape == (2, 5, 3, 3)
