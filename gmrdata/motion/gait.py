"""Embedded motions: a person who walks, runs, turns, side-steps or steps up, made from footsteps.

This is not motion capture.  It gives a fresh machine input to try everything on: feet are planted
exactly, the pelvis rides on two-bone legs, and the arms swing against them, with seeded variety.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, minimum_filter1d

from gmrdata.motion import gait_steps
from gmrdata.motion.gait_steps import (
    FIRST_STEP,
    SIDES,
    FootPoses,
    GroundPath,
    Leg,
    Walk,
    plan_footsteps,
    sample_path,
    turn,
    upright,
)
from gmrdata.motion.gait_style import GAIT_KINDS as GAIT_KINDS
from gmrdata.motion.gait_style import GRAVITY_M_S2, GaitStyle, sample_style
from gmrdata.motion.ground import motion_of
from gmrdata.values.body import JOINT, N_LOCAL, BodyModel
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rotmats_from_rotvecs, rotvecs_from_rotmats

N_DRAWN = 10
"""Shape coefficients that vary, as many as SMPL's; further ones of a body stay at the mean."""


def embedded_motions(
    body: BodyModel,
    rng: np.random.Generator,
    *,
    count: int,
    fps_hz: float = 30.0,
    duration_s: float = 12.0,
) -> list[Motion]:
    """A set of motions that goes round all kinds, each of its own build, style and path."""
    if count < 1:
        raise BadRecipe(f"embedded motions: count is {count}; ask for at least 1")
    kinds = [GAIT_KINDS[number % len(GAIT_KINDS)] for number in range(count)]
    return [make_gait(kind, duration_s, fps_hz, body, rng) for kind in kinds]


def make_gait(
    kind: str,
    duration_s: float,
    fps_hz: float,
    body: BodyModel,
    rng: np.random.Generator,
    *,
    shape: np.ndarray | None = None,
) -> Motion:
    """One embedded motion of `GAIT_KINDS` in the world frame, z-up, feet on z = 0.

    The same state of `rng` gives the same bytes; with None for the build `shape` (S,) it draws one.
    """
    return gait_with_contacts(kind, duration_s, fps_hz, body, rng, shape=shape)[0]


def gait_with_contacts(
    kind: str,
    duration_s: float,
    fps_hz: float,
    body: BodyModel,
    rng: np.random.Generator,
    *,
    shape: np.ndarray | None = None,
) -> tuple[Motion, np.ndarray]:
    """Like `make_gait`, and (T, 2) bool: the left and the right foot stand, touch-down to toe-off.
    From a sixth of its stance on a foot's ball does not move, to the digit."""
    _check(kind, duration_s, fps_hz)
    shape = sample_shape(body, rng) if shape is None else np.asarray(shape, dtype=np.float64)
    if shape.shape != (body.n_shape,) or not np.isfinite(shape).all():
        what = f"body {body.name} takes a shape of {body.n_shape} finite numbers, not {shape}"
        raise BadRecipe(f"gait {kind}: {what}; leave it out to draw one")
    heights_m = body.rest_joints_m(shape)[:, 1]
    leg_m = float(heights_m[JOINT["left_hip"]] - heights_m[JOINT["left_ankle"]])
    style = sample_style(kind, leg_m, rng)
    # The pelvis' height looks ahead and back over half a step: make some frames on either side.
    half_window = int(np.ceil(0.55 / style.cadence_hz * fps_hz))
    pad, pad_s = 2 * half_window, 1.1 / style.cadence_hz
    n_frames = round(duration_s * fps_hz)
    time_s = np.arange(-pad, n_frames + pad) / fps_hz
    time_s = np.clip(time_s, -pad_s, duration_s + pad_s)
    first_step = rng.uniform(0, 2)
    steps = first_step + _steps(time_s, style)
    n_steps = first_step + float(_steps(np.array(duration_s + pad_s), style))
    path = sample_path(kind, n_steps, style, rng)
    plan = plan_footsteps(path, style, _ground(kind, n_steps, rng), rng)
    arrays = pose_body(body, shape, Walk(path, plan, style, time_s, steps), half_window)
    rotmats, pelvis_m, planted = (array[pad : pad + n_frames] for array in arrays)
    source = f"gmrdata gait {kind}, {style.speed_m_s:.2f} m/s, generated, not motion capture"
    return motion_of(body, shape, rotmats, pelvis_m, float(fps_hz), source), planted


