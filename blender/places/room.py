# SPDX-License-Identifier: GPL-3.0-or-later
"""A furnished room, closed on all sides, as large as the camera needs.

Furniture, from boxes and cylinders.
"""

import numpy as np

from blender.places.layout import (
    Thing,
    Yard,
    four_sides,
    is_free,
    part_of,
    surroundings,
    upright,
    yard_of,
)
from blender.places.props import px, scatter
from blender.textures.indoors import board, books, ceiling, cloth, floor, wall
from blender.textures.props import barrel, foliage


def shelf(place: np.ndarray, width_m: float, yaw_rad: float, rng: np.random.Generator) -> Thing:
    """A shelf full of books, 0.34 m deep, at a place (2,), turned from standing along x."""
    height_m = float(rng.uniform(1.1, 2.1))
    picture = books(px(width_m), px(height_m), rng)
    return upright("box", place, (width_m, 0.34, height_m), yaw_rad, picture)


def table(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A table on four legs with a few books on it."""
    yaw_rad, side_m, height_m = float(rng.uniform(0, np.pi)), 1.3 * radius_m, 0.72
    wood = board(px(side_m), px(side_m), rng)
    parts = [part_of(place, yaw_rad, (0, 0, height_m), (side_m, side_m, 0.05), wood)]
    foot_m = side_m / 2 - 0.06
    for x_m, y_m in ((-foot_m, -foot_m), (foot_m, -foot_m), (foot_m, foot_m), (-foot_m, foot_m)):
        parts.append(part_of(place, yaw_rad, (x_m, y_m, 0.0), (0.07, 0.07, height_m), wood))
    pile = books(120, 80, rng)
    parts.append(
        part_of(place, yaw_rad + 0.5, (0.05, 0.0, height_m + 0.05), (0.3, 0.22, 0.18), pile)
    )
    return parts


def armchair(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """An upholstered chair: seat, back and two arms."""
    yaw_rad, side_m = float(rng.uniform(-np.pi, np.pi)), 1.3 * radius_m
    stuff = cloth(px(side_m), px(0.6), rng)
    aside_m, arm_m = 0.43 * side_m, (0.9 * side_m, 0.15 * side_m, 0.58)
    return [
        part_of(place, yaw_rad, (0, 0, 0.05), (side_m, 0.98 * side_m, 0.38), stuff),
        part_of(place, yaw_rad, (-0.42 * side_m, 0, 0.05), (0.16 * side_m, side_m, 0.9), stuff),
        *(part_of(place, yaw_rad, (0.02, y_m, 0.05), arm_m, stuff) for y_m in (-aside_m, aside_m)),
    ]


def cabinet(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A low chest, open in front and full of books."""
    yaw_rad, side_m, height_m = float(rng.uniform(0, np.pi)), 1.3 * radius_m, 0.8
    inside, wood = books(px(side_m), px(height_m), rng), board(px(side_m), px(side_m), rng)
    return [
        part_of(place, yaw_rad, (0, 0, 0), (side_m, 0.6 * side_m, height_m), inside),
        part_of(place, yaw_rad, (0, 0, height_m), (1.04 * side_m, 0.66 * side_m, 0.04), wood),
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


WALL_MARGIN_M = 1.8
SMALLEST_HALF_SIDE_M = 4.0
LOWEST_CEILING_M = 3.2
HEADROOM_M = 1.2
"""From the camera, or the subject's pelvis, to the ceiling at least [m]."""
WALL_THICK_M = 0.3
WALL_PX_PER_M = 130.0
FLOOR_PX = 2560
SHELF_M = 1.3


def room(subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator) -> Yard:
    """Walls with pictures, shelves and furniture along them, parquet and carpets."""
    paths = subject_world_m[:, :2], camera_world_m[:, :2]
    centre, half = surroundings(*paths, WALL_MARGIN_M, SMALLEST_HALF_SIDE_M)
    top_m = max(subject_world_m[:, 2].max(), camera_world_m[:, 2].max()) + HEADROOM_M
    height_m = float(max(top_m, LOWEST_CEILING_M))
    side_m = float(2 * half.max() + 2 * WALL_THICK_M)
    furniture = [
        *_shelves(centre, half, paths, rng),
        *scatter(
            (armchair, cabinet, plant, table), (0.45, 0.75), 14, (centre, half - 0.8), paths, rng
        ),
    ]
    lid = np.array([side_m, side_m, 0.2])
    things = (
        *_walls(centre, half, height_m, rng),
        Thing(
            "box", np.array([*centre, height_m + 0.1]), lid, 0.0, ceiling(1536, side_m, rng), None
        ),
        _lampshade(centre, height_m, rng),
        *furniture,
    )
    ground = floor(FLOOR_PX, side_m, _carpets(side_m, rng), rng)
    lamp_m = np.array([*centre, height_m - 0.45])
    return yard_of(centre, side_m, ground, things, None, lamp_m)


def _walls(
    centre: np.ndarray, half: np.ndarray, height_m: float, rng: np.random.Generator
) -> list[Thing]:
    walls = []
    for side in four_sides(centre, half):
        width_m = 2 * side.half_length_m + 2 * WALL_THICK_M
        place = side.at(0.0, side.depth_m + WALL_THICK_M / 2)
        size_m = (width_m, WALL_THICK_M, height_m)
        picture = wall(width_m, height_m, WALL_PX_PER_M, rng)
        walls.append(upright("box", place, size_m, side.yaw_rad, picture, round_each_face=False))
    return walls


def _shelves(
    centre: np.ndarray,
    half: np.ndarray,
    paths: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> list[Thing]:
    """Shelves with their backs to the walls, with gaps for the pictures."""
    shelves = []
    for side in four_sides(centre, half):
        ends_m = -side.half_length_m + 1.4, side.half_length_m - 1.2
        for along_m in np.arange(*ends_m, SHELF_M + 0.15):
            place = side.at(along_m, side.depth_m - 0.19)
            if rng.random() < 0.4 and is_free(place, SHELF_M / 2 + 0.05, *paths):
                shelves.append(shelf(place, SHELF_M, side.yaw_rad, rng))
    return shelves


def _lampshade(centre: np.ndarray, height_m: float, rng: np.random.Generator) -> Thing:
    """The shade over the lamp; the lamp shines from just below it."""
    size_m = np.array([0.7, 0.7, 0.3])
    picture = barrel(px(2.2), px(0.3), rng)
    return Thing("cylinder", np.array([*centre, height_m - 0.2]), size_m, 0.0, picture, None)


def _carpets(side_m: float, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Carpets on a loose grid: x, y from the top left, width and height [m]."""
    carpets = []
    for x_m in np.arange(0.8, side_m - 2.0, 3.4):
        for y_m in np.arange(0.8, side_m - 2.0, 3.0):
            if rng.random() < 0.6:
                width_m, depth_m = rng.uniform((1.6, 1.3), (3.0, 2.6))
                carpets.append((float(x_m), float(y_m), float(width_m), float(depth_m)))
    return carpets
