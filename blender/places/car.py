# SPDX-License-Identifier: GPL-3.0-or-later
"""A car: the things it is made of, and where their vertices are as it drives."""

from functools import partial

import numpy as np

from blender.places.layout import Thing, part_of
from blender.textures.road import car_body, car_roof, car_windows, random_paint, tyre
from gmrdata.film.walkers import WHEEL_RADIUS_M, Drive

CAR_M = (4.1, 1.75, 0.62)
"""Length, width and height of the body's lower part [m]."""


def car_things(place: np.ndarray, yaw_rad: float, rng: np.random.Generator) -> list[Thing]:
    """The parts of a car on the ground.

    Args:
        place: (2,) its middle [m].
        yaw_rad: Where it points [rad].
        rng: Chooses its paint, its length of cabin and its dirt.
    """
    paint = random_paint(rng)
    long_m, width_m = float(rng.uniform(2.0, 2.7)), CAR_M[1] - 0.1
    roof_m = (long_m * 0.69, width_m * 0.86, 0.05)
    rim_m = (CAR_M[0] * 0.98, CAR_M[1] * 0.94, CAR_M[2] * 0.05)
    at = partial(part_of, place, yaw_rad)
    parts = [
        at((0.0, 0.0, 0.26), CAR_M, car_body(paint, rng)),
        at((-0.25, 0.0, 0.88), (long_m, width_m, 0.54), car_windows(paint, rng), "taper"),
        at((-0.25, 0.0, 1.40), roof_m, car_roof(paint, rng)),
        at((0.0, 0.0, 0.87), rim_m, car_roof(paint, rng)),
    ]
    rubber, wide_m = tyre(rng), 2 * WHEEL_RADIUS_M
    parts += [
        at((x_m, y_m, 0.0), (wide_m, 0.22, wide_m), rubber, "wheel")
        for x_m in (-1.25, 1.25)
        for y_m in (-0.8, 0.8)
    ]
    return parts


def moved_vertices_m(
    rest_m: np.ndarray, wheels: list[tuple[slice, np.ndarray]], drive: Drive
) -> np.ndarray:
    """(T, V, 3) vertices of a car on its way, world [m].

    Args:
        rest_m: (V, 3) in the car's frame.
        wheels: Which of them each wheel has, and its centre (3,) in the car's frame.
        drive: The way.
    """
    car_m = np.tile(rest_m, (len(drive.driven_m), 1, 1))
    angles_rad = drive.driven_m / WHEEL_RADIUS_M
    cos, sin, zero = np.cos(angles_rad), np.sin(angles_rad), np.zeros_like(angles_rad)
    # About the axle, y: what is on top goes ahead.
    turns = np.stack(
        [
            np.stack([cos, zero, sin], axis=-1),
            np.stack([zero, zero + 1, zero], axis=-1),
            np.stack([-sin, zero, cos], axis=-1),
        ],
        axis=-2,
    )
    for vertices, centre_m in wheels:
        around_m = rest_m[vertices] - centre_m
        car_m[:, vertices] = np.einsum("tij,vj->tvi", turns, around_m) + centre_m
    pose = drive.world_from_car
    return np.einsum("tij,tvj->tvi", pose[:, :3, :3], car_m) + pose[:, None, :3, 3]