def sample_shape(body: BodyModel, rng: np.random.Generator) -> np.ndarray:
    """Draw a build: (S,) normal coefficients, kept within two deviations, the first ten of them."""
    shape = np.zeros(body.n_shape)
    drawn = min(body.n_shape, N_DRAWN)
    shape[:drawn] = np.clip(rng.normal(0.0, 1.0, drawn), -2.0, 2.0)
    return shape


def _check(kind: str, duration_s: float, fps_hz: float) -> None:
    if kind not in GAIT_KINDS:
        raise BadRecipe(f"gait {kind!r}: no such kind; choose one of {', '.join(GAIT_KINDS)}")
    asked = f"gait {kind}: {duration_s} s at {fps_hz} frames a second"
    if not (0 < duration_s < np.inf and 0 < fps_hz < np.inf):
        raise BadRecipe(f"{asked}; both must be positive")
    if round(duration_s * fps_hz) < 1:
        raise BadRecipe(f"{asked} is less than a frame; ask for a longer duration")


def _ground(kind: str, n_steps: float, rng: np.random.Generator) -> np.ndarray:
    """Height of the ground for each footfall from FIRST_STEP on [m]."""
    ground_m = np.zeros(int(np.ceil(n_steps)) + 4 - FIRST_STEP)
    if kind == "step_up":
        onto = rng.integers(2, max(3, int(n_steps) - 3))
        ground_m[onto - FIRST_STEP :] = rng.uniform(0.15, 0.20)
    return ground_m


def _steps(time_s: np.ndarray, style: GaitStyle) -> np.ndarray:
    """Steps taken by (T,) times; cadence changes slowly by 5 %."""
    slow = 0.08 * (np.sin(0.6 * time_s + style.wander[1]) - np.sin(style.wander[1]))
    return style.cadence_hz * (time_s + slow)


