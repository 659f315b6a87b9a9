"""VME with a body: its vertices are posed a chunk of motions at a time."""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.evaluate import metrics

CHUNK_BYTES = 64 << 20
"""Memory for the vertices of one chunk of motions."""


def posed_vertex_errors_mm(
    body: BodyModel,
    shape: np.ndarray,
    local_rotmats: np.ndarray,
    rotmats: np.ndarray,
    metres: np.ndarray,
    true_rotmats: np.ndarray,
    true_m: np.ndarray,
) -> np.ndarray:
    """VME of n motions of one body with its true local pose and shape (eq. 17): (n,) [mm].

    Args:
        body: The body.
        shape: Its shape coefficients.
        local_rotmats: (n, 23, 3, 3) local pose in the first frame of each motion.
        rotmats: (n, 3, 3) dR.
        metres: (n, 3) dT [m].
        true_rotmats: (n, 3, 3) dR*.
        true_m: (n, 3) dT* [m].
    """
    import torch

    from gmrdata.body.forward import posed_vertices

    chunk = max(1, CHUNK_BYTES // (len(body.template_m) * 24 * 8))
    betas = torch.as_tensor(shape, dtype=torch.float64)
    errors_mm = [np.zeros(0)]
    for start in range(0, len(metres), chunk):
        rows = slice(start, min(start + chunk, len(metres)))
        poses = np.ascontiguousarray(local_rotmats[rows])
        with torch.no_grad():
            vertices_m = posed_vertices(body, betas, torch.as_tensor(poses, dtype=torch.float64))
        errors_mm.append(
            metrics.vertex_errors_mm(
                rotmats[rows], metres[rows], true_rotmats[rows], true_m[rows], vertices_m.numpy()
            )
        )
    return np.concatenate(errors_mm)
