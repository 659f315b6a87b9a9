"""Some of a body's vertices, where all of them are more than is needed."""

from dataclasses import replace

import numpy as np

from gmrdata.body.model import BodyModel


def vertex_rows(n_body_vertices: int, n_vertices: int | None) -> np.ndarray:
    """Rows of n vertices, evenly spread over the body's list, ascending: (n,) int.

    All of them for None, or where the body has no more than asked for.
    """
    if n_vertices is None or n_vertices >= n_body_vertices:
        return np.arange(n_body_vertices)
    return (np.arange(n_vertices) * n_body_vertices) // n_vertices


def with_vertices(body: BodyModel, rows: np.ndarray) -> BodyModel:
    """The same body with some of its vertices and no faces; joints and shapes stay as they are.

    Args:
        body: A body of V vertices.
        rows: (n,) int indices of the vertices to keep.
    """
    return replace(
        body,
        template_m=body.template_m[rows],
        shape_dirs_m=body.shape_dirs_m[rows],
        skin_weights=body.skin_weights[rows],
        pose_dirs_m=None if body.pose_dirs_m is None else body.pose_dirs_m[rows],
        faces=np.zeros((0, 3), dtype=body.faces.dtype),
    )
