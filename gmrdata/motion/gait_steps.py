"""An embedded motion's path on the ground, the steps along it, and the feet and legs that step.

Feet are exactly planted in stance and on a smooth arc in swing; legs are two bones with a hinge
knee, whose inverse kinematics has a closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from scipy.special import betainc

from gmrdata.motion.gait_style import GaitStyle
from gmrdata.values.body import JOINT, BodyModel, sole_vertices

Curve = Callable[[np.ndarray], np.ndarray]
FIGURE_EIGHT_RAD = 2.404825557695773
"""First zero of the Bessel function J0: a heading a*sin(2*pi*s/L) with this a makes an eight."""
BEND = 0.15
"""Bends shorten steps by 1 / (1 + BEND * curvature^2): to half where the radius is about 0.4 m."""
SIDES = ("left", "right")
SOLE_M = 0.01  # vertices of a foot up to this high above its lowest one are its sole [m]
FIRST_STEP = -4
"""Number of a clip's first footfall; step 0 is the first touch-down of the left foot."""
CIRCUMDUCTION_M = 0.02  # a swinging foot swerves outwards by this much, past the standing one [m]
SOFT_TOES_RAD = np.radians(20.0)
"""In swing, toes of a foot that is pitched by less than this straighten out smoothly [rad]."""


