# SPDX-License-Identifier: GPL-3.0-or-later
"""What all pictures are made of: colours, smooth noise, and weather."""

from collections.abc import Iterator

import cv2
import numpy as np

Colour = tuple[float, float, float]

PLASTERS: tuple[Colour, ...] = (
    (0.84, 0.68, 0.45), (0.76, 0.46, 0.34), (0.86, 0.80, 0.68), (0.55, 0.64, 0.66),
    (0.66, 0.68, 0.52), (0.80, 0.58, 0.50), (0.62, 0.57, 0.52),
)  # fmt: skip
POSTERS: tuple[Colour, ...] = (
    (0.82, 0.22, 0.16), (0.95, 0.78, 0.20), (0.14, 0.40, 0.60), (0.92, 0.90, 0.84),
    (0.16, 0.48, 0.36), (0.10, 0.10, 0.12), (0.90, 0.52, 0.18),
)  # fmt: skip
WOODS: tuple[Colour, ...] = ((0.62, 0.45, 0.27), (0.52, 0.34, 0.20), (0.70, 0.56, 0.38))
SHUTTERS: tuple[Colour, ...] = (
    (0.18, 0.36, 0.32), (0.20, 0.28, 0.42), (0.42, 0.18, 0.14), (0.86, 0.84, 0.80),
)  # fmt: skip
BLOCK = 64
"""Rows that are worked on at a time: fresh memory for all at once costs far more."""


def pick(rng: np.random.Generator, colours: tuple[Colour, ...]) -> np.ndarray:
    """One of the colours, slightly off."""
    colour = np.array(colours[int(rng.integers(len(colours)))])
    return np.clip(colour + rng.normal(0, 0.02, 3), 0.02, 0.98).astype(np.float32)


def blocks(height: int) -> Iterator[slice]:
    """The rows of an image, `BLOCK` at a time."""
    return (slice(top, top + BLOCK) for top in range(0, height, BLOCK))


def noise(
    height: int, width: int, rng: np.random.Generator, coarsest: int, octaves: int, fall: float
) -> np.ndarray:
    """(H, W) smooth noise of about unit variance: grids of random numbers, each twice as fine.

    Args:
        height: Rows.
        width: Columns.
        rng: Where the numbers come from.
        coarsest: Pixels per cell of the coarsest grid.
        octaves: Number of grids.
        fall: Amplitude of each grid relative to the coarser one before.
    """
    total, power = np.zeros((4, 4), np.float32), 0.0
    for octave in range(octaves):
        cell = max(coarsest / 2**octave, 1.0)
        size = (int(width / cell) + 4, int(height / cell) + 4)
        # Each grid is added to the coarser ones at its own size: only the last is a large one.
        coarser = cv2.resize(total, size, interpolation=cv2.INTER_CUBIC)
        layer = rng.standard_normal(size[::-1], dtype=np.float32)
        total = np.asarray(coarser + np.float32(fall**octave) * layer, np.float32)
        power += fall ** (2 * octave)
    full_px = int(size[0] * cell), int(size[1] * cell)
    full = np.asarray(cv2.resize(total, full_px, interpolation=cv2.INTER_CUBIC), np.float32)
    full *= np.float32(1 / np.sqrt(power))
    return full[:height, :width]


def by_channel(values: np.ndarray) -> np.ndarray:
    """(H, W) values as (H, W, 3): numpy is slow where it has to repeat one for three channels."""
    return np.asarray(cv2.merge((values, values, values)))


def ellipses(
    image: np.ndarray, half_axes_px: np.ndarray, colours: np.ndarray, rng: np.random.Generator
) -> None:
    """Draw N ellipses anywhere on an image and turned anyhow, one over the other.

    Args:
        image: (H, W, 3), changed in place.
        half_axes_px: (N, 2) [px].
        colours: (N, 3).
        rng: Chooses places and turns.
    """
    count, (height, width) = len(colours), image.shape[:2]
    places = rng.uniform((0, 0), (width, height), (count, 2)).astype(int).tolist()
    axes = np.maximum(half_axes_px, 1).astype(int).tolist()
    turns_deg = rng.uniform(0, 360, count).tolist()
    for place, pair, turn_deg, colour in zip(
        places, axes, turns_deg, colours.tolist(), strict=True
    ):
        cv2.ellipse(image, place, pair, turn_deg, 0, 360, colour, -1, cv2.LINE_AA)


def weather(image: np.ndarray, rng: np.random.Generator, amount: float) -> np.ndarray:
    """Stains, grain and a dirty foot, on the image itself."""
    height, width = image.shape[:2]
    stains = noise(height, width, rng, max(height // 3, 8), 7, 0.75)
    for rows in blocks(height):
        image[rows] *= by_channel(1 + np.float32(amount) * stains[rows])
    return clipped(image)


def clipped(image: np.ndarray) -> np.ndarray:
    """The image itself, nowhere quite black or white."""
    for rows in blocks(len(image)):  # numpy's clip takes three times as long
        np.maximum(image[rows], 0.02, out=image[rows])
        np.minimum(image[rows], 0.95, out=image[rows])
    return image
