"""How far a camera moves and turns over some frames."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.geometry import transforms


def relative_moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """(T - step, 4, 4) motion over `step` frames, in the axes of the first camera of each."""
    return np.asarray(transforms.invert(world_from_cam[:-step]) @ world_from_cam[step:])


def angles_deg(moves: np.ndarray) -> np.ndarray:
    """(N,) rotation angles of transforms (N, 4, 4) [degrees]; NaN where unknown."""
    known = np.isfinite(moves).all(axis=(1, 2))
    angles = np.full(len(moves), np.nan)
    if known.any():
        angles[known] = Rotation.from_matrix(moves[known, :3, :3]).magnitude()
    return np.rad2deg(angles)


def window_differences(
    world_from_cam: np.ndarray, tracked: np.ndarray, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """How differently two cameras (T, 4, 4) move over `step` frames.

    Returns:
        Difference of the rotations (T - step,) [degrees], and of the displacements (T - step,) [m];
        NaN where either camera is unknown.
    """
    ours, theirs = relative_moves(world_from_cam, step), relative_moves(tracked, step)
    apart_m = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    return angles_deg(transforms.invert(ours) @ theirs), apart_m
