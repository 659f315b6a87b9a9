# SPDX-License-Identifier: GPL-3.0-or-later
"""Small things that stand about outdoors.

Rows of houses that close a place off.
"""

from collections.abc import Callable

import numpy as np

from blender.places.layout import Thing, direction, four_sides, is_free, upright
from blender.textures.fronts import facade, posters
from blender.textures.ground import bark
from blender.textures.props import barrel, foliage, planks

CORNER_M = 1.0
"""How far each row of houses goes on behind the next row: more than the houses stand back."""
WALL_PX_PER_M = 90.0


def houses_round(
    centre: np.ndarray, half: np.ndarray, heights_m: tuple[float, float], rng: np.random.Generator
) -> list[Thing]:
    """Houses of different width, height and depth along the four sides of a rectangle.

    No front stands nearer than the half sides (2,) [m]; `heights_m`: lowest and highest house.
    """
    houses = []
    for side in four_sides(centre, half):
        end = side.half_length_m + CORNER_M
        start = -end
        while start < end - 0.3:
            width_m = float(min(rng.uniform(2.8, 4.8), end - start))
            height_m = float(rng.uniform(*heights_m))
            step_m = float(rng.uniform(0.0, 0.7))
            place = side.at(start + width_m / 2, side.depth_m + step_m + 1.0)
            size_m = (width_m, 2.0, height_m)
            front = facade(width_m, height_m, WALL_PX_PER_M, rng)
            houses.append(upright("box", place, size_m, side.yaw_rad, front, round_each_face=False))
            start += width_m
    return houses


PROP_PX_PER_M = 200.0
Maker = Callable[[np.ndarray, float, np.random.Generator], list[Thing]]
"""Makes the parts of a thing, from the place (2,) and the radius of the disc it may fill [m]."""


