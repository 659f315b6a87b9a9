# SPDX-License-Identifier: GPL-3.0-or-later
"""A place in a picture for every triangle of a mesh, so that it can be painted texel by texel.

Colours per vertex are as coarse as the mesh, and hems and stripes come out jagged.  Here each
triangle has half a square cell of the picture to itself, the larger the triangle the larger; the
other half is another triangle's.  Round each stands a rim that is painted as if the triangle went
on, so that interpolation between texels never takes colour from another triangle.
"""

from dataclasses import dataclass

import numpy as np

WIDTH_PX = 1024
TEXEL_M = 0.003
"""Wanted size of a texel on the surface [m]."""
CELLS_PX = (6, 8, 11, 15, 20, 32)
"""Sides of cells; each triangle gets the smallest that is fine enough, or the largest."""
RIM_PX = 3
"""Texels that a cell's side has beyond a triangle's: one of each half's rim, and one that ends."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """Where each of F triangles lies in a picture, and what each of M texels shows."""

    size_px: tuple[int, int]
    """Height and width of the picture [px]."""
    uv: np.ndarray
    """(F, 3, 2) picture coordinates per corner; (0, 0) is the picture's lower left."""
    texels: np.ndarray
    """(M,) index into the flat picture, row 0 at the top."""
    face: np.ndarray
    """(M,) triangle that a texel belongs to."""
    shares: np.ndarray
    """(M, 3) float32 share of each corner in a texel; they sum to 1, in the rim one is negative."""

    def spread(self, faces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values per vertex (V, C) interpolated to the texels: (M, C) float32."""
        corners = np.asarray(values, dtype=np.float32)[faces]
        mixed: np.ndarray = self.shares[:, 0, None] * corners[self.face, 0]
        for corner in (1, 2):
            mixed += self.shares[:, corner, None] * corners[self.face, corner]
        return mixed

    def picture(self, colours: np.ndarray) -> np.ndarray:
        """(H, W, 3) float32 picture of colours per texel (M, 3)."""
        flat = np.zeros((self.size_px[0] * self.size_px[1], 3), np.float32)
        flat[self.texels] = colours
        return flat.reshape(*self.size_px, 3)


def lay_out(vertices_m: np.ndarray, faces: np.ndarray) -> Atlas:
    """The atlas of a mesh: (V, 3) vertices [m] and (F, 3) triangles."""
    corners_m = vertices_m[faces]
    longest_m = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=-1).max(axis=1)
    size = np.searchsorted(np.array(CELLS_PX[:-1]) - RIM_PX, longest_m / TEXEL_M)
    uv_px = np.empty((len(faces), 3, 2))
    parts, top = [], 0
    for number, cell in enumerate(CELLS_PX):
        mine = np.flatnonzero(size == number)
        row, column = np.divmod(np.arange(len(mine)) // 2, WIDTH_PX // cell)
        corner = np.stack([column * cell, top + row * cell], axis=-1)
        for half in (0, 1):
            uv_px[mine[half::2]] = corner[half::2, None] + _triangle(cell, half)
            parts.append(_texels(mine[half::2], corner[half::2], cell, half))
        top += cell * -(-((len(mine) + 1) // 2) // (WIDTH_PX // cell))
    texels, face, shares = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    # In texels from the top left; the middle of a texel is half a texel in.
    uv = (uv_px + 0.5) / (WIDTH_PX, top)
    uv[..., 1] = 1 - uv[..., 1]
    return Atlas((top, WIDTH_PX), uv, texels, face, shares)


def _triangle(cell: int, half: int) -> np.ndarray:
    """(3, 2) corners of one of the two triangles in a cell, x and y [px]."""
    length = cell - RIM_PX
    lower = np.array([[0, 0], [length, 0], [0, length]])
    return cell - 1 - lower if half else lower


def _texels(
    face: np.ndarray, corner: np.ndarray, cell: int, half: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Texels, triangle and shares, as in `Atlas`, of N cells' first or second triangle.

    Args:
        face: (N,) the triangles.
        corner: (N, 2) x and y of each cell's upper left texel [px].
        cell: Side of a cell [px].
        half: 0 or 1.
    """
    length = cell - RIM_PX
    j, i = (axis.ravel() for axis in np.mgrid[:cell, :cell])
    mine = (i + j > length + 1) if half else (i + j <= length + 1)
    i, j = i[mine], j[mine]
    first, second = (cell - 1 - i, cell - 1 - j) if half else (i, j)
    shares = np.stack([length - first - second, first, second], axis=-1) / length
    texels = (corner[:, 1, None] + j) * WIDTH_PX + corner[:, 0, None] + i
    return (
        texels.ravel(),
        np.repeat(face, len(i)),
        np.tile(shares.astype(np.float32), (len(face), 1)),
    )
