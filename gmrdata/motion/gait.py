"""Embedded motions: a person who walks, runs, turns, side-steps or steps up, made from footsteps.

This is not motion capture.  It gives a fresh machine input to try everything on: feet are planted
exactly, the pelvis rides on two-bone legs, and the arms swing against them, with seeded variety.
"""

from dataclasses import replace

import numpy as np

from gmrdata.motion.gait_body import pose_body
from gmrdata.motion.gait_steps import FIRST_STEP, Walk, plan_footsteps, sample_path
from gmrdata.motion.gait_style import GAIT_KINDS as GAIT_KINDS
from gmrdata.motion.gait_style import GaitStyle, sample_style
from gmrdata.motion.ground import motion_of
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion

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
    motion = motion_of(body, shape, rotmats, pelvis_m, float(fps_hz), source)
    return replace(motion, gender="neutral"), planted


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
