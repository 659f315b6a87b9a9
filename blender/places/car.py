# SPDX-License-Identifier: GPL-3.0-or-later
"""A car: the things it is made of, and where their vertices are as it drives."""

import numpy as np

from blender.places.layout import Thing, direction
from blender.textures.road import car_body, car_roof, car_windows, random_paint, tyre
from gmrdata.film.walkers import WHEEL_RADIUS_M, Drive

CAR_M = np.array([4.1, 1.75, 0.62])
"""Length, width and height of the body's lower part [m]."""


def car_things(place: np.ndarray, yaw_rad: float, rng: np.random.Generator) -> list[Thing]:
    """The parts of a car on the ground.

    Args:
        place: (2,) its middle [m].
        yaw_rad: Where it points [rad].
        rng: Chooses its paint, its length of cabin and its dirt.
    """
    paint = random_paint(rng)
    ahead, aside = direction(yaw_rad), direction(yaw_rad + np.pi / 2)
    width_m = CAR_M[1] - 0.1

    def box(solid: str, x_m: float, low_m: float, size_m: np.ndarray, picture: np.ndarray) -> Thing:
        centre_m = np.array([*(place + ahead * x_m), low_m + size_m[2] / 2])
        return Thing(solid, centre_m, size_m, yaw_rad, picture, None)  # type: ignore[arg-type]

    long_m = float(rng.uniform(2.0, 2.7))
    parts = [
        box("box", 0.0, 0.26, CAR_M, car_body(paint, rng)),
        box("taper", -0.25, 0.88, np.array([long_m, width_m, 0.54]), car_windows(paint, rng)),
        box(
            "box",
            -0.25,
            1.40,
            np.array([long_m * 0.69, width_m * 0.86, 0.05]),
            car_roof(paint, rng),
        ),
        box("box", 0.0, 0.87, CAR_M * [0.98, 0.94, 0.05], car_roof(paint, rng)),
    ]
    rubber = tyre(rng)
    wide_m = 2 * WHEEL_RADIUS_M
    for x_m in (-1.25, 1.25):
        for y_m in (-0.8, 0.8):
            spot = place + ahead * x_m + aside * y_m
            size_m = np.array([wide_m, 0.22, wide_m])
            centre_m = np.array([*spot, WHEEL_RADIUS_M])
            parts.append(Thing("wheel", centre_m, size_m, yaw_rad, rubber, None))
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
