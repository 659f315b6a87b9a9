# SPDX-License-Identifier: GPL-3.0-or-later
"""A street: a road with parked cars between pavements and houses, closed off at both ends."""

import numpy as np

from blender.places.car import car_things
from blender.places.layout import Thing, Yard, direction, is_free, surroundings, yard_of
from blender.places.props import crates, drum, houses_round, lamp, pillar, planter, scatter
from blender.textures.ground import sky
from blender.textures.road import road

WALL_MARGIN_M = 3.0
SMALLEST_HALF_SIDE_M = 6.5
PAVEMENT_M = 2.4
GROUND_PX = 2560
CAR_STEP_M = 5.2


def street(
    subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator
) -> Yard:
    """A street along the longer side of what the subject and the camera cover."""
    paths = subject_world_m[:, :2], camera_world_m[:, :2]
    centre, half = surroundings(*paths, WALL_MARGIN_M, SMALLEST_HALF_SIDE_M)
    along = int(half[1] > half[0])
    half[along] += 3.0
    yaw_rad = along * np.pi / 2
    road_m = 2 * float(half[1 - along] - PAVEMENT_M)
    houses = houses_round(centre, half, (6.0, 11.0), rng)
    cars = _cars(centre, float(half[along]), road_m, yaw_rad, paths, rng)
    makers = (lamp, lamp, planter, crates, drum, pillar)
    props = [
        thing
        for side in (-1, 1)
        for thing in scatter(
            makers, (0.3, 0.5), 9, _pavement(centre, half, along, side), paths, rng
        )
    ]
    things = (*houses, *cars, *props)
    side_m = float(2 * half.max() + 3.0)
    ground = np.ascontiguousarray(np.rot90(road(GROUND_PX, side_m, road_m, rng), along))
    return yard_of(centre, side_m, ground, things, sky(1024, 512, rng))


def _pavement(
    centre: np.ndarray, half: np.ndarray, along: int, side: int
) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half sides of one pavement [m]."""
    middle, extent = centre.copy(), half.copy()
    middle[1 - along] += side * (half[1 - along] - PAVEMENT_M / 2)
    extent[1 - along] = PAVEMENT_M / 2
    return middle, extent


def _cars(
    centre: np.ndarray,
    half_length_m: float,
    road_m: float,
    yaw_rad: float,
    paths: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> list[Thing]:
    """Cars along both kerbs, where they are in nobody's way."""
    ahead, aside = direction(yaw_rad), direction(yaw_rad + np.pi / 2)
    cars = []
    for side in (-1, 1):
        for s in np.arange(-half_length_m + 2.8, half_length_m - 2.4, CAR_STEP_M):
            place = (
                centre + ahead * (s + rng.uniform(-0.3, 0.3)) + aside * side * (road_m / 2 - 1.05)
            )
            parts = [place + ahead * offset_m for offset_m in (-1.4, 0.0, 1.4)]
            if all(is_free(part, 1.15, *paths) for part in parts) and rng.random() < 0.9:
                cars += car_things(place, yaw_rad + np.pi * int(rng.integers(2)), rng)
    return cars