def turn(axis: str, angle_rad: np.ndarray) -> np.ndarray:
    """Rotations by (...) angles about one rest axis "x", "y" or "z": (..., 3, 3)."""
    angle_rad = np.asarray(angle_rad, dtype=np.float64)
    rotmats = Rotation.from_euler(axis, angle_rad.reshape(-1, 1)).as_matrix()
    return rotmats.reshape(*angle_rad.shape, 3, 3)


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg at rest: hip to knee (3,) and knee to ankle (3,) [m].
    Its knee turns about the rest frame's x axis, flexion moves the heel back."""

    thigh_m: np.ndarray
    shank_m: np.ndarray

    def _hinge(self) -> tuple[float, float, float]:
        """Terms of |thigh + Rx(b) shank|^2 = constant + amplitude * cos(b - straight)."""
        (ux, uy, uz), (vx, vy, vz) = self.thigh_m, self.shank_m
        constant = self.thigh_m @ self.thigh_m + self.shank_m @ self.shank_m + 2 * ux * vx
        along, across = uy * vy + uz * vz, uz * vy - uy * vz
        return float(constant), float(2 * np.hypot(along, across)), float(np.arctan2(across, along))

    def reach_m(self, flexion_rad: float) -> float:
        """Distance from hip to ankle with the knee bent by `flexion_rad` from straight [m]."""
        constant, amplitude, _ = self._hinge()
        return float(np.sqrt(constant + amplitude * np.cos(flexion_rad)))

    def knee_rad(self, distance_m: np.ndarray) -> np.ndarray:
        """Knee angle about x, relative to rest, for hip-to-ankle distances (...) [rad].
        Distances beyond the leg's reach give the straight leg, ones too short the folded leg."""
        constant, amplitude, straight_rad = self._hinge()
        cosine = (np.square(distance_m) - constant) / amplitude
        return straight_rad + np.arccos(np.clip(cosine, -1.0, 1.0))

    def solve(self, hip_to_ankle_m: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """frame_from_thigh and thigh_from_shank (T, 3, 3) for a wanted vector (T, 3) in any frame.
        The knee's axis follows `left` (T, 3), in the same frame, as well as it can."""
        knee = turn("x", self.knee_rad(np.linalg.norm(hip_to_ankle_m, axis=-1)))
        at_rest_m = self.thigh_m + knee @ self.shank_m
        lateral = np.broadcast_to(np.array([1.0, 0.0, 0.0]), at_rest_m.shape)
        thigh = _frames(hip_to_ankle_m, left) @ np.swapaxes(_frames(at_rest_m, lateral), -1, -2)
        return thigh, knee


def _frames(along: np.ndarray, hint: np.ndarray) -> np.ndarray:
    """Orthonormal frames (T, 3, 3): first axis `along`, second as near to `hint` as can be."""
    first = along / np.linalg.norm(along, axis=-1, keepdims=True)
    second = hint - np.sum(hint * first, axis=-1, keepdims=True) * first
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


@dataclass(frozen=True, eq=False)
class GroundPath:
    """A path over the ground by its own length s (N,) [m]."""

    position_m: Curve  # position on the ground (N, 2) [m]
    facing_rad: Curve  # direction that the person faces (N,), from world x towards world y [rad]
    curvature_rad_m: Curve  # change of `facing_rad` per metre (N,)
    s_at: Curve  # (N,) step count -> (N,) s [m] where it is reached


def sample_path(
    kind: str, n_steps: float, style: GaitStyle, rng: np.random.Generator
) -> GroundPath:
    """Draw a path that is long enough for `n_steps` steps, and some before 0 and after the end."""
    start_m, stop_m = -5 * style.step_m, (n_steps + 8) * style.step_m
    heading_rad = rng.uniform(-np.pi, np.pi)
    turned = _heading(kind, stop_m, rng)
    s_m = np.linspace(start_m, stop_m, int((stop_m - start_m) / 0.03) + 2)
    facing = CubicSpline(s_m, heading_rad + turned(s_m))
    if kind == "side_step":  # and back now and then
        period_m = rng.uniform(3.5, 7.0)
        sideways = np.tanh(3 * np.sin(2 * np.pi * s_m / period_m + rng.uniform(0, 2 * np.pi)))
        velocity = sideways[:, None] * [-np.sin(heading_rad), np.cos(heading_rad)]
    else:
        velocity = np.stack([np.cos(facing(s_m)), np.sin(facing(s_m))], axis=-1)
    curvature = facing.derivative()
    pace = 1 + 0.05 * np.sin(0.7 * s_m + style.wander[0])
    steps_per_m = (1 + BEND * curvature(s_m) ** 2) * pace / style.step_m
    steps = CubicSpline(s_m, steps_per_m).antiderivative()
    return GroundPath(
        position_m=CubicSpline(s_m, velocity).antiderivative(),
        facing_rad=facing,
        curvature_rad_m=curvature,
        s_at=CubicSpline(steps(s_m) - steps(0.0), s_m),
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
        return np.zeros_like
    if kind == "step_up":
        curvature = rng.uniform(-0.03, 0.03)
        return lambda s: curvature * s
    swing_rad, period_m = rng.uniform(0.05, 0.3), rng.uniform(9.0, 16.0) * (1 + (kind == "run"))
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
    return lambda s: sum(
        (angle * ease((s - at) / over) for at, over, angle in turns), np.zeros_like(s)
    )


def ease(u: np.ndarray) -> np.ndarray:
    """Minimum-jerk step from 0 to 1 over u in [0, 1] (Flash & Hogan, J. Neuroscience 5, 1985)."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


@dataclass(frozen=True, eq=False)
class Footsteps:
    """A clip's (N,) footfalls, from FIRST_STEP on; even ones are the left foot's."""

    s_m: np.ndarray  # place along the path
    across_m: np.ndarray  # place of the ankle to the left of the path, as the person faces
    ahead_m: np.ndarray  # place of the ankle to the front
    ground_m: np.ndarray
    yaw_rad: np.ndarray  # direction of the foot, from world x towards world y


@dataclass(frozen=True, eq=False)
class FootPoses:
    """One foot over T frames, world: (T, 3) ankles, all else by frame."""

    ankle_m: np.ndarray
    rotmats: np.ndarray  # (T, 3, 3) world_from_foot, relative to the T-pose
    toes_rad: np.ndarray  # toes bent up against the foot
    yaw_rad: np.ndarray
    planted: np.ndarray  # bool, from touch-down to toe-off


def upright(facing_rad: np.ndarray) -> np.ndarray:
    """world_from_rest (T, 3, 3) of someone upright who faces (T,): columns left, up, front."""
    cos, sin, zero = np.cos(facing_rad), np.sin(facing_rad), np.zeros_like(facing_rad)
    columns = ([-sin, cos, zero], [zero, zero, zero + 1], [cos, sin, zero])
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def _rest_foot(
    body: BodyModel, shape: np.ndarray, side: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ankle joint, foot joint at the ball, and rear end of the sole of the T-pose, each (3,) [m].

    Rest axes, from the point on the ground below the ankle.  The foot turns about the heel after
    touch-down, and rolls about the ball at push-off.
    """
    joints_m = body.rest_joints_m(shape)
    ankle, ball = joints_m[JOINT[f"{side}_ankle"]], joints_m[JOINT[f"{side}_foot"]]
    vertices_m = body.rest_vertices_m(shape)
    sole = vertices_m[sole_vertices(body, vertices_m, side, SOLE_M)]
    ground_m = sole[:, 1].min()
    below = np.array([ankle[0], ground_m, ankle[2]])
    heel = np.array([ankle[0], ground_m, min(sole[:, 2].min(), ankle[2])])
    return ankle - below, ball - below, heel - below


def plan_footsteps(
    path: GroundPath, style: GaitStyle, ground_m: np.ndarray, rng: np.random.Generator
) -> Footsteps:
    """Put each foot down where the pelvis passes in its stance, on its side of the path.
    `ground_m` (N,) is the height of the ground for each footfall from FIRST_STEP on [m]."""
    number = np.arange(len(ground_m)) + FIRST_STEP
    side = np.where(number % 2 == 0, 1.0, -1.0)
    s_m = path.s_at(number + style.duty - style.lag_steps)
    # A foot already points to where the body will be heading over it.
    facing = path.facing_rad(path.s_at(number + style.duty))
    uneven = rng.normal(size=(3, len(number)))  # a centimetre here and there
    return Footsteps(
        s_m=s_m,
        across_m=side * style.spacing_m / 2 + 0.006 * uneven[0],
        ahead_m=0.008 * uneven[1],
        ground_m=ground_m,
        yaw_rad=facing - side * style.toe_out_rad + np.radians(1.0) * uneven[2],
    )


def ground_under_pelvis(steps: np.ndarray, plan: Footsteps) -> np.ndarray:
    """Height by which the pelvis has followed the ground at (T,) step counts [m].
    It rises in the step that begins as a foot touches down on other ground."""
    row = np.flatnonzero(np.diff(plan.ground_m))
    number = row + 1 + FIRST_STEP
    return plan.ground_m[0] + ease(steps[:, None] - number + 0.1) @ np.diff(plan.ground_m)[row]


@dataclass(frozen=True, eq=False)
class Walk:
    """Planned steps along a path, and where in them somebody is at (T,) times."""

    path: GroundPath
    plan: Footsteps
    style: GaitStyle
    time_s: np.ndarray  # (T,)
    steps: np.ndarray  # (T,) step counts; even: left touch-down


def foot_poses(body: BodyModel, shape: np.ndarray, side: str, walk: Walk) -> FootPoses:
    """Pose the left or the right foot of somebody who walks so.

    It is a flat sole at a footfall, or on its way between two, that is pitched about a pivot: the
    heel after touch-down, the ball before toe-off, and in the air a point from ball to heel.
    """
    steps, plan, style = walk.steps, walk.plan, walk.style
    ankle_m, ball_m, heel_m = _rest_foot(body, shape, side)
    parity = SIDES.index(side)
    number = 2 * np.floor((steps - parity) / 2).astype(int) + parity
    since = steps - number
    stance = 2 * style.duty
    swing = np.clip((since - stance) / (2 - stance), 0.0, 1.0)
    pitch = _pitch_rad(since, style)
    to_heel = np.where(since < stance / 2, 1.0, ease((swing - 0.35) / 0.65))
    pivot = ball_m + to_heel[:, None] * (heel_m - ball_m)
    row = number - FIRST_STEP
    yaw = plan.yaw_rad[row] + ease(swing) * (plan.yaw_rad[row + 2] - plan.yaw_rad[row])
    level, tilted = upright(yaw), turn("x", -pitch)
    ankle = pivot + np.einsum("tij,tj->ti", tilted, ankle_m - pivot)
    # Toes stay level while the foot rolls over the ball.
    toes = np.maximum(-pitch, 0.0)
    toes *= np.where(swing > 0, ease(toes / SOFT_TOES_RAD), 1.0)
    ground = _below_ankle(row, swing, walk.path, plan, style)
    return FootPoses(
        ankle_m=ground + np.einsum("tij,tj->ti", level, ankle),
        rotmats=level @ tilted,
        toes_rad=toes,
        yaw_rad=yaw,
        planted=since < stance,
    )


def _below_ankle(
    row: np.ndarray, swing: np.ndarray, path: GroundPath, plan: Footsteps, style: GaitStyle
) -> np.ndarray:
    """Point of the flat sole below the ankle at (T,) shares of a swing: (T, 3) [m].
    It follows the path's bends: a straight line would lead the outer foot through the inner leg."""
    # Share of the way to the next footfall: at rest at both ends, fastest after half time.  A foot
    # that came to rest sooner would be too far ahead of the hip for the leg to reach.
    share = betainc(2.2 + style.late, 2.2, swing)
    arc = 16 * swing**2 * (1 - swing) ** 2

    def between(values: np.ndarray) -> np.ndarray:
        return values[row] + share * (values[row + 2] - values[row])

    s_m, across = between(plan.s_m), between(plan.across_m)
    across = across + CIRCUMDUCTION_M * np.sign(plan.across_m[row]) * arc
    frames = upright(path.facing_rad(s_m))
    point = across[:, None] * frames[:, :, 0] + between(plan.ahead_m)[:, None] * frames[:, :, 2]
    point[:, :2] += path.position_m(s_m)
    rise = plan.ground_m[row + 2] - plan.ground_m[row]
    early = ease(np.where(rise > 0, swing / 0.7, (swing - 0.3) / 0.7))
    point[:, 2] = plan.ground_m[row] + rise * early
    point[:, 2] += (style.clearance_m + 0.25 * np.abs(rise)) * arc
    return point


def _pitch_rad(since: np.ndarray, style: GaitStyle) -> np.ndarray:
    """Toes-up pitch of the foot at (T,) steps since its touch-down, in stance and swing [rad]."""
    stance = 2 * style.duty
    flat_from, flat_to = 0.17 * stance, 0.55 * stance
    steepest = stance + 0.16 * (2 - stance)
    highest = 2 - 0.12 * (2 - stance)
    strike, toe_off = style.strike_rad, style.toe_off_rad
    landing = strike * (1 - ease((since + 2 - highest) / (flat_from + 2 - highest)))
    rolling = -toe_off * ease((since - flat_to) / (steepest - flat_to))
    recovering = (toe_off + strike) * ease((since - steepest) / (highest - steepest))
    settling = -strike * ease((since - highest) / (flat_from + 2 - highest))
    return landing + rolling + recovering + settling
