"""What each moment of standing shows of up, so that a world that slowly turns over is turned back.

A network's roll and pitch drift.  Who stands has the mass over the feet, on average over a step or
two, and a foot at rest is flat, nearly always.  Neither tells anything of somebody who lies, falls
or stands on the hands.
"""

from typing import NamedTuple

import numpy as np

from gmrdata.motion.ground import PLANTED_M_PER_S, SHORTEST_STAND_S, SIDES
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.motion_metrics import speeds_m_per_s
from gmrdata.values.skinning import posed_joints_m
from gmrdata.world.level import BALANCE_SIGMA_RAD, balance

_UP_IN_REST = np.eye(3)[1]
SHORTEST_UP = 0.5  # feet that point everywhere have a median near zero, which is no direction
FOOT_SIGMA_RAD = np.deg2rad(6.0)  # of one standing foot's direction from up, along each axis
LEANS_S = 1.0  # moments that are nearer lean alike
MOST_RAD = np.deg2rad(45.0)  # from up: what is further off shows something else


class ShownTilts(NamedTuple):
    """What standing shows of the tilt of a world whose z axis is about up."""

    tilts: np.ndarray  # (T, 2) how much the ground rises along x and y, beyond its mean
    precision: np.ndarray  # (T,) of that [1/rad2]; 0 where nothing shows it


def shown_tilts(body: BodyModel, motion: Motion) -> ShownTilts:
    """Of each frame, by the mass over the feet and by feet at rest; as if each was on its own."""
    above_m, carried = balance(body, motion)
    feet_up, still = standing_feet_up(body, motion)
    directions = np.concatenate([above_m[:, None], feet_up], axis=1)
    lengths = np.linalg.norm(directions, axis=-1)
    near = directions[..., 2] > np.cos(MOST_RAD) * lengths
    weights = np.where(near, np.column_stack([carried, still]), 0.0)
    rises = np.where(near[..., None], -directions[..., :2], 0.0)
    rises /= np.where(near, directions[..., 2], 1.0)[..., None]
    off_rad2 = weights[:, 0] @ (rises[:, 0] ** 2).mean(axis=1) / max(1e-9, weights[:, 0].sum())
    variances = np.array([max(off_rad2, BALANCE_SIGMA_RAD**2), *2 * [FOOT_SIGMA_RAD**2]])
    precisions = weights / variances / (LEANS_S * motion.fps_hz)
    precision = precisions.sum(axis=1)
    tilts = np.einsum("tc,tck->tk", precisions, rises) / np.maximum(precision, 1e-12)[:, None]
    mean = precision @ tilts / max(1e-12, precision.sum())
    return ShownTilts(tilts - mean, precision)


def standing_feet_up(body: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Where the upper sides of both feet point (T, 2, 3), and which feet stand still (T, 2)."""
    joints_m, world_from_joint = posed_joints_m(
        body.rest_joints_m(motion.shape), motion.rotmats, motion.pelvis_m
    )
    ankles, toes = ([JOINT[f"{side}_{part}"] for side in SIDES] for part in ("ankle", "foot"))
    speeds = speeds_m_per_s(joints_m[:, ankles + toes], motion.fps_hz)
    still = np.all((speeds < PLANTED_M_PER_S).reshape(-1, 2, len(SIDES)), axis=1)
    return world_from_joint[:, ankles] @ _UP_IN_REST, still


def up_of_standing_feet(motion: Motion, body: BodyModel) -> np.ndarray | None:
    """The direction (3,) that standing feet show as up, or None where none stands for 0.1 s."""
    ups, still = standing_feet_up(body, motion)
    standing = ups[still]
    if len(standing) < max(1.0, SHORTEST_STAND_S * motion.fps_hz):
        return None
    up = _geometric_median(standing)
    length = np.linalg.norm(up)
    return np.asarray(up / length) if length > SHORTEST_UP else None


def _geometric_median(points: np.ndarray) -> np.ndarray:
    """The point (3,) with the least sum of distances to points (N, 3)."""
    middle = points.mean(axis=0)
    for _ in range(50):
        weights = 1.0 / np.maximum(np.linalg.norm(points - middle, axis=1), 1e-3)
        middle = weights @ points / weights.sum()
    return np.asarray(middle)
