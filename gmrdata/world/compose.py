"""Eqs. 6-8 of the paper, from the camera's frame to the world's and back; and a world upright.

The levelled world has z up and the ground at z = 0, as far as the person tells.  The body's
translation is the pelvis throughout.  With SMPL's `trans` in its place eq. 8 is wrong by
(R_col,i+1 - R_col,i) J0 per frame: 11.8 mm at 10 fps for a camera that tilts at 30 degrees/s.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from gmrdata.values import transforms
from gmrdata.values.motion import Motion


def motion_in_world(seen: Motion, world_from_cam: np.ndarray, scale: float = 1.0) -> Motion:
    """R_w = R_col R_c and T_w = R_col T_c + s T_col (eqs. 7, 8), s metres per unit of T_col."""
    return _moved(seen, metric_cameras(world_from_cam, scale), "camera", "world")


def motion_in_camera(motion: Motion, world_from_cam: np.ndarray) -> Motion:
    """The person as each camera sees it: the inverse of `motion_in_world` for metric cameras."""
    return _moved(motion, transforms.invert(world_from_cam), "world", "camera")


def metric_cameras(world_from_cam: np.ndarray, scale: float) -> np.ndarray:
    """Cameras (T, 4, 4) with their centres multiplied by `scale`."""
    return transforms.rigid(world_from_cam[:, :3, :3], scale * world_from_cam[:, :3, 3])


def _moved(motion: Motion, b_from_a: np.ndarray, a: str, b: Literal["world", "camera"]) -> Motion:
    if motion.frame != a:
        raise ValueError(f"the motion is in the {motion.frame} frame, expected the {a} frame")
    if len(b_from_a) != motion.n_frames:
        raise ValueError(f"{motion.n_frames} frames of motion, {len(b_from_a)} cameras")
    return replace(
        motion,
        root_rotmats=b_from_a[:, :3, :3] @ motion.root_rotmats,
        pelvis_m=transforms.apply(b_from_a, motion.pelvis_m[:, None])[:, 0],
        frame=b,
    )


FEET_SIGMA_M = 0.02  # standard deviation of planted soles from one plane
BODY_UP_SIGMA_RAD = np.deg2rad(5.0)  # that of a person's mean up direction from the vertical
LARGEST_RESIDUAL_M = 0.05  # soles further from one plane (RMS) are not on flat ground


def level_from_world(
    root_rotmats: np.ndarray,
    pelvis_m: np.ndarray,
    planted_m: np.ndarray,
    first_viewing_direction: np.ndarray,
) -> np.ndarray:
    """Transform (4, 4) from the reconstruction's metric world to a levelled one.

    Up is the mean of the body's own up direction (y of the root).  Where planted feet tell more
    than that, they correct it: a plane is fitted to them with the body's up as prior knowledge, so
    feet along one line only correct the tilt along that line.  The first pelvis is above the
    origin, and the first camera, with z axis `first_viewing_direction` (3,), looks along +y.
    Root (N, 3, 3) and pelvis (N, 3) are of the frames that can be used; `planted_m` (M, 3) are sole
    points while they stand still.
    """
    mean_up = root_rotmats[:, :, 1].mean(axis=0)
    up = ground_normal(planted_m, mean_up / np.linalg.norm(mean_up))
    rotation = _upright(up, first_viewing_direction)
    origin_m = rotation @ pelvis_m[0]
    lowest_m = planted_m if len(planted_m) else pelvis_m
    origin_m[2] = np.median(lowest_m @ rotation[2])
    return transforms.rigid(rotation, -origin_m)


def ground_normal(planted_m: np.ndarray, body_up: np.ndarray) -> np.ndarray:
    """Unit normal (3,) of the ground under planted feet (M, 3) [m], given the body's up (3,).
    Linear least squares for two small tilts and a height, the tilts with a prior of zero."""
    if len(planted_m) < 3:
        return body_up
    across = np.linalg.svd(body_up[None])[2][1:]
    centred_m = planted_m - planted_m.mean(axis=0)
    design = centred_m @ across.T / FEET_SIGMA_M
    target = -(centred_m @ body_up) / FEET_SIGMA_M
    precision = design.T @ design + np.eye(2) / BODY_UP_SIGMA_RAD**2
    tilts = np.linalg.solve(precision, design.T @ target)
    if np.sqrt(np.mean((design @ tilts - target) ** 2)) * FEET_SIGMA_M > LARGEST_RESIDUAL_M:
        return body_up
    normal = body_up + tilts @ across
    return np.asarray(normal / np.linalg.norm(normal))


def _upright(up: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that takes `up` to +z and the horizontal part of `forward` to +y."""
    level_forward = forward - up * (up @ forward)
    if np.linalg.norm(level_forward) < 1e-6:  # looking straight up or down: any heading will do
        level_forward = np.linalg.svd(up[None])[2][1]
    y = level_forward / np.linalg.norm(level_forward)
    return np.stack([np.cross(y, up), y, up])
