# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures on small things outdoors."""

import cv2
import numpy as np

from blender.textures.base import POSTERS, WOODS, ellipses, noise, pick, weather
from blender.textures.fronts import poster

LEAVES = 1500
"""Leaves on a picture of foliage."""


def planks(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """A crate's side: boards with grain, nails, a frame and a stencil."""
    image = np.empty((height_px, width_px, 3), np.float32)
    wood, boards = pick(rng, WOODS), int(rng.integers(4, 7))
    for board in range(boards):
        rows = slice(board * height_px // boards, (board + 1) * height_px // boards - 2)
        count = rows.stop - rows.start
        grain = cv2.resize(
            rng.standard_normal((count, max(width_px // 24, 2))).astype(np.float32),
            (width_px, count),
        )
        image[rows] = wood * (rng.uniform(0.7, 1.2) + 0.13 * grain[..., None])
        image[rows.stop : rows.stop + 2] = wood * 0.2
    edge = width_px // 10
    for columns in (slice(0, edge), slice(width_px - edge, width_px)):
        image[:, columns] = wood * 0.8
        image[:, columns] *= (
            1
            + 0.15
            * noise(height_px, edge, rng, 24, 4, 0.8)[..., None][:, : columns.stop - columns.start]
        )
    for x in (edge // 2, width_px - edge // 2):
        for y in range(height_px // 12, height_px, height_px // 6):
            cv2.circle(image, (x, y), max(edge // 6, 1), (0.12, 0.11, 0.1), -1, cv2.LINE_AA)
    size = width_px // 3
    x, y = (int(v) for v in rng.uniform(edge, 0.55 * width_px, 2))
    poster(image[y : y + size, x : x + size], rng)
    return weather(image, rng, 0.08)


def foliage(size_px: int, rng: np.random.Generator) -> np.ndarray:
    """Leaves over leaves, lighter on top, with some blossoms."""
    image = np.full((size_px, size_px, 3), (0.06, 0.10, 0.04), np.float32)
    blossom = pick(rng, POSTERS)
    lighter = np.linspace(0.45, 1.35, LEAVES)[:, None]
    shades = np.array([0.28, 0.46, 0.14]) * lighter * rng.uniform(0.7, 1.3, (LEAVES, 1))
    shades[rng.random(LEAVES) < 0.04] = blossom
    half_axes_px = size_px * rng.uniform((0.012, 0.006), (0.03, 0.012), (LEAVES, 2))
    ellipses(image, half_axes_px, np.clip(shades, 0, 0.9), rng)
    return image


def barrel(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """A painted drum: hoops, rust and a label."""
    image = np.full((height_px, width_px, 3), pick(rng, POSTERS), np.float32)
    rust = noise(height_px, width_px, rng, height_px // 3, 7, 0.7) > rng.uniform(0.5, 1.2)
    image[rust] = (0.40, 0.22, 0.12)
    for y in (0, height_px // 3, 2 * height_px // 3, height_px - height_px // 20):
        image[y : y + height_px // 24] *= 0.55
    for x in range(0, width_px - width_px // 6, width_px // 3):
        size = height_px // 4
        poster(image[height_px // 2 - size // 2 : height_px // 2 + size // 2, x : x + size], rng)
    return weather(image, rng, 0.10)
