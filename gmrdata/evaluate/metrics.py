"""The paper's motion errors (eqs. 15-17): OME [deg], TME [mm], VME [mm].

Each is a mean over the T-1 motions of T frames.  The functions ending in `_errors_*` give the
values per motion, of which the mean is taken; a caller with gaps pools those of several runs.
"""

import numpy as np


def angles_rad(rotmats: np.ndarray) -> np.ndarray:
    """Rotation angles in [0, pi] of matrices (..., 3, 3), i.e. the length of the log map: (...)
    [rad].

    From sine and cosine together, so it is as accurate near 0 and pi as between.
    """
    skew = rotmats - np.swapaxes(rotmats, -1, -2)
    sines = 0.5 * np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    cosines = 0.5 * (np.trace(rotmats, axis1=-2, axis2=-1) - 1)
    angles: np.ndarray = np.arctan2(sines, cosines)
    return angles


def orientation_errors_deg(predicted_rotmats: np.ndarray, true_rotmats: np.ndarray) -> np.ndarray:
    """Angle of dR* dR^T per motion: (..., 3, 3) twice -> (...) [deg]."""
    return np.rad2deg(angles_rad(true_rotmats @ np.swapaxes(predicted_rotmats, -1, -2)))


def translation_errors_mm(predicted_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    """Length of dT - dT* per motion: (..., 3) [m] twice -> (...) [mm]."""
    lengths: np.ndarray = np.linalg.norm(predicted_m - true_m, axis=-1) * 1000
    return lengths


def vertex_errors_mm(
    predicted_rotmats: np.ndarray,
    predicted_m: np.ndarray,
    true_rotmats: np.ndarray,
    true_m: np.ndarray,
    true_vertices_m: np.ndarray,
    predicted_vertices_m: np.ndarray | None = None,
) -> np.ndarray:
    """Mean distance of the vertices of M([dA, L], beta, dT) per motion: (n,) [mm].

    Args:
        predicted_rotmats: (n, 3, 3) dR.
        predicted_m: (n, 3) dT [m].
        true_rotmats: (n, 3, 3) dR*.
        true_m: (n, 3) dT* [m].
        true_vertices_m: (n, V, 3) true posed body in the first frame of each motion, root at
            identity, pelvis at the origin [m].
        predicted_vertices_m: The same of the predicted local pose and shape; None where those are
            the true ones.
    """
    if predicted_vertices_m is None:
        predicted_vertices_m = true_vertices_m
    predicted = predicted_vertices_m @ np.swapaxes(predicted_rotmats, -1, -2)
    true = true_vertices_m @ np.swapaxes(true_rotmats, -1, -2)
    offsets_m = predicted - true + (predicted_m - true_m)[:, None]
    means: np.ndarray = np.linalg.norm(offsets_m, axis=-1).mean(-1) * 1000
    return means


def ome_deg(predicted_rotmats: np.ndarray, true_rotmats: np.ndarray) -> float:
    """Orientation motion error, eq. 15: mean over motions (n, 3, 3) [deg]."""
    return float(orientation_errors_deg(predicted_rotmats, true_rotmats).mean())


def tme_mm(predicted_m: np.ndarray, true_m: np.ndarray) -> float:
    """Translation motion error, eq. 16: mean over motions (n, 3) [mm]."""
    return float(translation_errors_mm(predicted_m, true_m).mean())


def vme_mm(
    predicted_rotmats: np.ndarray,
    predicted_m: np.ndarray,
    true_rotmats: np.ndarray,
    true_m: np.ndarray,
    true_vertices_m: np.ndarray,
    predicted_vertices_m: np.ndarray | None = None,
) -> float:
    """Vertex motion error, eq. 17: mean over motions and vertices [mm]; see `vertex_errors_mm`."""
    return float(
        vertex_errors_mm(
            predicted_rotmats,
            predicted_m,
            true_rotmats,
            true_m,
            true_vertices_m,
            predicted_vertices_m,
        ).mean()
    )
