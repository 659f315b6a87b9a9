"""Footsteps and the pose of the feet: exactly planted in stance, a smooth arc in swing."""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT
from gmrdata.motion.gait_path import GroundPath, ease
from gmrdata.motion.gait_style import GaitStyle
from gmrdata.motion.leg_ik import turn

SIDES = ("left", "right")

FIRST_STEP = -4
"""Number of a clip's first footfall; step 0 is the first touch-down of the left foot."""

CIRCUMDUCTION_M = 0.02
"""A swinging foot swerves outwards by this much, past the standing one [m]."""

SOFT_TOES_RAD = np.radians(20.0)
"""In swing, toes of a foot that is pitched by less than this straighten out smoothly [rad]."""


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot at rest, relative to the point on the ground below its ankle; rest axes [m]."""

    ankle_m: np.ndarray
    """(3,) the ankle joint: (0, height, 0)."""
    ball_m: np.ndarray
    """(3,) the foot joint at the ball, about which the foot rolls at push-off."""
    heel_m: np.ndarray
    """(3,) rear end of the sole, about which the foot turns after touch-down."""


@dataclass(frozen=True, eq=False)
class Footsteps:
    """The footfalls of a clip, from FIRST_STEP on; even ones are the left foot's."""

    s_m: np.ndarray
    """(N,) place along the path [m]."""
    across_m: np.ndarray
    """(N,) place of the ankle to the left of the path, as the person faces [m]."""
    ahead_m: np.ndarray
    """(N,) place of the ankle to the front [m]."""
    ground_m: np.ndarray
    """(N,) height of the ground [m]."""
    yaw_rad: np.ndarray
    """(N,) direction of the foot, from world x towards world y [rad]."""


@dataclass(frozen=True, eq=False)
class FootPoses:
    """One foot over T frames, world."""

    ankle_m: np.ndarray
    """(T, 3) ankle joint [m]."""
    rotmats: np.ndarray
    """(T, 3, 3) world_from_foot, relative to the T-pose."""
    toes_rad: np.ndarray
    """(T,) toes bent up against the foot [rad]."""
    yaw_rad: np.ndarray
    """(T,) direction of the foot [rad]."""
    planted: np.ndarray
    """(T,) bool, from touch-down to toe-off."""


def upright(facing_rad: np.ndarray) -> np.ndarray:
    """world_from_rest (T, 3, 3) of someone upright who faces (T,): columns left, up, front."""
    cos, sin, zero = np.cos(facing_rad), np.sin(facing_rad), np.zeros_like(facing_rad)
    left = np.stack([-sin, cos, zero], axis=-1)
    up = np.stack([zero, zero, zero + 1], axis=-1)
    front = np.stack([cos, sin, zero], axis=-1)
    return np.stack([left, up, front], axis=-1)


def rest_foot(body: BodyModel, shape: np.ndarray, side: str) -> Foot:
    """Measure a foot of the T-pose: its joints, and its sole from the vertices that follow them."""
    joints_m = body.rest_joints_m(shape)
    ankle, ball = joints_m[JOINT[f"{side}_ankle"]], joints_m[JOINT[f"{side}_foot"]]
    follows = body.skin_weights[:, [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]].sum(axis=1)
    mine = np.flatnonzero(follows > 0.5)
    vertices_m = body.template_m[mine] + body.shape_dirs_m[mine] @ shape
    ground_m = vertices_m[:, 1].min()
    sole = vertices_m[vertices_m[:, 1] < ground_m + 0.01]
    below = np.array([ankle[0], ground_m, ankle[2]])
    heel = np.array([ankle[0], ground_m, min(sole[:, 2].min(), ankle[2])])
    return Foot(ankle - below, ball - below, heel - below)


