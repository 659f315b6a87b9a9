"""Putting a motion's soles on the floor z = 0."""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT, PARENTS
from gmrdata.motion.feet import PLANTED_M_PER_S
from gmrdata.motion.skeleton import global_rotmats, joint_positions_m

FOOT_JOINTS = tuple(
    JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")
)
SOLE_THICKNESS_M = 0.015
"""Vertices that lie at most this much above a foot part's lowest one belong to its sole."""
FLOOR_PERCENTILE = 10.0
"""The floor is that percentile of the sole's height while a foot stands: low, against steps and curbs,
but not the lowest, which is where a foot dips through."""


def floor_height_m(
    body: BodyModel,
    shape: np.ndarray,
    local_rotmats: np.ndarray,
    root_rotmats: np.ndarray,
    pelvis_m: np.ndarray,
    fps_hz: float,
) -> float:
    """Height of the floor that a motion shows, in its own z-up frame.

    Soles follow the ankle and toe joints rigidly here, which is exact enough (no skin bends at them).

    Args:
        body: The body.
        shape: (S,) its shape.
        local_rotmats: (T, 23, 3, 3).
        root_rotmats: (T, 3, 3).
        pelvis_m: (T, 3) [m].
        fps_hz: Frame rate [Hz].

    Returns:
        z of the floor [m]; subtract it from the pelvis path.
    """
    soles_m = sole_points_m(body, shape, local_rotmats, root_rotmats, pelvis_m)
    lowest = soles_m[:, :, 2].argmin(axis=1)
    rows = np.arange(len(soles_m))
    heights_m = soles_m[rows, lowest, 2]
    speeds = np.linalg.norm(np.gradient(soles_m, axis=0), axis=2)[rows, lowest] * fps_hz
    standing = speeds < PLANTED_M_PER_S
    return float(
        np.percentile(heights_m[standing] if standing.any() else heights_m, FLOOR_PERCENTILE)
    )


def sole_points_m(
    body: BodyModel,
    shape: np.ndarray,
    local_rotmats: np.ndarray,
    root_rotmats: np.ndarray,
    pelvis_m: np.ndarray,
) -> np.ndarray:
    """Some points of both soles over time: (T, P, 3) [m], in the motion's frame."""
    rest_joints_m = body.rest_joints_m(shape)
    rotmats = np.concatenate([root_rotmats[:, None], local_rotmats], axis=1)
    steps_m = rest_joints_m - np.where(
        np.array(PARENTS)[:, None] >= 0, rest_joints_m[list(PARENTS)], rest_joints_m
    )
    frame_from_joint = global_rotmats(PARENTS, rotmats)
    joints_m = joint_positions_m(PARENTS, frame_from_joint, steps_m) + pelvis_m[:, None]
    return np.concatenate(
        [
            joints_m[:, None, joint]
            + np.einsum("tij,pj->tpi", frame_from_joint[:, joint], points - rest_joints_m[joint])
            for joint, points in _sole_vertices_m(body, shape).items()
        ],
        axis=1,
    )


def _sole_vertices_m(body: BodyModel, shape: np.ndarray) -> dict[int, np.ndarray]:
    """Rest positions of the sole's outermost vertices by the joint that carries them most [m]."""
    vertices_m = body.template_m + body.shape_dirs_m @ shape
    carrier = body.skin_weights.argmax(axis=1)
    soles = {}
    for joint in FOOT_JOINTS:
        part = vertices_m[carrier == joint]
        if len(part):
            sole = part[part[:, 1] <= part[:, 1].min() + SOLE_THICKNESS_M]
            extremes = [pick(sole[:, k]) for k in (0, 1, 2) for pick in (np.argmin, np.argmax)]
            soles[joint] = sole[np.unique(extremes)]
        else:
            soles[joint] = body.rest_joints_m(shape)[[joint]]
    return soles
