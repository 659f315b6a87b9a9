"""The camera that films a world motion: beside the person, following the smoothed path."""

import numpy as np

from gmrdata.geometry import transforms
from gmrdata.geometry.look_at import look_at, smooth_path
from gmrdata.motion.motion import Motion

HFOV_DEG = 50.0
DISTANCE_M = 4.2
HEIGHT_M = 1.7
FOLLOW_SIGMA_S = 0.6
SHORTEST_WAY_M = 0.5
"""On a shorter path the camera stands before the person, else beside the path."""
_FRONT_IN_REST = np.array([0.0, 0.0, 1.0])


def film_camera(motion: Motion) -> np.ndarray:
    """Cameras for all frames: (T, 4, 4) world_from_cam [m].

    They look at the person across the longest way of the path, from the side that the front of the
    body shows to, and never turn; so whatever turns in the picture is the person.

    Args:
        motion: In a z-up world with the floor at z = 0.
    """
    targets_m = smooth_path(motion.pelvis_m, motion.fps_hz, FOLLOW_SIGMA_S, lag_s=0.0)
    targets_m[:, 2] = max(0.5, float(np.median(motion.pelvis_m[:, 2])))
    side = _side(motion)
    centres_m = targets_m + DISTANCE_M * side
    centres_m[:, 2] = max(HEIGHT_M, targets_m[0, 2] + 0.5)
    return transforms.rigid(look_at(centres_m, targets_m), centres_m)


def _side(motion: Motion) -> np.ndarray:
    """The horizontal direction (3,) from the person to the camera."""
    front = (motion.root_rotmats @ _FRONT_IN_REST).mean(axis=0)[:2]
    if np.linalg.norm(front) < 1e-3:
        front = np.array([0.0, -1.0])
    front = front / np.linalg.norm(front)
    centred_m = motion.pelvis_m[:, :2] - motion.pelvis_m[:, :2].mean(axis=0)
    _, spreads, axes = np.linalg.svd(centred_m, full_matrices=False)
    along = axes[0]
    if spreads[0] / np.sqrt(len(centred_m)) < SHORTEST_WAY_M / 4:
        along = np.array([front[1], -front[0]])
    across = np.array([-along[1], along[0]])
    across = across if across @ front >= 0 else -across
    # Not square across: a step towards the front shows the face and the depth of the path.
    direction = across + 0.5 * front
    direction /= np.linalg.norm(direction)
    return np.array([*direction, 0.0])
