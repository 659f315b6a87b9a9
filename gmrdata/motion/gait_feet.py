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

MORE_TOES = 1.25
"""Toes bend up by so much of the foot's pitch over the ball.  1 would keep them level, but skin between
ball and toes follows both by half, and would sink into the ground."""

SOFT_TOES_RAD = np.radians(20.0)
"""In swing, toes of a foot that is pitched by less than this straighten out smoothly [rad]."""


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot at rest, relative to the point on the ground straight below its ankle; rest axes [m]."""

    ankle_m: np.ndarray
    """(3,) the ankle joint: (0, height, 0)."""
    ball_m: np.ndarray
    """(3,) the foot joint at the ball, about which the foot rolls at push-off."""
    heel_m: np.ndarray
    """(3,) rear end of the sole, about which the foot turns after touch-down."""


@dataclass(frozen=True, eq=False)
class Footsteps:
    """Where each footfall of a clip is; even steps are the left foot's, odd ones the right's."""

    first: int
    """Number of the first footfall; rows count on from it."""
    position_m: np.ndarray
    """(N, 3) point on the ground below the planted ankle, world [m]."""
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
    """world_from_rest of someone upright who faces (T,) directions: columns left, up, front (T, 3, 3)."""
    cos, sin, zero = np.cos(facing_rad), np.sin(facing_rad), np.zeros_like(facing_rad)
    left = np.stack([-sin, cos, zero], axis=-1)
    up = np.stack([zero, zero, zero + 1], axis=-1)
    front = np.stack([cos, sin, zero], axis=-1)
    return np.stack([left, up, front], axis=-1)


def rest_foot(body: BodyModel, shape: np.ndarray, side: str) -> Foot:
    """Measure a foot of the body's T-pose: its joints, and its sole from the vertices that follow them."""
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
    """Put each foot down where the pelvis will be in the middle of its stance, on its side of the path.

    Args:
        path: Where the person goes.
        style: Step spacing and the like.
        ground_m: (N,) height of the ground for each footfall from number -4 [m].
        rng: People don't step exactly evenly: draws a centimetre here and there.
    """
    number = np.arange(-4, -4 + len(ground_m))
    s_m = path.s_at(number + style.duty)
    side = np.where(number % 2 == 0, 1.0, -1.0)
    facing = path.facing_rad(s_m)
    frames = upright(facing)
    across_m = side * style.spacing_m / 2 + rng.normal(0, 0.006, len(number))
    along_m = style.ahead_m + rng.normal(0, 0.008, len(number))
    position = np.zeros((len(number), 3))
    position[:, :2] = path.position_m(s_m)
    position += across_m[:, None] * frames[:, :, 0] + along_m[:, None] * frames[:, :, 2]
    position[:, 2] = ground_m
    yaw = facing + -side * style.toe_out_rad + rng.normal(0, np.radians(1.0), len(number))
    return Footsteps(-4, position, yaw)


def ground_under_pelvis(steps: np.ndarray, plan: Footsteps) -> np.ndarray:
    """Height by which the pelvis has followed the ground at (T,) step counts [m].

    It rises in the step that begins as a foot touches down on other ground.
    """
    number = plan.first + 1 + np.flatnonzero(np.diff(plan.position_m[:, 2]))
    rise_m = np.diff(plan.position_m[:, 2])[number - plan.first - 1]
    return plan.position_m[0, 2] + ease(steps[:, None] - number + 0.1) @ rise_m


def foot_poses(
    foot: Foot, parity: int, steps: np.ndarray, plan: Footsteps, style: GaitStyle
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
    here, there = number - plan.first, number - plan.first + 2
    pitch = _pitch_rad(since, style)
    pivot = np.where((since < stance / 2)[:, None], foot.heel_m, foot.ball_m)
    pivot = np.where(
        (swing > 0)[:, None],
        foot.ball_m + ease((swing - 0.35) / 0.65)[:, None] * (foot.heel_m - foot.ball_m),
        pivot,
    )
    start, stop = plan.position_m[here], plan.position_m[there]
    position = start + _swing_share(swing, style)[:, None] * (stop - start)
    position[:, 2] = start[:, 2] + _swing_height(swing, stop[:, 2] - start[:, 2], style)
    yaw = plan.yaw_rad[here] + ease(swing) * (plan.yaw_rad[there] - plan.yaw_rad[here])
    level, tilted = upright(yaw), turn("x", -pitch)
    ankle = pivot + np.einsum("tij,tj->ti", tilted, foot.ankle_m - pivot)
    toes = MORE_TOES * np.maximum(-pitch, 0.0)
    toes *= np.where(swing > 0, ease(toes / SOFT_TOES_RAD), 1.0)
    return FootPoses(
        ankle_m=position + np.einsum("tij,tj->ti", level, ankle),
        rotmats=level @ tilted,
        toes_rad=toes,
        yaw_rad=yaw,
        planted=since < stance,
    )


def _pitch_rad(since: np.ndarray, style: GaitStyle) -> np.ndarray:
    """Toes-up pitch of the foot at (T,) steps since its touch-down, through flat stance and swing [rad]."""
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
    """Share of the way to the next footfall: at rest at both ends, fastest a little after half time.

    A foot that came to rest sooner would be too far ahead of the hip for the leg to reach.
    """
    return betainc(2.2 + style.late, 2.2, swing)


def _swing_height(swing: np.ndarray, rise_m: np.ndarray, style: GaitStyle) -> np.ndarray:
    """Height of the foot in swing over its last footfall [m]."""
    arc = 16 * swing**2 * (1 - swing) ** 2
    early = np.where(rise_m > 0, swing / 0.7, (swing - 0.3) / 0.7)
    return rise_m * ease(early) + (style.clearance_m + 0.25 * np.abs(rise_m)) * arc
