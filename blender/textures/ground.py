# SPDX-License-Identifier: GPL-3.0-or-later
"""What one walks on outdoors."""

import cv2
import numpy as np

from blender.textures.base import POSTERS, ellipses, pick, weather

JOINTS = (0.22, 0.20, 0.18)
"""Colour between flagstones."""


def paving(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Flagstones in rows of changing width, with leaves, stains and painted marks."""
    px_per_m = size_px / metres
    image = np.empty((size_px, size_px, 3), np.float32)
    image[:] = JOINTS
    y = 0.0
    joint = max(0.014 * px_per_m, 1)
    while y < size_px:
        row = rng.uniform(0.32, 0.62) * px_per_m
        x = -rng.uniform(0, 0.8) * px_per_m
        line = np.empty((size_px, 3), np.float32)
        line[:] = JOINTS
        while x < size_px:
            stone = rng.uniform(0.35, 1.05) * px_per_m
            shade = rng.normal(0.52, 0.085) * np.array([1.0, 0.95, 0.87]) + rng.normal(0, 0.012, 3)
            line[int(max(x + joint, 0)) : int(max(min(x + stone, size_px), 0))] = shade
            x += stone
        image[int(y + joint) : int(min(y + row, size_px))] = line
        y += row
    _marks(image, px_per_m, rng)
    image = weather(image, rng, 0.10)
    leaves(image, px_per_m, rng, count=int(4.5 * metres**2))
    return image


def _marks(image: np.ndarray, px_per_m: float, rng: np.random.Generator) -> None:
    """Drain covers and chalk drawings."""
    size = len(image)
    for _ in range(int(size / px_per_m / 2)):
        at = tuple(int(v) for v in rng.uniform(0, size, 2))
        radius = int(rng.uniform(0.22, 0.4) * px_per_m)
        cv2.circle(image, at, radius, (0.26, 0.25, 0.25), -1, cv2.LINE_AA)
        for ring in range(2, radius, max(radius // 4, 2)):
            cv2.circle(image, at, ring, (0.45, 0.44, 0.42), 1, cv2.LINE_AA)
    for _ in range(int(size / px_per_m * 2)):
        corner = rng.uniform(0, size, 2)
        points = corner + rng.normal(0, 0.45 * px_per_m, (int(rng.integers(3, 9)), 2))
        colour = tuple(float(c) for c in 0.25 + 0.7 * pick(rng, POSTERS))
        cv2.polylines(image, [points.astype(np.int32)], False, colour, 2, cv2.LINE_AA)


def leaves(image: np.ndarray, px_per_m: float, rng: np.random.Generator, count: int) -> None:
    colours = np.array(
        [(0.72, 0.38, 0.12), (0.80, 0.62, 0.16), (0.46, 0.50, 0.18), (0.42, 0.2, 0.1)]
    )
    shades = colours[rng.integers(4, size=count)] * rng.uniform(0.7, 1.2, (count, 1))
    half_axes_px = px_per_m * rng.uniform((0.025, 0.015), (0.07, 0.035), (count, 2))
    ellipses(image, half_axes_px, np.clip(shades, 0, 0.95), rng)
