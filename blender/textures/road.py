# SPDX-License-Identifier: GPL-3.0-or-later
"""A road between pavements, seen from above, and what parks on it."""

import cv2
import numpy as np

from blender.textures.base import Colour, by_channel, clipped, ellipses, noise, pick, weather
from blender.textures.ground import leaves, paving

CARS: tuple[Colour, ...] = (
    (0.62, 0.12, 0.10), (0.16, 0.28, 0.46), (0.74, 0.74, 0.72), (0.20, 0.38, 0.30),
    (0.82, 0.66, 0.26), (0.30, 0.31, 0.34),
)  # fmt: skip
WHITE = (0.84, 0.83, 0.79)


def road(size_px: int, metres: float, road_m: float, rng: np.random.Generator) -> np.ndarray:
    """A square with a road of a given width through its middle, from left to right."""
    px_per_m = size_px / metres
    image = paving(size_px, metres, rng)
    top, bottom = (int((metres / 2 + side * road_m / 2) * px_per_m) for side in (-1, 1))
    image[top:bottom] = _asphalt(bottom - top, size_px, px_per_m, rng)
    band = image[top:bottom]
    _paint(band, px_per_m, rng)
    kerb = max(int(0.16 * px_per_m), 2)
    for edge in (top - kerb, bottom):
        for x in np.arange(0, size_px, 1.0 * px_per_m):
            stone = image[edge : edge + kerb, int(x) : int(x + 0.97 * px_per_m)]
            stone[:] = rng.normal(0.66, 0.05) * (
                1 + 0.1 * rng.standard_normal((*stone.shape[:2], 1))
            )
    leaves(image, px_per_m, rng, count=int(1.5 * metres**2))
    return clipped(image)


def _asphalt(height: int, width: int, px_per_m: float, rng: np.random.Generator) -> np.ndarray:
    """Stones in tar, mended in patches, cracked and stained."""
    image = np.full((height, width, 3), (0.33, 0.33, 0.34), np.float32)
    for _ in range(int(width / px_per_m * 0.9)):
        size = rng.uniform((0.5, 0.4), (2.6, 1.5)) * px_per_m
        x, y = (int(v) for v in rng.uniform(-0.2, 1, 2) * (width, height))
        corners = (max(x, 0), max(y, 0)), (int(x + size[0]), int(y + size[1]))
        shade = float(rng.uniform(0.20, 0.42))
        cv2.rectangle(image, *corners, (shade, shade, shade * 1.03), -1)
        cv2.rectangle(image, *corners, (0.13, 0.13, 0.13), max(int(0.03 * px_per_m), 1))
    grain = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), 0.8)
    image *= by_channel(1 + 0.34 * grain + 0.10 * noise(height, width, rng, 160, 6, 0.8))
    for _ in range(int(width / px_per_m * 2.5)):
        steps = rng.normal(0, 0.12 * px_per_m, (30, 2)) + rng.normal(0, 0.07 * px_per_m, 2)
        line = rng.uniform(0, 1, 2) * (width, height) + np.cumsum(steps, axis=0)
        cv2.polylines(image, [line.astype(np.int32)], False, (0.12, 0.12, 0.12), 1, cv2.LINE_AA)
    count = int(3.0 * width * height / px_per_m**2)
    shades = np.repeat(rng.choice([0.14, 0.2, 0.5, 0.6], (count, 1)), 3, axis=1)
    ellipses(image, px_per_m * rng.uniform(0.015, 0.09, (count, 2)), shades, rng)
    return image


def _paint(band: np.ndarray, px_per_m: float, rng: np.random.Generator) -> None:
    """Worn lines: the middle, parking places along both sides, and a crossing."""
    height, width = band.shape[:2]
    paint = np.zeros((height, width), np.float32)
    half_line = max(int(0.06 * px_per_m), 1)
    for x in np.arange(0, width, 3.0 * px_per_m):
        paint[
            height // 2 - half_line : height // 2 + half_line, int(x) : int(x + 1.6 * px_per_m)
        ] = 1
    lane = int(2.05 * px_per_m)
    for y in (lane, height - lane):
        paint[y - half_line : y + half_line] = 1
    for x in np.arange(0, width, 5.2 * px_per_m).astype(int):
        paint[:lane, x : x + 2 * half_line] = 1
        paint[height - lane :, x : x + 2 * half_line] = 1
    start = int(rng.uniform(0.2, 0.7) * width)
    for y in np.arange(0.2, height / px_per_m, 1.0) * px_per_m:
        paint[int(y) : int(y + 0.5 * px_per_m), start : start + int(3.0 * px_per_m)] = 1
    worn = np.clip(0.75 - 0.55 * noise(height, width, rng, 60, 6, 0.85), 0, 1) * paint
    worn = by_channel(worn)
    band[:] = band * (1 - worn) + np.array(WHITE, np.float32) * worn


def car_body(paint: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Painted metal: doors, handles, lights at the ends, a bumper and road dirt."""
    height, width = 180, 960
    image = np.empty((height, width, 3), np.float32)
    image[:] = paint * (1.1 - 0.35 * np.linspace(0, 1, height)[:, None, None])
    for x in (0.24, 0.47, 0.72):
        image[: int(0.8 * height), int(x * width) : int(x * width) + 3] = paint * 0.35
    for x in (0.42, 0.67):
        image[30:42, int(x * width) : int(x * width) + 34] = 0.12
    image[88:100] = paint * 0.5
    image[145:] = 0.13
    for x, colour in ((0, (0.92, 0.9, 0.8)), (width - 50, (0.75, 0.10, 0.08))):
        image[22:70, x : x + 50] = colour
    image = weather(image, rng, 0.10)
    dirt = np.clip(
        noise(height, width, rng, 60, 6, 0.8) * 0.4 + np.linspace(-0.6, 0.7, height)[:, None],
        0,
        0.7,
    )
    return np.asarray(image * (1 - dirt[..., None]) + 0.36 * dirt[..., None], np.float32)


def car_windows(paint: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Dark glass that mirrors something, between painted posts."""
    height, width = 128, 640
    image = np.empty((height, width, 3), np.float32)
    shine = noise(height, width, rng, 90, 5, 0.7)[..., None] * np.array([0.8, 1.0, 1.2])
    image[:] = np.clip(0.20 + 0.10 * shine, 0.03, 0.7)
    for x in (0, width // 3, 2 * width // 3 - 10, width - 24):
        image[:, x : x + 24] = paint * 0.8
    image[:14] = paint
    return weather(image, rng, 0.05)


def car_roof(paint: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Painted metal under the sky."""
    image = np.full((160, 256, 3), paint, np.float32)
    return weather(image, rng, 0.12)


def tyre(rng: np.random.Generator) -> np.ndarray:
    """Rubber; its picture goes round the tread and, whole, over each side with the rim."""
    image = np.full((128, 128, 3), 0.08, np.float32)
    cv2.circle(image, (64, 64), 40, (0.55, 0.55, 0.57), -1, cv2.LINE_AA)
    for turn in np.arange(5) * 2 * np.pi / 5 + rng.uniform(0, 1):
        at = (64 + int(24 * np.cos(turn)), 64 + int(24 * np.sin(turn)))
        cv2.circle(image, at, 9, (0.1, 0.1, 0.1), -1, cv2.LINE_AA)
    return weather(image, rng, 0.1)


def random_paint(rng: np.random.Generator) -> np.ndarray:
    """A car's colour."""
    return pick(rng, CARS)
