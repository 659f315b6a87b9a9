"""Where a posed body stands before the camera: on its landmarks, without leaps.

Linear least squares: each landmark near its ray, as far as it is seen, and small second differences
of the pelvis's place.  A landmark that lies far from its ray counts less in a second round.
"""

from typing import Any

import numpy as np
import torch

from gmrdata.people.landmark_body import landmark_offsets_m, landmarks_on, tree_joints
from gmrdata.people.lifter import SeenLandmarks
from gmrdata.people.views import landmark_weights
from gmrdata.values.body import leg_length_m

ACCELERATION = 6.0  # usual one of a pelvis before a camera that is held by hand [m/s2]
DEPTH_ACCELERATION = 3.0
ERROR_M = 0.04  # of a landmark
ALIKE = 12.0  # landmarks of a frame err together: so many of them tell as much as one
ROUNDS = 3


def place(seen: SeenLandmarks, rotmats: np.ndarray, rest_joints_m: np.ndarray) -> np.ndarray:
    """The pelvis (T, 3) [m] of a body with rest joints (24, 3) and rotations (T, 24, 3, 3)."""
    about_m = landmarks_about(rotmats, rest_joints_m)
    weights = landmark_weights(torch.as_tensor(seen.visibility)).numpy()
    factors = np.ones_like(weights)
    pelvis_m = np.zeros((len(rotmats), 3))
    for _ in range(ROUNDS):
        pelvis_m = _solve(about_m, seen.rays, weights * factors, seen.times_s)
        placed_m = about_m + pelvis_m[:, None]
        depth_m = np.maximum(placed_m[..., 2:], LEAST_DEPTH_M)
        off_m = np.linalg.norm((placed_m[..., :2] / depth_m - seen.rays) * depth_m, axis=-1)
        factors = 1 / (1 + (off_m / (2 * ERROR_M)) ** 2)
    return pelvis_m


LEAST_DEPTH_M = 0.1


def landmarks_about(rotmats: np.ndarray, rest_joints_m: np.ndarray) -> np.ndarray:
    """Landmarks (T, 33, 3) from the pelvis [m]."""
    joints_m, turned = tree_joints(torch.as_tensor(rest_joints_m), torch.as_tensor(rotmats))
    leg_m = torch.full((len(rotmats),), leg_length_m(rest_joints_m), dtype=torch.float64)
    return landmarks_on(joints_m, turned, leg_m, torch.as_tensor(landmark_offsets_m())).numpy()


def _solve(
    about_m: np.ndarray, rays: np.ndarray, weights: np.ndarray, times_s: np.ndarray
) -> np.ndarray:
    """The pelvis (T, 3) of weighted least squares, all frames at once."""
    from scipy.sparse import block_diag, diags, eye, kron
    from scipy.sparse.linalg import spsolve

    n = len(about_m)
    u = rays
    ones, zeros = np.ones(u.shape[:2]), np.zeros(u.shape[:2])
    by_x = np.stack([ones, zeros, -u[..., 0]], axis=-1)
    by_y = np.stack([zeros, ones, -u[..., 1]], axis=-1)
    design = np.concatenate([by_x, by_y], axis=1)
    off_m = u * about_m[..., 2:] - about_m[..., :2]
    target_m = np.concatenate([off_m[..., 0], off_m[..., 1]], axis=1)
    both = np.concatenate([weights, weights], axis=1) / (ALIKE * ERROR_M**2)
    normal = np.einsum("tn,tni,tnj->tij", both, design, design)
    right = np.einsum("tn,tni,tn->ti", both, design, target_m)
    whole = block_diag(list(normal), format="csc")
    if n > 2:
        usual = np.tile([1 / ACCELERATION, 1 / ACCELERATION, 1 / DEPTH_ACCELERATION], n - 2)
        each = kron(_second_differences(times_s), eye(3))
        whole = whole + each.T @ diags(usual**2) @ each
    return np.asarray(spsolve(whole.tocsc(), right.ravel())).reshape(n, 3)


def _second_differences(times_s: np.ndarray) -> Any:
    """Sparse (T - 2, T), from values to their second differences per second squared."""
    from scipy.sparse import diags

    steps_s = np.diff(times_s)
    before, after = 1 / steps_s[:-1], 1 / steps_s[1:]
    between_s = (steps_s[1:] + steps_s[:-1]) / 2
    lines = [before / between_s, -(before + after) / between_s, after / between_s]
    return diags(lines, [0, 1, 2], shape=(len(times_s) - 2, len(times_s)))