def scatter(
    makers: tuple[Maker, ...],
    radii_m: tuple[float, float],
    most: int,
    ground: tuple[np.ndarray, np.ndarray],
    paths: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> list[Thing]:
    """Things on discs that are free and don't touch, more of them near the walls.

    Args:
        makers: Each is as likely as the others; name one twice to see it twice as often.
        radii_m: Smallest and largest radius of a disc [m].
        most: Number of discs at which to stop.
        ground: Centre (2,) and half sides (2,) of the rectangle to fill [m].
        paths: Subject and camera, (T, 2) each [m].
        rng: Chooses.
    """
    centre, half = ground
    things: list[Thing] = []
    taken: list[tuple[np.ndarray, float]] = []
    for attempt in range(400):
        if len(taken) >= most:
            break
        make = makers[int(rng.integers(len(makers)))]
        radius_m = float(rng.uniform(*radii_m))
        place = centre + rng.uniform(-1, 1, 2) * (half - radius_m - 0.1)
        near_wall = bool(np.any(np.abs(place - centre) > half - 1.6))
        if attempt % 2 and not near_wall:
            continue
        clear_of_others = all(
            np.linalg.norm(place - other) > radius_m + other_m + 0.25 for other, other_m in taken
        )
        if clear_of_others and is_free(place, radius_m, *paths):
            taken.append((place, radius_m))
            things += make(place, radius_m, rng)
    return things


def px(size_m: float) -> int:
    """Pixels of a picture for a length."""
    return max(int(size_m * PROP_PX_PER_M), 16)


def crates(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """One to three crates, the upper ones smaller and turned."""
    pile, top_m, side_m = [], 0.0, radius_m * 1.35
    for _ in range(int(rng.integers(1, 4))):
        size = np.array([side_m, side_m, side_m * rng.uniform(0.7, 1.0)])
        centre = np.array([*place, top_m + size[2] / 2])
        picture = planks(px(side_m), px(size[2]), rng)
        pile.append(Thing("box", centre, size, rng.uniform(0, np.pi), picture, None))
        top_m, side_m = top_m + size[2], side_m * rng.uniform(0.7, 0.95)
    return pile


def drum(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A painted drum."""
    width_m, height_m = min(1.4 * radius_m, 0.62), float(rng.uniform(0.8, 1.0))
    picture = barrel(px(np.pi * width_m), px(height_m), rng)
    size_m = (width_m, width_m, height_m)
    return [upright("cylinder", place, size_m, rng.uniform(0, np.pi), picture)]


def pillar(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """An advertising pillar with a cap."""
    width_m, height_m = 1.3 * radius_m, float(rng.uniform(2.2, 3.0))
    picture = posters(px(np.pi * width_m), px(height_m), rng)
    size_m = (width_m, width_m, height_m)
    body = upright("cylinder", place, size_m, rng.uniform(0, np.pi), picture)
    cap_m = np.array([width_m * 1.25, width_m * 1.25, 0.22])
    cap = barrel(px(np.pi * width_m), 64, rng)
    return [body, Thing("cylinder", np.array([*place, height_m + 0.11]), cap_m, 0.0, cap, None)]


def planter(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A wooden tub with a bush."""
    width_m, height_m = 1.35 * radius_m, float(rng.uniform(0.4, 0.6))
    yaw_rad = rng.uniform(0, np.pi)
    wood = planks(px(width_m), px(height_m), rng)
    box = upright("box", place, (width_m, width_m, height_m), yaw_rad, wood)
    bush_m = np.array([1.2 * width_m, 1.2 * width_m, rng.uniform(0.7, 1.1)])
    centre = np.array([*place, height_m + 0.35 * bush_m[2]])
    return [box, Thing("blob", centre, bush_m, yaw_rad, foliage(256, rng), None)]


def tree(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A small tree."""
    trunk_m = float(rng.uniform(2.0, 2.6))
    bark = planks(96, 384, rng)[:, :, :] * 0.6
    parts = [upright("cylinder", place, (0.2, 0.2, trunk_m), 0.0, bark)]
    for _ in range(3):
        size = rng.uniform(1.0, 1.7) * np.array([1.0, 1.0, 0.8])
        centre = np.array([*place, trunk_m + 0.3]) + rng.normal(0, 0.32, 3)
        yaw_rad = rng.uniform(0, np.pi)
        parts.append(Thing("blob", centre, size, yaw_rad, foliage(384, rng), None))
    return parts


def tall_tree(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A tree whose crown stays on its disc below twice a person's height."""
    trunk_m, width_m = float(rng.uniform(2.6, 3.6)), 0.3 * radius_m
    parts = [upright("cylinder", place, (width_m, width_m, trunk_m), 0.0, bark(rng))]
    for _ in range(5):
        size_m = rng.uniform(1.0, 1.5) * radius_m * np.array([1.0, 1.0, 0.8])
        centre_m = np.array([*place, trunk_m + 0.5]) + rng.normal(0, 1, 3) * radius_m * [
            0.3,
            0.3,
            0.4,
        ]
        yaw_rad = rng.uniform(0, np.pi)
        parts.append(Thing("blob", centre_m, size_m, yaw_rad, foliage(512, rng), None))
    return parts


def bush(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """Two round bushes grown together."""
    size_m = radius_m * np.array([1.5, 1.5, 1.7])
    return [
        Thing(
            "blob",
            np.array([*(place + rng.normal(0, 0.12, 2)), 0.35 * size_m[2]]),
            size_m * rng.uniform(0.7, 1.0),
            rng.uniform(0, np.pi),
            foliage(384, rng),
            None,
        )
        for _ in range(2)
    ]


def bench(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A wooden bench: legs, seat and back."""
    yaw_rad, width_m = float(rng.uniform(0, 2 * np.pi)), 1.7 * radius_m
    ahead, aside = direction(yaw_rad), direction(yaw_rad + np.pi / 2)
    slats = planks(px(width_m), px(0.45), rng)
    seat_m, back_m = np.array([width_m, 0.45, 0.06]), np.array([width_m, 0.06, 0.42])
    leg_m = np.array([0.08, 0.4, 0.42])
    parts = [
        Thing("box", np.array([*place, 0.45]), seat_m, yaw_rad, slats, None),
        Thing("box", np.array([*(place + 0.2 * aside), 0.72]), back_m, yaw_rad, slats, None),
    ]
    for side in (-0.4, 0.4):
        spot = place + side * width_m * ahead
        parts.append(Thing("box", np.array([*spot, 0.21]), leg_m, yaw_rad, slats, None))
    return parts


def lamp(place: np.ndarray, radius_m: float, rng: np.random.Generator) -> list[Thing]:
    """A street lamp: a base with a sticker, a post and a lantern."""
    height_m = float(rng.uniform(3.2, 4.0))
    iron = barrel(px(0.4), px(1.0), rng) * np.float32(0.5)
    glass = barrel(96, 64, rng)
    sizes_m = ((0.3, 0.3, 0.7), (0.12, 0.12, height_m), (0.42, 0.42, 0.06))
    middles_m = (0.35, height_m / 2, height_m + 0.42)
    parts = [
        Thing("cylinder", np.array([*place, z_m]), np.array(size_m), 0.0, iron, None)
        for z_m, size_m in zip(middles_m, sizes_m, strict=True)
    ]
    lantern_m = np.array([0.34, 0.34, 0.4])
    parts.append(Thing("cylinder", np.array([*place, height_m + 0.2]), lantern_m, 0.0, glass, None))
    return parts
