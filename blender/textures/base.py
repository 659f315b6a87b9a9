# SPDX-License-Identifier: GPL-3.0-or-later
"""What all pictures are made of: colours, smooth noise, and weather."""

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


def pick(rng: np.random.Generator, colours: tuple[Colour, ...]) -> np.ndarray:
    """One of the colours, slightly off."""
    colour = np.array(colours[int(rng.integers(len(colours)))])
    return np.clip(colour + rng.normal(0, 0.02, 3), 0.02, 0.98).astype(np.float32)


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
    total, power = np.zeros((height, width), np.float32), 0.0
    for octave in range(octaves):
        cell = max(coarsest / 2**octave, 1.0)
        grid = rng.standard_normal((int(height / cell) + 4, int(width / cell) + 4))
        size = (int(grid.shape[1] * cell), int(grid.shape[0] * cell))
        layer = cv2.resize(grid.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
        total += fall**octave * layer[:height, :width]
        power += fall ** (2 * octave)
    return total / np.float32(np.sqrt(power))


def weather(image: np.ndarray, rng: np.random.Generator, amount: float) -> np.ndarray:
    """Stains, grain and a dirty foot."""
    height, width = image.shape[:2]
    stains = noise(height, width, rng, max(height // 3, 8), 7, 0.75)
    return np.clip(image * (1 + amount * stains[..., None]), 0.02, 0.95).astype(np.float32)
