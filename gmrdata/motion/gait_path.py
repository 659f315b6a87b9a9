"""Where an embedded motion goes: a path on the ground, and the steps along it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from gmrdata.motion.gait_style import GaitStyle

Curve = Callable[[np.ndarray], np.ndarray]

FIGURE_EIGHT_RAD = 2.404825557695773
"""First zero of the Bessel function J0: a heading a*sin(2*pi*s/L) with this a makes an eight."""

BEND = 0.15
"""Bends shorten steps by 1 / (1 + BEND * curvature^2): to half where the radius is about 0.4 m."""


@dataclass(frozen=True, eq=False)
class GroundPath:
    """A path over the ground by its own length s."""

    position_m: Curve
    """(N,) s [m] -> (N, 2) position on the ground [m]."""
    facing_rad: Curve
    """(N,) s [m] -> (N,) direction that the person faces, from world x towards world y [rad]."""
    curvature_rad_m: Curve
    """(N,) s [m] -> (N,) change of `facing_rad` per metre [rad/m]."""
    steps_at: Curve
    """(N,) s [m] -> (N,) step count that has been reached there."""
    s_at: Curve
    """(N,) step count -> (N,) s [m]; the inverse of `steps_at`."""


def draw_path(kind: str, n_steps: float, style: GaitStyle, rng: np.random.Generator) -> GroundPath:
    """Draw a path that is long enough for `n_steps` steps, and some before 0 and after the end."""
    start_m, stop_m = -5 * style.step_m, (n_steps + 8) * style.step_m
    heading_rad = rng.uniform(-np.pi, np.pi)
    turned = _heading(kind, stop_m, rng)
    s_m = np.linspace(start_m, stop_m, int((stop_m - start_m) / 0.03) + 2)
    facing = CubicSpline(s_m, heading_rad + turned(s_m))
    if kind == "side_step":
        velocity = _to_and_fro(s_m, heading_rad, rng)
    else:
        velocity = np.stack([np.cos(facing(s_m)), np.sin(facing(s_m))], axis=-1)
    curvature = facing.derivative()
    pace = 1 + 0.05 * np.sin(0.7 * s_m + style.wander[0])
    steps = CubicSpline(
        s_m, (1 + BEND * curvature(s_m) ** 2) * pace / style.step_m
    ).antiderivative()
    steps_at_zero = steps(0.0)
    return GroundPath(
        position_m=CubicSpline(s_m, velocity).antiderivative(),
        facing_rad=facing,
        curvature_rad_m=curvature,
        steps_at=lambda s: steps(s) - steps_at_zero,
        s_at=CubicSpline(steps(s_m) - steps_at_zero, s_m),
    )


def _heading(kind: str, length_m: float, rng: np.random.Generator) -> Curve:
    """Heading along the path, relative to its heading at the start [rad]."""
    if kind == "circle":
        curvature = rng.choice([-1.0, 1.0]) / rng.uniform(1.3, 4.0)
        return lambda s: curvature * s
    if kind == "figure_eight":
        period_m, phase = rng.uniform(15.0, 24.0), rng.uniform(0, 2 * np.pi)
        return lambda s: FIGURE_EIGHT_RAD * np.sin(2 * np.pi * s / period_m + phase)
    if kind == "turn":
        return _turns(length_m, rng)
    if kind == "side_step":
        return lambda s: np.zeros_like(s)
    if kind == "step_up":
        curvature = rng.uniform(-0.03, 0.03)
        return lambda s: curvature * s
    swing_rad, period_m = rng.uniform(0.05, 0.3), rng.uniform(9.0, 16.0)
    if kind == "run":
        period_m *= 2
    phase = rng.uniform(0, 2 * np.pi)
    return lambda s: swing_rad * np.sin(2 * np.pi * s / period_m + phase)


def _turns(length_m: float, rng: np.random.Generator) -> Curve:
    """Turns of 40 to 120 degrees, 1.2 to 3 m long, with straight stretches between them."""
    turns: list[tuple[float, float, float]] = []
    at_m = rng.uniform(0.5, 2.5)
    while at_m < length_m:
        angle_rad = rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(40, 120))
        over_m = max(1.2, abs(angle_rad) * rng.uniform(1.0, 1.4))
        turns.append((at_m, over_m, float(angle_rad)))
        at_m += over_m + rng.uniform(0.6, 3.5)

    def heading(s: np.ndarray) -> np.ndarray:
        total = np.zeros_like(s)
        for at, over, angle in turns:
            total = total + angle * ease((s - at) / over)
        return total

    return heading


def _to_and_fro(s_m: np.ndarray, facing_rad: float, rng: np.random.Generator) -> np.ndarray:
    """Sideways direction of travel, which turns back now and then: (N, 2)."""
    period_m = rng.uniform(3.5, 7.0)
    sideways = np.tanh(3 * np.sin(2 * np.pi * s_m / period_m + rng.uniform(0, 2 * np.pi)))
    left = np.array([-np.sin(facing_rad), np.cos(facing_rad)])
    return sideways[:, None] * left


def ease(u: np.ndarray) -> np.ndarray:
    """Minimum-jerk step from 0 to 1 over u in [0, 1]: no velocity or acceleration at either end.

    Flash & Hogan, The coordination of arm movements, J. Neuroscience 5 (1985).
    """
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)
