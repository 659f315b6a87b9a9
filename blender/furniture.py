# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture, from boxes and cylinders."""

import numpy as np

from blender.layout import Thing, direction
from blender.props import px
from blender.textures.indoors import board, books, cloth
from blender.textures.props import foliage


def shelf(place: np.ndarray, width_m: float, yaw_rad: float, rng: np.random.Generator) -> Thing:
    """A shelf full of books.

    Args:
        place: (2,) middle of its foot [m].
        width_m: Width [m]; it is 0.34 m deep.
        yaw_rad: Turn from standing along x [rad].
        rng: Chooses height and books.
    """
    height_m = float(rng.uniform(1.1, 2.1))
    picture = books(px(width_m), px(height_m), rng)
    size_m = np.array([width_m, 0.34, height_m])
    return Thing("box", np.array([*place, height_m / 2]), size_m, yaw_rad, picture, None)


def _box(
    place: np.ndarray,
    yaw_rad: float,
    offset_m: tuple[float, float, float],
    size_m: tuple[float, float, float],
    picture: np.ndarray,
) -> Thing:
    """A box whose foot's middle is offset along the furniture's own x, y, and z."""
    ahead, aside = direction(yaw_rad), direction(yaw_rad + np.pi / 2)
    middle = place + ahead * offset_m[0] + aside * offset_m[1]
    centre_m = np.array([*middle, offset_m[2] + size_m[2] / 2])
    return Thing("box", centre_m, np.array(size_m), yaw_rad, picture, None)


def table(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A table on four legs with a few books on it."""
    yaw_rad, side_m, height_m = float(rng.uniform(0, np.pi)), 1.3 * radius_m, 0.72
    wood = board(px(side_m), px(side_m), rng)
    parts = [_box(place, yaw_rad, (0, 0, height_m), (side_m, side_m, 0.05), wood)]
    foot_m = side_m / 2 - 0.06
    for x_m, y_m in ((-foot_m, -foot_m), (foot_m, -foot_m), (foot_m, foot_m), (-foot_m, foot_m)):
        parts.append(_box(place, yaw_rad, (x_m, y_m, 0.0), (0.07, 0.07, height_m), wood))
    pile = books(120, 80, rng)
    parts.append(_box(place, yaw_rad + 0.5, (0.05, 0.0, height_m + 0.05), (0.3, 0.22, 0.18), pile))
    return parts


def armchair(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """An upholstered chair: seat, back and two arms."""
    yaw_rad, side_m = float(rng.uniform(-np.pi, np.pi)), 1.3 * radius_m
    stuff = cloth(px(side_m), px(0.6), rng)
    return [
        _box(place, yaw_rad, (0, 0, 0.05), (side_m, 0.98 * side_m, 0.38), stuff),
        _box(place, yaw_rad, (-0.42 * side_m, 0, 0.05), (0.16 * side_m, side_m, 0.9), stuff),
        _box(
            place, yaw_rad, (0.02, -0.43 * side_m, 0.05), (0.9 * side_m, 0.15 * side_m, 0.58), stuff
        ),
        _box(
            place, yaw_rad, (0.02, 0.43 * side_m, 0.05), (0.9 * side_m, 0.15 * side_m, 0.58), stuff
        ),
    ]


def cabinet(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A low chest, open in front and full of books."""
    yaw_rad, side_m, height_m = float(rng.uniform(0, np.pi)), 1.3 * radius_m, 0.8
    inside, wood = books(px(side_m), px(height_m), rng), board(px(side_m), px(side_m), rng)
    return [
        _box(place, yaw_rad, (0, 0, 0), (side_m, 0.6 * side_m, height_m), inside),
        _box(place, yaw_rad, (0, 0, height_m), (1.04 * side_m, 0.66 * side_m, 0.04), wood),
    ]


def plant(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A bush in a pot."""
    width_m, leaves_m = 0.8 * radius_m, float(rng.uniform(0.8, 1.2))
    pot = cloth(px(np.pi * width_m), px(0.4), rng)
    size_m, bush_m = np.array([width_m, width_m, 0.4]), np.array([radius_m, radius_m, leaves_m])
    centre_m = np.array([*place, 0.4 + 0.4 * leaves_m])
    return [
        Thing("cylinder", np.array([*place, 0.2]), size_m, 0.0, pot, None),
        Thing("blob", centre_m, bush_m, 0.0, foliage(256, rng), None),
    ]
