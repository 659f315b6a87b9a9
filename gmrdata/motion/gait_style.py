"""GaitStyle: the numbers that make one person's gait, and how they are drawn for each kind.

Typical values: walking from Perry & Burnfield, Gait Analysis (2010); running from Novacheck, The
biomechanics of running, Gait & Posture 7 (1998); the ratio of step length to cadence in walking,
about 0.0065 m per step/min, from Sekiya & Nagasaki, Gait & Posture 7 (1998).
"""

from dataclasses import dataclass, replace

import numpy as np

GAIT_KINDS: tuple[str, ...] = (
    "walk", "run", "turn", "side_step", "circle", "figure_eight", "step_up",
)  # fmt: skip
"""Kinds of embedded motion."""
WALK_RATIO_M_S = 0.39  # step length over cadence in walking: 0.0065 m per step/min
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class GaitStyle:
    """One person's way to move; amplitudes are half of peak to peak.

    `cadence_hz` is of steps; `pelvis_tilt_rad` and `lean_rad` (the chest's) are means, forwards;
    `pelvis_yaw_rad` is with the leading leg, `chest_yaw_rad` against the pelvis; `arm_mean_rad` and
    `arm_swing_rad` are the shoulders' flexion.
    """

    step_m: float  # between successive footfalls along the path
    cadence_hz: float
    duty: float  # share of a stride (two steps) that a foot stands; below 0.5 there is flight
    spacing_m: float  # between the ankles' lines, across the direction that the person faces
    lag_steps: float  # over the foot, the pelvis is so much before the middle of its stance
    toe_out_rad: float
    strike_rad: float  # toes above heel at touch-down [rad]
    toe_off_rad: float  # heel above toes at its largest, just after the foot leaves the ground
    clearance_m: float  # height of the foot's arc in swing, on top of what its pitch gives [m]
    late: float  # how much more of its way a swinging foot makes in the second half; 0 is even
    bob_m: float  # pelvis height amplitude; if positive, highest over the standing leg
    sway_m: float  # pelvis shift towards the standing leg [m]
    pelvis_yaw_rad: float
    pelvis_list_rad: float  # drop of the swing side [rad]
    pelvis_tilt_rad: float
    chest_yaw_rad: float
    lean_rad: float
    arm_swing_rad: float
    arm_mean_rad: float
    arm_out_rad: float
    arm_in_rad: float  # upper arms turned about their own axis, which brings the hands to the front
    elbow_rad: float
    elbow_swing_rad: float  # flexion amplitude; most bent when the arm is in front
    soft_knee_rad: float  # the knee stays bent by at least this much [rad]
    wander: tuple[float, ...]
    """Four phases of the slow changes of pace, step length, gaze and posture [rad]."""

    @property
    def speed_m_s(self) -> float:
        """Mean speed on a straight path."""
        return self.step_m * self.cadence_hz


def sample_style(kind: str, leg_m: float, rng: np.random.Generator) -> GaitStyle:
    """Draw a style for one of GAIT_KINDS and a leg of this length [m]."""
    if kind == "run":
        return _run(leg_m, rng)
    if kind == "side_step":
        return _side_step(leg_m, rng)
    speed_m_s = {"walk": (0.9, 1.55), "step_up": (0.95, 1.2)}.get(kind, (0.95, 1.4))
    return _walk(speed_m_s, leg_m, rng)


