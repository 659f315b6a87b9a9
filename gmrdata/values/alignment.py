"""Best rotations and similarities between two sets of points or orientations."""

from typing import NamedTuple

import numpy as np


class Similarity(NamedTuple):
    """a_from_b of points: p_a = scale * rotmat @ p_b + translation_m."""

    scale: float
    rotmat: np.ndarray
    translation_m: np.ndarray

    def apply(self, points_b_m: np.ndarray) -> np.ndarray:
        """Map points (..., 3) from b to a [m]."""
        mapped: np.ndarray = (
            self.scale * np.asarray(points_b_m) @ self.rotmat.T + self.translation_m
        )
        return mapped


def fit_similarity(points_a_m: np.ndarray, points_b_m: np.ndarray, *, scale: bool) -> Similarity:
    """The a_from_b of least squares between paired points (Umeyama 1991, eqs. 40-42).

    Points on a line, or in one place, leave a part of the rotation open; one of the best is given.

    Args:
        points_a_m: (N, 3) points in a [m].
        points_b_m: (N, 3) the same points in b [m], not all in one place where `scale` is fitted.
        scale: Whether to fit the scale, or keep it at 1.
    """
    mean_a, mean_b = points_a_m.mean(0), points_b_m.mean(0)
    centred_a, centred_b = points_a_m - mean_a, points_b_m - mean_b
    covariance = centred_a.T @ centred_b / len(points_a_m)
    rotmat, singular = _nearest_rotation(covariance)
    factor = float(singular.sum() / centred_b.var(0).sum()) if scale else 1.0
    return Similarity(factor, rotmat, mean_a - factor * rotmat @ mean_b)


def mean_rotation(rotmats: np.ndarray) -> np.ndarray:
    """Chordal mean (Hartley et al. 2013, section 5.3): (N, 3, 3) -> (3, 3)."""
    return _nearest_rotation(rotmats.sum(0))[0]


def _nearest_rotation(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotation nearest to a 3x3 matrix, and its signed singular values."""
    u, singular, vt = np.linalg.svd(matrix)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return (u * signs) @ vt, singular * signs
