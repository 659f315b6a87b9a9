# SPDX-License-Identifier: GPL-3.0-or-later
"""Posters: bold shapes and lines of writing."""

import cv2
import numpy as np

from blender.textures.base import PLASTERS, POSTERS, pick, weather


def poster(patch: np.ndarray, rng: np.random.Generator) -> None:
    """Fill a view of an image with a poster: a picture of bold shapes and lines of writing."""
    height, width = patch.shape[:2]
    if height < 8 or width < 8:
        return
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = pick(rng, POSTERS)
    for _ in range(int(rng.integers(3, 8))):
        colour = tuple(float(c) for c in pick(rng, POSTERS))
        at = rng.uniform(0, 1, 2) * (width, 0.7 * height)
        corners = at + rng.normal(0, 0.28 * width, (int(rng.integers(3, 6)), 2))
        if rng.random() < 0.5:
            radius = max(int(rng.uniform(0.08, 0.3) * width), 1)
            cv2.circle(picture, tuple(int(v) for v in at), radius, colour, -1, cv2.LINE_AA)
        else:
            cv2.fillConvexPoly(
                picture, cv2.convexHull(corners.astype(np.int32)), colour, cv2.LINE_AA
            )
    ink = pick(rng, POSTERS)
    for y in np.arange(0.72, 0.95, 0.055) * height:
        x = 0.08 * width
        while x < 0.9 * width:
            word = rng.uniform(0.05, 0.22) * width
            line = slice(int(y), int(y + max(0.028 * height, 1)))
            picture[line, int(x) : int(min(x + word, 0.92 * width))] = ink
            x += word + 0.035 * width
    patch[:] = picture


def posters(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """An advertising pillar: posters side by side, pasted over one another."""
    image = np.empty((height_px, width_px, 3), np.float32)
    image[:] = pick(rng, PLASTERS)
    for _ in range(40):
        height, width = (
            int(height_px * rng.uniform(0.2, 0.4)),
            int(width_px * rng.uniform(0.12, 0.22)),
        )
        y, x = int(rng.uniform(0, height_px - height)), int(rng.uniform(0, width_px - width))
        poster(image[y : y + height, x : x + width], rng)
    return weather(image, rng, 0.06)
