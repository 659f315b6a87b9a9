"""Putting a motion's soles on the floor z = 0.

Some recordings stand on a floor that their world's axes do not lie in: CMU's subjects 02 and 08,
for one, rise by up to 7 cm on a walk of 3 m.  Where the standing feet show a plane that is tilted
by at most 2.5 degrees, the whole motion is turned so that it is level; stairs, ramps and props are
left alone.
"""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT, PARENTS
from gmrdata.motion.feet import PLANTED_M_PER_S
from gmrdata.motion.rest_pose import minimal_rotation
from gmrdata.motion.skeleton import global_rotmats, joint_positions_m

FOOT_JOINTS = tuple(
    JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")
)
SOLE_STRIPS = 4
"""Strips from back to front in which the lowest vertices of a foot part are looked for."""
LEVEL_M = 0.015
"""Standing soles are on a level if they are this near to it."""
FLOOR_SHARE = 0.25
"""A level is a floor if this share of the standing soles is on it."""
DEEPEST_DIP_M = 0.15
"""A foot on tiptoe whose toes don't bend dips through the floor by no more than that."""
LOW_PERCENTILE = 10.0
"""On stairs, ramps and props, the floor is that percentile of the height of standing soles: low,
but not the lowest, which is where a foot dips through."""
SHORTEST_SPREAD_M = 0.4
"""A tilt is looked for along directions in which the standing feet spread by this (1 sigma)."""
LARGEST_TILT_DEG = 2.5
LARGEST_RESIDUAL_M = 0.025
"""Standing feet are on one plane if 80 % of them are nearer to it than this."""