def _walk(
    speed_range_m_s: tuple[float, float], leg_m: float, rng: np.random.Generator
) -> GaitStyle:
    speed_m_s = rng.uniform(*speed_range_m_s)
    step_m = min(np.sqrt(WALK_RATIO_M_S * speed_m_s) * rng.uniform(0.92, 1.04), 0.88 * leg_m)
    vigour = speed_m_s / 1.25
    return GaitStyle(
        step_m=float(step_m),
        cadence_hz=float(speed_m_s / step_m),
        duty=rng.uniform(0.59, 0.615),
        spacing_m=rng.uniform(0.11, 0.16),
        lag_steps=0.16,
        toe_out_rad=_rad(rng, 1, 9),
        strike_rad=_rad(rng, 14, 20),
        toe_off_rad=_rad(rng, 58, 66),
        clearance_m=rng.uniform(0.03, 0.05),
        late=0.3,
        bob_m=float(0.042 * step_m**2 * rng.uniform(0.85, 1.15)),
        sway_m=rng.uniform(0.016, 0.028),
        pelvis_yaw_rad=vigour * _rad(rng, 3, 6),
        pelvis_list_rad=_rad(rng, 2.5, 5),
        pelvis_tilt_rad=_rad(rng, 0, 6),
        chest_yaw_rad=vigour * _rad(rng, 3, 6),
        lean_rad=_rad(rng, 0, 5),
        arm_swing_rad=vigour * _rad(rng, 13, 24),
        arm_mean_rad=_rad(rng, -4, 4),
        arm_out_rad=_rad(rng, 10, 16),
        arm_in_rad=_rad(rng, 8, 25),
        elbow_rad=_rad(rng, 14, 26),
        elbow_swing_rad=vigour * _rad(rng, 4, 10),
        soft_knee_rad=_rad(rng, 4, 8),
        wander=tuple(rng.uniform(0, 2 * np.pi, 4)),
    )


def _run(leg_m: float, rng: np.random.Generator) -> GaitStyle:
    walk = _walk((1.25, 1.55), leg_m, rng)
    speed_m_s = rng.uniform(2.4, 3.6)
    cadence_hz = max((2.35 + 0.12 * speed_m_s) * rng.uniform(0.97, 1.05), speed_m_s / (1.5 * leg_m))
    # In flight the body falls freely: a sine of the step's frequency does so at its top.
    fall_m = GRAVITY_M_S2 / (2 * np.pi * cadence_hz) ** 2
    return replace(
        walk,
        step_m=float(speed_m_s / cadence_hz),
        cadence_hz=float(cadence_hz),
        duty=rng.uniform(0.32, 0.36),
        spacing_m=rng.uniform(0.08, 0.12),
        lag_steps=0.14,
        strike_rad=_rad(rng, 0, 8),
        toe_off_rad=_rad(rng, 68, 82),
        clearance_m=float((0.05 + 0.06 * speed_m_s) * rng.uniform(0.85, 1.15)),
        late=0.1,
        bob_m=float(-fall_m * rng.uniform(0.9, 1.0)),
        sway_m=rng.uniform(0.006, 0.012),
        pelvis_yaw_rad=_rad(rng, 4, 8),
        pelvis_tilt_rad=_rad(rng, 6, 12),
        lean_rad=_rad(rng, 7, 13),
        arm_swing_rad=_rad(rng, 26, 38),
        arm_mean_rad=_rad(rng, -14, -6),
        arm_out_rad=_rad(rng, 18, 26),
        arm_in_rad=_rad(rng, 15, 30),
        elbow_rad=_rad(rng, 78, 95),
        elbow_swing_rad=_rad(rng, 5, 12),
        soft_knee_rad=_rad(rng, 8, 13),
    )


def _side_step(leg_m: float, rng: np.random.Generator) -> GaitStyle:
    walk = _walk((0.9, 1.1), leg_m, rng)
    spacing_m = leg_m * rng.uniform(0.42, 0.52)
    return replace(
        walk,
        # Feet close to within spacing - step when the trailing one catches up; they don't touch.
        step_m=float(spacing_m - rng.uniform(0.13, 0.17)),
        cadence_hz=rng.uniform(1.6, 2.1),
        spacing_m=float(spacing_m),
        lag_steps=0.0,
        strike_rad=0.0,
        toe_off_rad=_rad(rng, 14, 24),
        clearance_m=rng.uniform(0.05, 0.08),
        bob_m=rng.uniform(0.005, 0.012),
        sway_m=rng.uniform(0.01, 0.02),
        pelvis_yaw_rad=_rad(rng, 0, 2),
        chest_yaw_rad=_rad(rng, 0, 2),
        arm_swing_rad=_rad(rng, 2, 7),
        arm_out_rad=_rad(rng, 12, 20),
        elbow_rad=_rad(rng, 18, 45),
        soft_knee_rad=_rad(rng, 10, 22),
    )


def _rad(rng: np.random.Generator, low_deg: float, high_deg: float) -> float:
    return float(np.radians(rng.uniform(low_deg, high_deg)))
