"""The paper's motion errors (eqs. 15-17): OME [deg], TME [mm], VME [mm].

Each is a mean over the T-1 motions of T frames.  The functions give the values per motion, of which
the mean is taken; a caller with gaps pools those of several runs.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import angles_rad


def orientation_errors_deg(
    predicted_rotmats: Float[np.ndarray, "*n 3 3"], true_rotmats: Float[np.ndarray, "*n 3 3"]
) -> Float[np.ndarray, "*n"]:
    """Angle of dR* dR^T per motion [deg]."""
    return np.rad2deg(angles_rad(true_rotmats @ np.swapaxes(predicted_rotmats, -1, -2)))


def translation_errors_mm(
    predicted_m: Float[np.ndarray, "*n 3"], true_m: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    """Length of dT - dT* per motion [mm]."""
    return np.asarray(np.linalg.norm(predicted_m - true_m, axis=-1) * 1000)


def vertex_errors_mm(
    predicted_rotmats: Float[np.ndarray, "n 3 3"],
    predicted_m: Float[np.ndarray, "n 3"],
    true_rotmats: Float[np.ndarray, "n 3 3"],
    true_m: Float[np.ndarray, "n 3"],
    true_vertices_m: Float[np.ndarray, "n vertices 3"],
    predicted_vertices_m: Float[np.ndarray, "n vertices 3"] | None = None,
) -> Float[np.ndarray, " n"]:
    """Mean distance of the vertices of M([dA, L], beta, dT) per motion (dR, dT; dR*, dT*) [mm].

    The vertices are of the posed body in the first frame of each motion, root at identity, pelvis
    at the origin [m]; the predicted ones are None where local pose and shape are the true ones.
    """
    if predicted_vertices_m is None:
        predicted_vertices_m = true_vertices_m
    predicted = predicted_vertices_m @ np.swapaxes(predicted_rotmats, -1, -2)
    true = true_vertices_m @ np.swapaxes(true_rotmats, -1, -2)
    offsets_m = predicted - true + (predicted_m - true_m)[:, None]
    return np.asarray(np.linalg.norm(offsets_m, axis=-1).mean(-1) * 1000)


CHUNK_BYTES = 64 << 20  # memory for the vertices of one chunk of frames
COPIES = 8  # of them, that the errors are computed with


class VertexErrors(NamedTuple):
    """Errors of a predicted motion's vertices."""

    vme_mm: np.ndarray  # (T-1,) mean over the vertices for each motion (eq. 17) [mm]
    over_time_mm: np.ndarray  # (T,) the same, motions accumulated from the true first pose (fig. 5)


def posed_vertex_errors_mm(
    body: BodyModel,
    shape: Float[np.ndarray, " coefficients"],
    local_rotmats: Float[np.ndarray, "n 23 3 3"],
    predicted: tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]],
    true: tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]],
) -> Float[np.ndarray, " n"]:
    """VME of n motions dR, dT [m] (eq. 17) [mm], with the true shape and local poses of their first
    frames."""
    errors_mm = [np.zeros(0)]
    for rows in chunks(len(local_rotmats), len(body.template_m), COPIES):
        vertices_m = _posed_m(body, shape, local_rotmats[rows])
        (delta_rotmats, delta_m), (true_rotmats, true_m) = predicted, true
        motions, wanted = (delta_rotmats[rows], delta_m[rows]), (true_rotmats[rows], true_m[rows])
        errors_mm.append(vertex_errors_mm(*motions, *wanted, vertices_m))
    return np.concatenate(errors_mm)


def run_vertex_errors(
    body: BodyModel,
    true: Motion,
    predicted: Mapping[str, Motion],
    predicted_body: BodyModel | None = None,
) -> dict[str, VertexErrors]:
    """Vertex errors of several predictions of one motion; the true body is posed once.

    Each prediction is in a world of its own: only its motion from frame to frame counts.  One with
    the true local pose and shape (the same arrays) is not posed again; the others have
    `predicted_body`, if given, which has the true body's vertices.
    """
    true_rotmats, true_m = deltas(true.root_rotmats, true.pelvis_m)
    motions = {name: deltas(one.root_rotmats, one.pelvis_m) for name, one in predicted.items()}
    placed = {name: _from_true_start(one, true) for name, one in predicted.items()}
    errors: dict[str, list[VertexErrors]] = {name: [] for name in predicted}
    for rows in chunks(true.n_frames, len(body.template_m), COPIES):
        vertices_m = _posed_m(body, true.shape, true.local_rotmats[rows])
        for name, one in predicted.items():
            own_m = vertices_m
            if one.local_rotmats is not true.local_rotmats or one.shape is not true.shape:
                own_m = _posed_m(predicted_body or body, one.shape, one.local_rotmats[rows])
            delta_rotmats, delta_m = (part[rows] for part in motions[name])
            # The last frame begins no motion.
            n = len(delta_m)
            vme_mm = vertex_errors_mm(
                delta_rotmats, delta_m, true_rotmats[rows], true_m[rows], vertices_m[:n], own_m[:n]
            )
            roots, places_m = (part[rows] for part in placed[name])
            over_time_mm = vertex_errors_mm(
                roots, places_m, true.root_rotmats[rows], true.pelvis_m[rows], vertices_m, own_m
            )
            errors[name].append(VertexErrors(vme_mm, over_time_mm))
    return {
        name: VertexErrors(*(np.concatenate(parts) for parts in zip(*chunks, strict=True)))
        for name, chunks in errors.items()
    }


def _from_true_start(predicted: Motion, true: Motion) -> tuple[np.ndarray, np.ndarray]:
    """R (T, 3, 3) and T (T, 3) [m] of a prediction whose first pose is made the true one."""
    true_from_predicted = true.root_rotmats[0] @ predicted.root_rotmats[0].T
    path_m = (predicted.pelvis_m - predicted.pelvis_m[0]) @ true_from_predicted.T
    return true_from_predicted @ predicted.root_rotmats, path_m + true.pelvis_m[0]


def _posed_m(body: BodyModel, shape: np.ndarray, local_rotmats: np.ndarray) -> np.ndarray:
    """Vertices (n, V, 3) [m], root at identity and pelvis at the origin."""
    import torch

    from gmrdata.values.skinning_torch import posed_vertices

    betas = torch.as_tensor(shape, dtype=torch.float64)
    poses = torch.as_tensor(np.ascontiguousarray(local_rotmats), dtype=torch.float64)
    with torch.no_grad():
        return np.asarray(posed_vertices(body, betas, poses).numpy())


def speeds_m_per_s(points_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T, ...) of points (T, ..., 3) over time [m/s]; 0 in a single frame, which shows none."""
    if len(points_m) < 2:
        return np.zeros(points_m.shape[:-1])
    return np.linalg.norm(np.gradient(points_m, axis=0), axis=-1) * fps_hz


def chunks(n_rows: int, n_vertices: int, copies: int = 1) -> Iterator[slice]:
    """Rows whose vertices, with so many copies of them, take `CHUNK_BYTES` at the most."""
    length = max(1, CHUNK_BYTES // (n_vertices * 24 * copies))
    for start in range(0, n_rows, length):
        yield slice(start, min(start + length, n_rows))
