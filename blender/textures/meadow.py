# SPDX-License-Identifier: GPL-3.0-or-later
"""Grass with paths, hedges and bark."""

import cv2
import numpy as np

from blender.textures.base import Colour, ellipses, noise, pick, weather
from blender.textures.ground import leaves

FLOWERS: tuple[Colour, ...] = (
    (0.92, 0.90, 0.86), (0.93, 0.80, 0.20), (0.72, 0.36, 0.66), (0.88, 0.30, 0.26),
)  # fmt: skip


def meadow(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Tufts and blades of grass, flowers, and two gravel paths that cross."""
    px_per_m = size_px / metres
    lush = noise(size_px, size_px, rng, int(4 * px_per_m), 8, 0.8)[..., None]
    image = np.array([0.30, 0.41, 0.15], np.float32) * (1 + 0.2 * lush)
    image += np.array([0.07, 0.02, 0.0], np.float32) * np.clip(-lush, 0, 2)
    _blades(image, px_per_m, rng, count=int(55 * metres**2))
    _flowers(image, px_per_m, rng, patches=int(0.12 * metres**2))
    _paths(image, px_per_m, rng)
    leaves(image, px_per_m, rng, count=int(3.5 * metres**2))
    return np.clip(image, 0.02, 0.95).astype(np.float32)


def _blades(image: np.ndarray, px_per_m: float, rng: np.random.Generator, count: int) -> None:
    starts = rng.uniform(0, len(image), (count, 2))
    ends = (starts + rng.normal(0, 0.055 * px_per_m, (count, 2))).astype(int).tolist()
    greens = (np.array([0.36, 0.50, 0.18]) * rng.uniform(0.35, 1.45, (count, 1))).tolist()
    for start, end, green in zip(starts.astype(int).tolist(), ends, greens, strict=True):
        cv2.line(image, start, end, green, 1, cv2.LINE_AA)


def _flowers(image: np.ndarray, px_per_m: float, rng: np.random.Generator, patches: int) -> None:
    for _ in range(patches):
        middle, spread_m = rng.uniform(0, len(image), 2), rng.uniform(0.15, 0.7)
        colour = tuple(float(c) for c in pick(rng, FLOWERS))
        for at in middle + rng.normal(0, spread_m * px_per_m, (int(rng.integers(4, 22)), 2)):
            radius = max(int(rng.uniform(0.012, 0.035) * px_per_m), 1)
            cv2.circle(image, tuple(int(v) for v in at), radius, colour, -1, cv2.LINE_AA)


def _paths(image: np.ndarray, px_per_m: float, rng: np.random.Generator) -> None:
    """Two winding bands of gravel with ragged edges."""
    size = len(image)
    along = np.arange(size) / size
    distance = np.full((size, size), np.inf, np.float32)
    for vertical in (False, True):
        bend = sum(rng.normal(0, 0.035) * np.sin(2 * np.pi * k * along + k) for k in (1, 2, 3))
        middle = ((0.5 + rng.uniform(-0.08, 0.08) + bend) * size).astype(np.float32)
        gap = np.abs(np.arange(size, dtype=np.float32)[:, None] - middle[None])
        distance = np.minimum(distance, gap.T if vertical else gap)
    ragged = distance / px_per_m + 0.09 * noise(size, size, rng, int(0.6 * px_per_m), 5, 0.8)
    stones = cv2.GaussianBlur(rng.standard_normal((size, size)).astype(np.float32), (0, 0), 1.0)
    stones = 0.75 * stones + 0.11 * noise(size, size, rng, int(1.5 * px_per_m), 6, 0.9)
    gravel = np.array([0.60, 0.53, 0.42], np.float32) * (1 + 0.5 * stones[..., None])
    share = np.clip((0.9 - ragged) / 0.1, 0, 1)[..., None]
    image += share * (gravel - image)


def hedge(width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator) -> np.ndarray:
    """Clipped leaves over leaves, with twigs and blossoms between."""
    height, width = int(height_m * px_per_m), int(width_m * px_per_m)
    image = np.empty((height, width, 3), np.float32)
    image[:] = (0.07, 0.10, 0.05)
    count = int(420 * width_m * height_m)
    tint = pick(rng, ((0.26, 0.44, 0.14), (0.34, 0.46, 0.16), (0.22, 0.38, 0.20)))
    blossom = pick(rng, FLOWERS)
    lighter = np.linspace(0.4, 1.3, count)[:, None]
    shades = np.clip(tint * lighter * rng.uniform(0.65, 1.35, (count, 1)), 0, 0.9)
    shades[rng.random(count) < 0.02] = blossom
    half_axes_px = px_per_m * rng.uniform((0.025, 0.015), (0.07, 0.035), (count, 2))
    ellipses(image, half_axes_px, shades, rng)
    return weather(image, rng, 0.12)


def bark(rng: np.random.Generator) -> np.ndarray:
    """Furrows up a trunk, with lichen."""
    height, width = 512, 192
    tall = noise(64, width, rng, 24, 5, 0.9)
    furrows = cv2.resize(tall, (width, height), interpolation=cv2.INTER_CUBIC)
    image = np.array([0.36, 0.28, 0.20], np.float32) * (1 + 0.4 * furrows[..., None])
    lichen = noise(height, width, rng, 60, 6, 0.8) > 1.0
    image[lichen] = (0.52, 0.54, 0.36)
    return weather(image, rng, 0.12)
