"""Rigid transforms as 4x4 arrays, named `a_from_b`: they map coordinates in b to a."""

import numpy as np


def rigid(rotmats: np.ndarray, translations: np.ndarray) -> np.ndarray:
    """Assemble transforms from rotations (..., 3, 3) and translations (..., 3) into (..., 4, 4)."""
    rotmats, translations = np.asarray(rotmats), np.asarray(translations)
    batch = np.broadcast_shapes(rotmats.shape[:-2], translations.shape[:-1])
    a_from_b = np.zeros((*batch, 4, 4))
    a_from_b[..., :3, :3] = rotmats
    a_from_b[..., :3, 3] = translations
    a_from_b[..., 3, 3] = 1.0
    return a_from_b


def invert(a_from_b: np.ndarray) -> np.ndarray:
    """b_from_a of rigid transforms (..., 4, 4), without a general matrix inverse."""
    b_from_a_rotmats = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    return rigid(
        b_from_a_rotmats, -np.einsum("...ij,...j->...i", b_from_a_rotmats, a_from_b[..., :3, 3])
    )


def apply(a_from_b: np.ndarray, points_b: np.ndarray) -> np.ndarray:
    """Map points (..., N, 3) from b to a by transforms (..., 4, 4) of the same batch shape."""
    return (
        np.einsum("...ij,...nj->...ni", a_from_b[..., :3, :3], points_b)
        + a_from_b[..., None, :3, 3]
    )


def slerp(start: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations (N, J, 3, 3) at a share (N,) of the shortest way from start to end."""
    from scipy.spatial.transform import Rotation  # slow to load; who starts Blender needs none

    step = Rotation.from_matrix((start.swapaxes(-1, -2) @ end).reshape(-1, 3, 3)).as_rotvec()
    turned = np.repeat(share, start.shape[1])[:, None] * step
    return start @ Rotation.from_rotvec(turned).as_matrix().reshape(start.shape)
