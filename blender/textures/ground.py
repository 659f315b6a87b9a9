# SPDX-License-Identifier: GPL-3.0-or-later
"""Grass with paths, hedges and bark.

The sky.

What one walks on outdoors.
"""

import cv2
import numpy as np

from blender.textures.base import POSTERS, Colour, blocks, clipped, ellipses, noise, pick, weather


def sky(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """An equirectangular sky with clouds, row 0 at the zenith and the last row at the nadir."""
    up = np.linspace(1, -1, height_px)[:, None]
    blue = np.array([0.30, 0.52, 0.82]) * np.clip(up, 0, 1) ** 0.5
    haze = np.array([0.80, 0.86, 0.92]) * (1 - np.clip(up, 0, 1) ** 0.5)
    half = noise(height_px, width_px // 2, rng, height_px // 5, 7, 0.6)
    clouds = np.clip(np.concatenate([half, half[:, ::-1]], axis=1) * 0.5 - 0.1, 0, 0.85)
    clear = blue + haze
    channels = [clear[:, c, None] * (1 - clouds) + 0.95 * clouds for c in range(3)]
    return np.stack(channels, axis=-1, dtype=np.float32, casting="same_kind")


JOINTS = (0.22, 0.20, 0.18)
"""Colour between flagstones."""


def paving(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Flagstones in rows of changing width, with leaves, stains and painted marks."""
    px_per_m = size_px / metres
    image = np.full((size_px, size_px, 3), JOINTS, np.float32)
    y = 0.0
    joint = max(0.014 * px_per_m, 1)
    while y < size_px:
        row = rng.uniform(0.32, 0.62) * px_per_m
        x = -rng.uniform(0, 0.8) * px_per_m
        line = np.full((size_px, 3), JOINTS, np.float32)
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


FLOWERS: tuple[Colour, ...] = (
    (0.92, 0.90, 0.86), (0.93, 0.80, 0.20), (0.72, 0.36, 0.66), (0.88, 0.30, 0.26),
)  # fmt: skip


def meadow(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Tufts and blades of grass, flowers, and two gravel paths that cross."""
    px_per_m = size_px / metres
    lush = noise(size_px, size_px, rng, int(4 * px_per_m), 8, 0.8)
    image = np.empty((size_px, size_px, 3), np.float32)
    for rows in blocks(size_px):
        green, dry = 1 + 0.2 * lush[rows], np.minimum(np.maximum(-lush[rows], 0), 2)
        for channel, (grass, straw) in enumerate(((0.30, 0.07), (0.41, 0.02), (0.15, 0.0))):
            image[rows, :, channel] = np.float32(grass) * green + np.float32(straw) * dry
    _blades(image, px_per_m, rng, count=int(55 * metres**2))
    _flowers(image, px_per_m, rng, patches=int(0.12 * metres**2))
    _paths(image, px_per_m, rng)
    leaves(image, px_per_m, rng, count=int(3.5 * metres**2))
    return clipped(image)


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
    along, px = np.arange(size) / size, np.arange(size, dtype=np.float32)
    middles = []
    for _ in range(2):
        bend = sum(rng.normal(0, 0.035) * np.sin(2 * np.pi * k * along + k) for k in (1, 2, 3))
        bend = np.asarray(bend)
        middles.append(((0.5 + rng.uniform(-0.08, 0.08) + bend) * size).astype(np.float32))
    edge = noise(size, size, rng, int(0.6 * px_per_m), 5, 0.8)
    stones = np.empty((size, size), np.float32)
    for rows in blocks(size):
        stones[rows] = rng.standard_normal(stones[rows].shape)
    cv2.GaussianBlur(stones, (0, 0), 1.0, dst=stones)
    coarse = noise(size, size, rng, int(1.5 * px_per_m), 6, 0.9)
    for rows in blocks(size):
        gaps = np.abs(px[rows, None] - middles[0]), np.abs(px - middles[1][rows, None])
        ragged = np.minimum(*gaps) / px_per_m + 0.09 * edge[rows]
        share = np.clip((0.9 - ragged) / 0.1, 0, 1)
        there = share > 0
        light = 1 + 0.5 * (0.75 * stones[rows][there] + 0.11 * coarse[rows][there])
        gravel = np.array([0.60, 0.53, 0.42], np.float32) * light[:, None]
        grass = image[rows][there]
        image[rows][there] = grass + share[there][:, None] * (gravel - grass)


def hedge(width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator) -> np.ndarray:
    """Clipped leaves over leaves, with twigs and blossoms between."""
    height, width = int(height_m * px_per_m), int(width_m * px_per_m)
    image = np.full((height, width, 3), (0.07, 0.10, 0.05), np.float32)
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