def put_on_floor(
    body: BodyModel, shape: np.ndarray, rotmats: np.ndarray, pelvis_m: np.ndarray, fps_hz: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Level the floor that a motion shows and move it to z = 0.

    Args:
        body: The body.
        shape: (S,) its shape.
        rotmats: (T, 24, 3, 3) local rotations, the root's (in a z-up world) first.
        pelvis_m: (T, 3) pelvis path in the same world [m].
        fps_hz: Frame rate [Hz].

    Returns:
        Root rotations (T, 3, 3), pelvis path (T, 3) [m], and the tilt that was taken away [deg].
    """
    soles_m = sole_points_m(body, shape, rotmats, pelvis_m)
    standing_m = _standing_points_m(soles_m, fps_hz)
    level_from_world = _level_rotation(standing_m)
    heights_m = (standing_m @ level_from_world.T)[:, 2]
    if not len(heights_m):
        heights_m = soles_m[:, :, 2].min(axis=1)
    pelvis_m = pelvis_m @ level_from_world.T
    pelvis_m[:, 2] -= floor_height_m(heights_m)
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(level_from_world[2, 2], -1.0, 1.0))))
    return level_from_world @ rotmats[:, 0], pelvis_m, tilt_deg


def floor_height_m(heights_m: np.ndarray) -> float:
    """The lowest level on which soles stand often: the median of those that are on it [m].

    A tenth of them may well be below: some recordings have tiptoes that dip through, or begin with
    toes that point down.  More of them, or further below, stand on a floor of their own.

    Args:
        heights_m: (N,) heights of standing soles, N >= 1 [m].
    """
    heights_m = np.sort(heights_m)
    low_m = float(np.percentile(heights_m, LOW_PERCENTILE))
    edges = [np.searchsorted(heights_m, heights_m + off_m) for off_m in (-LEVEL_M, LEVEL_M)]
    on_level = edges[1] - edges[0]
    often = np.flatnonzero(on_level >= FLOOR_SHARE * len(heights_m))
    if not len(often):
        return low_m
    # The first of them lies on the level's lower edge, so the fullest one is looked for above it.
    near = heights_m <= heights_m[often[0]] + 2 * LEVEL_M
    fullest_m = heights_m[int(np.where(near, on_level, 0).argmax())]
    if low_m < fullest_m - DEEPEST_DIP_M:
        return low_m
    return float(np.median(heights_m[np.abs(heights_m - fullest_m) <= LEVEL_M]))


def sole_points_m(
    body: BodyModel, shape: np.ndarray, rotmats: np.ndarray, pelvis_m: np.ndarray
) -> np.ndarray:
    """Some points of the soles over time, (T, P, 3) [m].

    They follow the ankle and toe joints rigidly; skin hardly bends there.
    """
    rest_joints_m = body.rest_joints_m(shape)
    steps_m = np.zeros((len(PARENTS), 3))
    steps_m[1:] = rest_joints_m[1:] - rest_joints_m[list(PARENTS[1:])]
    frame_from_joint = global_rotmats(PARENTS, rotmats)
    joints_m = joint_positions_m(PARENTS, frame_from_joint, steps_m) + pelvis_m[:, None]
    return np.concatenate(
        [
            joints_m[:, None, joint]
            + (points - rest_joints_m[joint]) @ frame_from_joint[:, joint].swapaxes(-1, -2)
            for joint, points in _sole_vertices_m(body, shape).items()
        ],
        axis=1,
    )


def _standing_points_m(soles_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """Lowest point of the lower foot in each frame in which it stands still: (N, 3) [m]."""
    rows = np.arange(len(soles_m))
    lowest = soles_m[:, :, 2].argmin(axis=1)
    speeds = np.linalg.norm(np.gradient(soles_m, axis=0)[rows, lowest], axis=1) * fps_hz
    return np.asarray(soles_m[rows, lowest][speeds < PLANTED_M_PER_S])


def _level_rotation(points_m: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that makes the plane of standing points (N, 3) level, or identity."""
    if len(points_m) < 3:
        return np.eye(3)
    centred = points_m - np.median(points_m, axis=0)
    variances, directions = np.linalg.eigh(np.cov(centred[:, :2].T))
    wide = directions[:, variances >= SHORTEST_SPREAD_M**2]
    if not wide.shape[1]:
        return np.eye(3)
    design = np.column_stack([centred[:, :2] @ wide, np.ones(len(centred))])
    weights = np.ones(len(centred))
    for _ in range(20):  # least absolute distances, by reweighting
        root = np.sqrt(weights)
        slopes = np.linalg.lstsq(design * root[:, None], centred[:, 2] * root, rcond=None)[0]
        residuals_m = np.abs(centred[:, 2] - design @ slopes)
        weights = 1.0 / np.maximum(residuals_m, 0.005)
    normal = np.append(-wide @ slopes[:-1], 1.0)
    on_plane = np.percentile(residuals_m, 80) <= LARGEST_RESIDUAL_M
    gentle = np.hypot(normal[0], normal[1]) <= np.tan(np.deg2rad(LARGEST_TILT_DEG))
    return minimal_rotation(normal, np.array([0.0, 0.0, 1.0])) if on_plane and gentle else np.eye(3)


def _sole_vertices_m(body: BodyModel, shape: np.ndarray) -> dict[int, np.ndarray]:
    """Rest positions of the sole's lowest vertices by the joint that carries them most [m]."""
    vertices_m = body.template_m + body.shape_dirs_m @ shape
    carrier = body.skin_weights.argmax(axis=1)
    soles = {}
    for joint in FOOT_JOINTS:
        part = vertices_m[carrier == joint]
        if len(part):
            edges = np.linspace(part[:, 2].min(), part[:, 2].max(), SOLE_STRIPS + 1)
            strip = np.searchsorted(edges[1:-1], part[:, 2])
            soles[joint] = np.concatenate(
                [_lowest_on_each_side(part[strip == n]) for n in np.unique(strip)]
            )
        else:
            soles[joint] = body.rest_joints_m(shape)[[joint]]
    return soles


def _lowest_on_each_side(points_m: np.ndarray) -> np.ndarray:
    """The lowest point of the left and of the right half of some points: (N, 3) -> (1 or 2, 3)."""
    left = points_m[:, 0] >= points_m[:, 0].mean()
    halves = [half for half in (points_m[left], points_m[~left]) if len(half)]
    return np.stack([half[half[:, 1].argmin()] for half in halves])
