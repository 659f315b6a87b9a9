# SPDX-License-Identifier: GPL-3.0-or-later
"""A furnished room, closed on all sides, as large as the camera needs."""

import numpy as np

from blender.furniture import armchair, cabinet, plant, shelf, table
from blender.layout import Thing, Yard, darken_contacts, direction, is_free, surroundings
from blender.props import px, scatter
from blender.textures.indoors import ceiling, floor, wall
from blender.textures.props import barrel

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
    """Walls with pictures, shelves and furniture along them, parquet and carpets.

    Nothing stands within about a metre of the subject or the camera, or between them.

    Args:
        subject_world_m: (T, 3) pelvis path [m].
        camera_world_m: (T, 3) optical centres [m].
        rng: Chooses everything else.
    """
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
    darken_contacts(ground, things, centre, side_m)
    lamp_m = np.array([*centre, height_m - 0.45])
    return Yard(centre, side_m, ground, things, None, lamp_m)


def _walls(
    centre: np.ndarray, half: np.ndarray, height_m: float, rng: np.random.Generator
) -> list[Thing]:
    walls = []
    for side in range(4):
        yaw_rad = side * np.pi / 2
        out = direction(yaw_rad - np.pi / 2)
        length_m, depth_m = half if side % 2 == 0 else half[::-1]
        width_m = float(2 * length_m + 2 * WALL_THICK_M)
        place = centre + out * (depth_m + WALL_THICK_M / 2)
        walls.append(
            Thing(
                "box",
                np.array([*place, height_m / 2]),
                np.array([width_m, WALL_THICK_M, height_m]),
                yaw_rad,
                wall(width_m, height_m, WALL_PX_PER_M, rng),
                (width_m, height_m),
            )
        )
    return walls


def _shelves(
    centre: np.ndarray,
    half: np.ndarray,
    paths: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> list[Thing]:
    """Shelves with their backs to the walls, with gaps for the pictures."""
    shelves = []
    for side in range(4):
        yaw_rad = side * np.pi / 2
        along, out = direction(yaw_rad), direction(yaw_rad - np.pi / 2)
        length_m, depth_m = half if side % 2 == 0 else half[::-1]
        for s in np.arange(-length_m + 1.4, length_m - 1.2, SHELF_M + 0.15):
            place = centre + along * s + out * (depth_m - 0.19)
            if rng.random() < 0.4 and is_free(place, SHELF_M / 2 + 0.05, *paths):
                shelves.append(shelf(place, SHELF_M, yaw_rad, rng))
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
