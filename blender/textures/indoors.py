# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls, floors and furniture."""

import cv2
import numpy as np

from blender.textures.base import POSTERS, WOODS, Colour, noise, pick, weather
from blender.textures.fronts import poster

WALLPAPERS: tuple[Colour, ...] = (
    (0.74, 0.70, 0.58), (0.56, 0.64, 0.62), (0.72, 0.56, 0.48), (0.62, 0.64, 0.50),
)  # fmt: skip


def wall(width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator) -> np.ndarray:
    """Striped paper with sprigs over panelling, hung with pictures."""
    height, width = int(height_m * px_per_m), int(width_m * px_per_m)
    paper, ink = pick(rng, WALLPAPERS), pick(rng, POSTERS)
    image = np.full((height, width, 3), paper, np.float32)
    step = int(0.3 * px_per_m)
    for x in range(0, width, step):
        image[:, x : x + step // 2] *= 0.88
        for y in range((x // step % 2) * step // 2, height, step):
            at = (x + step // 4 + int(rng.normal(0, 2)), y + int(rng.normal(0, 2)))
            colour = tuple(float(c) for c in 0.5 * paper + 0.5 * ink * rng.uniform(0.6, 1.2))
            axes = (max(step // 6, 2), max(step // 14, 1))
            for angle in rng.uniform(0, 180, 3):
                cv2.ellipse(image, at, axes, float(angle), 0, 360, colour, -1, cv2.LINE_AA)
    image = weather(image, rng, 0.06)
    _pictures(image, px_per_m, rng, count=int(1.1 * width_m))
    panel = int(height - 0.85 * px_per_m)
    image[panel:] = floorboards(height - panel, width, (0.85 * px_per_m, 0.3 * px_per_m), rng)
    image[panel : panel + max(int(0.05 * px_per_m), 1)] = 0.75
    image[height - int(0.12 * px_per_m) :] *= 0.6
    return image


def _pictures(image: np.ndarray, px_per_m: float, rng: np.random.Generator, count: int) -> None:
    """Framed pictures of many sizes in two uneven rows."""
    height, width = image.shape[:2]
    lowest = height - 0.95 * px_per_m
    for k in range(2 * count):
        size = [int(v * px_per_m) for v in rng.uniform((0.35, 0.4), (0.85, 0.95))]
        x = int((k // 2 + rng.uniform(0.0, 0.25)) * width / max(count, 1))
        y = int(lowest - size[1] - (k % 2) * px_per_m - rng.uniform(0, 0.12) * px_per_m)
        if y < 4 or x + size[0] > width - 4:
            continue
        border = max(int(0.04 * px_per_m), 2)
        frame = image[y : y + size[1], x : x + size[0]]
        frame[:] = pick(rng, (*WOODS, (0.12, 0.1, 0.09), (0.75, 0.62, 0.3)))
        inner = frame[border:-border, border:-border]
        inner[:] = 0.88
        poster(inner[border:-border, border:-border], rng)
        shadow = image[y + size[1] : y + size[1] + border, x + border : x + size[0] + border]
        shadow *= 0.6


def floorboards(
    height: int, width: int, board_px: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """Boards of about a length and a width, staggered, with grain and knots."""
    image = np.empty((height, width, 3), np.float32)
    wood = pick(rng, WOODS)
    long_px, wide_px = board_px
    for y in np.arange(0, height, wide_px):
        x = -rng.uniform(0, long_px)
        while x < width:
            end = x + long_px * rng.uniform(0.6, 1.3)
            board = image[int(y) : int(y + wide_px), max(int(x), 0) : max(int(end), 0)]
            if board.size:
                coarse = rng.standard_normal((len(board), 8)).astype(np.float32)
                grain = cv2.resize(coarse, (board.shape[1], len(board)))
                board[:] = wood * (rng.uniform(0.6, 1.3) + 0.13 * grain[..., None])
                board[-1:], board[:, -1:] = wood * 0.25, wood * 0.25
            x = end
    return weather(image, rng, 0.09)


def floor(
    size_px: int,
    metres: float,
    carpets_m: list[tuple[float, float, float, float]],
    rng: np.random.Generator,
) -> np.ndarray:
    """Parquet with carpets: each x, y from the top left, width and height [m]."""
    px_per_m = size_px / metres
    image = floorboards(size_px, size_px, (0.75 * px_per_m, 0.11 * px_per_m), rng)
    for carpet_m in carpets_m:
        x, y, width, height = (int(v * px_per_m) for v in carpet_m)
        patch = image[max(y, 0) : max(y + height, 0), max(x, 0) : max(x + width, 0)]
        if min(patch.shape[:2]) > 16:
            patch[:] = carpet(patch.shape[0], patch.shape[1], rng)
    return image


def carpet(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Woven borders and rows of motifs, no two alike."""
    image = np.empty((height, width, 3), np.float32)
    for share in (0.0, 0.03, 0.05, 0.12, 0.14):
        inset = int(share * min(height, width))
        image[inset : height - inset, inset : width - inset] = 0.85 * pick(rng, POSTERS)
    cell = max(min(height, width) // 11, 6)
    for y in range(cell // 2, height, cell):
        for x in range(cell // 2, width, cell):
            corners = rng.normal((x, y), 0.3 * cell, (int(rng.integers(3, 6)), 2))
            colour = tuple(float(c) for c in pick(rng, POSTERS))
            cv2.fillConvexPoly(image, cv2.convexHull(corners.astype(np.int32)), colour, cv2.LINE_AA)
    image *= 1 + 0.12 * rng.standard_normal((height, width, 1)).astype(np.float32)
    return weather(image, rng, 0.06)


def ceiling(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Painted panels between beams."""
    px_per_m = size_px / metres
    image = np.full((size_px, size_px, 3), (0.78, 0.76, 0.70), np.float32)
    image = weather(image, rng, 0.06)
    beam = max(int(0.16 * px_per_m), 2)
    for at in np.arange(0.3, metres, 1.4) * px_per_m:
        rows = image[int(at) : int(at) + beam]
        rows[:] = floorboards(len(rows), size_px, (2 * px_per_m, beam), rng)
    return image


def books(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """Shelves full of books, with gaps and things between."""
    wood = pick(rng, WOODS)
    image = np.full((height_px, width_px, 3), wood * 0.25, np.float32)
    rows = max(height_px // 70, 2)
    for row in range(rows):
        top, bottom = row * height_px // rows + 5, (row + 1) * height_px // rows - 5
        x = 5
        while x < width_px - 12:
            thick = int(rng.uniform(4, 13))
            back = image[
                int(bottom - rng.uniform(0.6, 0.95) * (bottom - top)) : bottom, x : x + thick
            ]
            back[:] = pick(rng, POSTERS) * rng.uniform(0.5, 1.0)
            back[len(back) // 5 : len(back) // 5 + 4] *= 0.4
            label = len(back) // 2 + int(rng.integers(-6, 6))
            back[label : label + int(rng.integers(4, 12)), 1:-1] = pick(rng, POSTERS) * 0.8
            back[:, -1:] *= 0.4
            x += thick + (int(rng.uniform(8, 40)) if rng.random() < 0.06 else 0)
        image[bottom : bottom + 10] = wood
    image[:, :5], image[:, -5:], image[:5] = wood, wood, wood
    return weather(image, rng, 0.05)


def cloth(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """Printed upholstery."""
    base = 0.7 * pick(rng, POSTERS) + 0.1
    image = np.full((height_px, width_px, 3), base, np.float32)
    for _ in range(int(width_px * height_px / 260)):
        at = tuple(int(v) for v in rng.uniform(0, 1, 2) * (width_px, height_px))
        axes = tuple(int(v) for v in rng.uniform(2, 9, 2))
        colour = tuple(float(c) for c in 0.6 * pick(rng, POSTERS) + 0.3 * base)
        cv2.ellipse(image, at, axes, rng.uniform(0, 180), 0, 360, colour, -1, cv2.LINE_AA)
    return weather(image, rng, 0.08)


def board(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """Plain furniture wood."""
    image = floorboards(height_px, width_px, (2.0 * width_px, max(height_px / 4, 8)), rng)
    patina = noise(height_px, width_px, rng, max(width_px // 3, 8), 6, 0.8)
    return np.clip(image * (1 + 0.1 * patina[..., None]), 0.02, 0.95).astype(np.float32)