def pose_body(
    body: BodyModel, shape: np.ndarray, walk: Walk, half_window: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Someone who makes planned steps, at the T times of the walk.

    Gives rotations (T, 24, 3, 3), the root's first, pelvis (T, 3) [m], and (T, 2) bool whether the
    left and the right foot stand.  The pelvis' height is smoothed over a window of frames.
    """
    path, time_s, steps, style = walk.path, walk.time_s, walk.steps, walk.style
    joints_m = body.rest_joints_m(shape)

    def bone(parent: str, child: str) -> np.ndarray:
        return joints_m[JOINT[child]] - joints_m[JOINT[parent]]

    legs = [
        Leg(bone(f"{side}_hip", f"{side}_knee"), bone(f"{side}_knee", f"{side}_ankle"))
        for side in SIDES
    ]
    hips_m = np.stack([bone("pelvis", f"{side}_hip") for side in SIDES])
    feet = [gait_steps.foot_poses(body, shape, side, walk) for side in SIDES]
    reach_m = min(leg.reach_m(style.soft_knee_rad) for leg in legs)
    trunk = _pose_trunk(path, time_s, steps, style)
    ground_m = gait_steps.ground_under_pelvis(steps, walk.plan)
    pelvis_m = _place_pelvis(path, steps, ground_m, trunk, style, reach_m)
    pelvis_m += _lift_m(pelvis_m, trunk.pelvis, hips_m, feet, reach_m, half_window)
    local = _local_rotations(trunk, legs, hips_m, pelvis_m, feet)
    _swing_arms(local, joints_m, time_s, steps, style)
    rotmats = np.concatenate([trunk.pelvis[:, None], local], axis=1)
    return rotmats, pelvis_m, np.stack([foot.planted for foot in feet], axis=-1)


@dataclass(frozen=True, eq=False)
class _Trunk:
    """Orientations (T, 3, 3) over T frames, world_from_joint relative to the T-pose."""

    facing_rad: np.ndarray  # (T,) direction of travel that the person faces [rad]
    pelvis: np.ndarray
    chest: np.ndarray  # of spine3
    head: np.ndarray
    lean_in_rad: np.ndarray  # (T,) lean to the left, into a left bend [rad]


def _pose_trunk(
    path: GroundPath, time_s: np.ndarray, steps: np.ndarray, style: GaitStyle
) -> _Trunk:
    """Orient pelvis, chest and head at (T,) times and step counts (even: left touch-down)."""
    s_m = path.s_at(steps)
    facing = path.facing_rad(s_m)
    stride = np.pi * steps
    speed_m_s = style.speed_m_s / (1 + gait_steps.BEND * path.curvature_rad_m(s_m) ** 2)
    lean_in = 0.6 * np.arctan(speed_m_s**2 * path.curvature_rad_m(s_m) / GRAVITY_M_S2)
    level = upright(facing)
    # Left hip leads at a left touch-down; turning left takes it back, hence the sign.
    yaw, list_ = -style.pelvis_yaw_rad * np.cos(stride), np.sin(stride + 0.15)
    tilt = style.pelvis_tilt_rad + np.radians(1.2) * np.cos(2 * stride + 0.6)
    pelvis_roll = style.pelvis_list_rad * list_ - 0.5 * lean_in
    pelvis = level @ turn("y", yaw) @ turn("z", pelvis_roll) @ turn("x", tilt)
    slow = np.sin(0.45 * time_s + style.wander[3])
    lean = style.lean_rad + np.radians(1.0) * np.cos(2 * stride + 1.0) + np.radians(1.0) * slow
    chest_roll = -0.35 * style.pelvis_list_rad * list_ - lean_in
    chest_yaw = style.chest_yaw_rad * np.cos(np.pi * (steps + 0.5 - style.duty))
    chest = level @ turn("y", chest_yaw) @ turn("z", chest_roll) @ turn("x", lean)
    ahead_m = 0.35 * style.speed_m_s
    glance = path.facing_rad(s_m + ahead_m) - facing
    glance = glance + np.radians(5.0) * np.sin(0.6 * time_s + style.wander[2])
    nod = np.radians(3.0) + 0.2 * lean + np.radians(2.0) * slow
    head = level @ turn("y", glance) @ turn("z", -0.5 * lean_in) @ turn("x", nod)
    return _Trunk(facing, pelvis, chest, head, lean_in)


def _place_pelvis(
    path: GroundPath,
    steps: np.ndarray,
    ground_m: np.ndarray,
    trunk: _Trunk,
    style: GaitStyle,
    hip_height_m: float,
) -> np.ndarray:
    """Pelvis at the height of its bob and the ground (T,), not lifted yet: (T, 3) world [m]."""
    pelvis = np.zeros((len(steps), 3))
    pelvis[:, :2] = path.position_m(path.s_at(steps))
    side = style.sway_m * np.cos(np.pi * (steps - style.duty))
    side = side + 0.6 * hip_height_m * np.tan(trunk.lean_in_rad)
    # Slowest over the standing leg, where a walker is highest.
    front = -0.012 * style.step_m * np.sin(2 * np.pi * (steps - style.duty))
    level = upright(trunk.facing_rad)
    pelvis += side[:, None] * level[:, :, 0] + front[:, None] * level[:, :, 2]
    pelvis[:, 2] = ground_m + style.bob_m * np.cos(2 * np.pi * (steps - style.duty))
    return pelvis


def _lift_m(
    pelvis_m: np.ndarray,
    pelvis_rotmats: np.ndarray,
    hips_m: np.ndarray,
    feet: list[FootPoses],
    reach_m: float,
    half_window: int,
) -> np.ndarray:
    """By how much the pelvis can rise while both legs reach their ankles: (T, 3) world [m].

    The greatest height that a frame admits changes abruptly.  A weighted mean over a window, of its
    minimum over a window of the same width, is smooth and nowhere above it.
    """
    most_m = np.full(len(pelvis_m), np.inf)
    for hip_m, foot in zip(hips_m, feet, strict=True):
        hip = pelvis_m + pelvis_rotmats @ hip_m
        across = np.linalg.norm((foot.ankle_m - hip)[:, :2], axis=-1)
        height = np.sqrt(np.maximum(reach_m**2 - across**2, 0.0))
        most_m = np.minimum(most_m, foot.ankle_m[:, 2] + height - hip[:, 2])
    lowest = minimum_filter1d(most_m, 2 * half_window + 1, mode="nearest")
    weights = np.hanning(2 * half_window + 3)[1:-1]
    lift = convolve1d(lowest, weights / weights.sum(), mode="nearest")
    return lift[:, None] * np.array([0.0, 0.0, 1.0])


def _local_rotations(
    trunk: _Trunk, legs: list[Leg], hips_m: np.ndarray, pelvis_m: np.ndarray, feet: list[FootPoses]
) -> np.ndarray:
    """Local rotations of spine, neck, head and legs: (T, 23, 3, 3); the arms stay in the T-pose."""
    local = np.broadcast_to(np.eye(3), (len(pelvis_m), N_LOCAL, 3, 3)).copy()
    spine = _share(np.swapaxes(trunk.pelvis, -1, -2) @ trunk.chest, 3)
    for name in ("spine1", "spine2", "spine3"):
        local[:, JOINT[name] - 1] = spine
    neck = _share(np.swapaxes(trunk.chest, -1, -2) @ trunk.head, 2)
    local[:, JOINT["neck"] - 1] = local[:, JOINT["head"] - 1] = neck
    for side, leg, hip_m, foot in zip(SIDES, legs, hips_m, feet, strict=True):
        reach = foot.ankle_m - (pelvis_m + trunk.pelvis @ hip_m)
        knee_axis = trunk.pelvis[:, :, 0] + upright(foot.yaw_rad)[:, :, 0]
        thigh, knee = leg.solve(reach, knee_axis)
        local[:, JOINT[f"{side}_hip"] - 1] = np.swapaxes(trunk.pelvis, -1, -2) @ thigh
        local[:, JOINT[f"{side}_knee"] - 1] = knee
        local[:, JOINT[f"{side}_ankle"] - 1] = np.swapaxes(thigh @ knee, -1, -2) @ foot.rotmats
        local[:, JOINT[f"{side}_foot"] - 1] = turn("x", -foot.toes_rad)
    return local


def _swing_arms(
    local: np.ndarray, joints_m: np.ndarray, time_s: np.ndarray, steps: np.ndarray, style: GaitStyle
) -> None:
    """Let the arms hang and swing against the legs: writes into `local` (T, 23, 3, 3)."""
    for side, out in zip(SIDES, (1.0, -1.0), strict=True):
        upper = joints_m[JOINT[f"{side}_elbow"]] - joints_m[JOINT[f"{side}_shoulder"]]
        droop_rad = np.arctan2(-upper[1], abs(upper[0]))
        # The left arm is at the back as the left leg leads most: between toe-off and touch-down.
        swing = -out * np.cos(np.pi * (steps + 0.5 - style.duty))
        flexion = style.arm_mean_rad + style.arm_swing_rad * swing
        slow = np.sin(0.5 * time_s + style.wander[1] + out)
        down = np.pi / 2 - style.arm_out_rad - droop_rad + np.radians(1.5) * slow
        # A bent forearm points past the hip while the arm is at the back, inwards in front.
        inwards = style.arm_in_rad * (0.5 + 0.5 * swing)
        shoulder = turn("x", -flexion) @ turn("z", -out * down) @ turn("x", inwards)
        elbow = style.elbow_rad + style.elbow_swing_rad * (swing + 0.2 * slow)
        local[:, JOINT[f"{side}_shoulder"] - 1] = shoulder
        local[:, JOINT[f"{side}_elbow"] - 1] = turn("y", -out * elbow)


def _share(rotmats: np.ndarray, joints: int) -> np.ndarray:
    """The rotation that gives `rotmats` (T, 3, 3) when it is applied `joints` times over."""
    return rotmats_from_rotvecs(rotvecs_from_rotmats(rotmats) / joints)
