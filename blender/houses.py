# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of houses that close a place off."""

import numpy as np

from blender.layout import Thing, direction
from blender.textures.fronts import facade

CORNER_M = 1.0
"""How far each row of houses goes on behind the next row: more than the houses stand back."""
WALL_PX_PER_M = 90.0


def houses_round(
    centre: np.ndarray, half: np.ndarray, heights_m: tuple[float, float], rng: np.random.Generator
) -> list[Thing]:
    """Houses of different width, height and depth along the four sides of a rectangle.

    Args:
        centre: (2,) middle of the rectangle [m].
        half: (2,) half sides; no front stands nearer [m].
        heights_m: Lowest and highest house [m].
        rng: Chooses.
    """
    houses = []
    for side in range(4):
        yaw_rad = side * np.pi / 2
        along, out = direction(yaw_rad), direction(yaw_rad - np.pi / 2)
        length, depth = (half[0], half[1]) if side % 2 == 0 else (half[1], half[0])
        end = float(length) + CORNER_M
        start = -end
        while start < end - 0.3:
            width_m = float(min(rng.uniform(2.8, 4.8), end - start))
            height_m = float(rng.uniform(*heights_m))
            step_m = float(rng.uniform(0.0, 0.7))
            middle = centre + along * (start + width_m / 2) + out * (depth + step_m + 1.0)
            houses.append(
                Thing(
                    "box",
                    np.array([*middle, height_m / 2]),
                    np.array([width_m, 2.0, height_m]),
                    yaw_rad,
                    facade(width_m, height_m, WALL_PX_PER_M, rng),
                    (width_m, height_m),
                )
            )
            start += width_m
    return houses