def plan_footsteps(
    path: GroundPath,
    style: GaitStyle,
    ground_m: np.ndarray,
    rng: np.random.Generator,
) -> Footsteps:
    """Put each foot down where the pelvis passes in its stance, on its side of the path.

    Args:
        path: Where the person goes.
        style: Step spacing and the like.
        ground_m: (N,) height of the ground for each footfall from FIRST_STEP on [m].
        rng: People don't step exactly evenly: draws a centimetre here and there.
    """
    number = np.arange(len(ground_m)) + FIRST_STEP
    side = np.where(number % 2 == 0, 1.0, -1.0)
    s_m = path.s_at(number + style.duty - style.lag_steps)
    # A foot already points to where the body will be heading over it.
    facing = path.facing_rad(path.s_at(number + style.duty))
    uneven = rng.normal(size=(3, len(number)))
    return Footsteps(
        s_m=s_m,
        across_m=side * style.spacing_m / 2 + 0.006 * uneven[0],
        ahead_m=0.008 * uneven[1],
        ground_m=ground_m,
        yaw_rad=facing - side * style.toe_out_rad + np.radians(1.0) * uneven[2],
    )


def ground_under_pelvis(steps: np.ndarray, plan: Footsteps) -> np.ndarray:
    """Height by which the pelvis has followed the ground at (T,) step counts [m].

    It rises in the step that begins as a foot touches down on other ground.
    """
    row = np.flatnonzero(np.diff(plan.ground_m))
    number = row + 1 + FIRST_STEP
    return plan.ground_m[0] + ease(steps[:, None] - number + 0.1) @ np.diff(plan.ground_m)[row]


def foot_poses(
    foot: Foot,
    parity: int,
    steps: np.ndarray,
    path: GroundPath,
    plan: Footsteps,
    style: GaitStyle,
) -> FootPoses:
    """Pose one foot at (T,) step counts; parity 0 is the left foot, 1 the right.

    The foot is a flat sole at a footfall, or on its way between two, that is pitched about a pivot:
    the heel after touch-down, the ball before toe-off, and in the air a point that moves from the
    ball to the heel.
    """
    number = 2 * np.floor((steps - parity) / 2).astype(int) + parity
    since = steps - number
    stance = style.stance_steps
    swing = np.clip((since - stance) / (2 - stance), 0.0, 1.0)
    pitch = _pitch_rad(since, style)
    to_heel = np.where(since < stance / 2, 1.0, ease((swing - 0.35) / 0.65))
    pivot = foot.ball_m + to_heel[:, None] * (foot.heel_m - foot.ball_m)
    row = number - FIRST_STEP
    yaw = plan.yaw_rad[row] + ease(swing) * (plan.yaw_rad[row + 2] - plan.yaw_rad[row])
    level, tilted = upright(yaw), turn("x", -pitch)
    ankle = pivot + np.einsum("tij,tj->ti", tilted, foot.ankle_m - pivot)
    # Toes stay level while the foot rolls over the ball.
    toes = np.maximum(-pitch, 0.0)
    toes *= np.where(swing > 0, ease(toes / SOFT_TOES_RAD), 1.0)
    ground = _below_ankle(row, swing, path, plan, style)
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

    It follows the path's bends, as a straight line would lead the outer foot through the inner leg.
    """
    share = _swing_share(swing, style)
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
    stance = style.stance_steps
    flat_from, flat_to = 0.17 * stance, 0.55 * stance
    steepest = stance + 0.16 * (2 - stance)
    highest = 2 - 0.12 * (2 - stance)
    strike, toe_off = style.strike_rad, style.toe_off_rad
    landing = strike * (1 - ease((since + 2 - highest) / (flat_from + 2 - highest)))
    rolling = -toe_off * ease((since - flat_to) / (steepest - flat_to))
    recovering = (toe_off + strike) * ease((since - steepest) / (highest - steepest))
    settling = -strike * ease((since - highest) / (flat_from + 2 - highest))
    return landing + rolling + recovering + settling


def _swing_share(swing: np.ndarray, style: GaitStyle) -> np.ndarray:
    """Share of the way to the next footfall: at rest at both ends, fastest after half time.

    A foot that came to rest sooner would be too far ahead of the hip for the leg to reach.
    """
    return betainc(2.2 + style.late, 2.2, swing)
