# SPDX-License-Identifier: GPL-3.0-or-later
"""A park: grass and gravel between hedges, trees and benches, with houses further off."""

import numpy as np

from blender.places.layout import Thing, Yard, four_sides, surroundings, upright, yard_of
from blender.places.props import bench, bush, houses_round, lamp, planter, scatter, tall_tree
from blender.textures.ground import hedge, meadow, sky

HEDGE_MARGIN_M = 3.0
SMALLEST_HALF_SIDE_M = 7.0
HOUSES_BEHIND_M = 4.5
HEDGE_PX_PER_M = 110.0
GROUND_PX = 3072


def park(subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator) -> Yard:
    """A lawn with hedges on all four sides."""
    paths = subject_world_m[:, :2], camera_world_m[:, :2]
    centre, half = surroundings(*paths, HEDGE_MARGIN_M, SMALLEST_HALF_SIDE_M)
    things = (
        *_hedges(centre, half, rng),
        *houses_round(centre, half + HOUSES_BEHIND_M, (5.0, 11.0), rng),
        *scatter((tall_tree,), (0.9, 1.3), 9, (centre, half), paths, rng),
        *scatter((bench, bench, bush, lamp, planter), (0.4, 0.75), 16, (centre, half), paths, rng),
    )
    side_m = float(2 * (half.max() + HOUSES_BEHIND_M) + 3.0)
    ground = meadow(GROUND_PX, side_m, rng)
    return yard_of(centre, side_m, ground, things, sky(1024, 512, rng))


def _hedges(centre: np.ndarray, half: np.ndarray, rng: np.random.Generator) -> list[Thing]:
    """Hedges of changing height and depth; what is left between them shows the houses."""
    hedges = []
    for side in four_sides(centre, half):
        start = -side.half_length_m
        while start < side.half_length_m - 0.4:
            width_m = float(min(rng.uniform(2.0, 4.5), side.half_length_m - start))
            height_m, step_m = float(rng.uniform(1.1, 2.3)), float(rng.uniform(0.0, 0.5))
            place = side.at(start + width_m / 2, side.depth_m + step_m + 0.5)
            size_m = (width_m, 1.0, height_m)
            leaves = hedge(width_m, height_m, HEDGE_PX_PER_M, rng)
            hedges.append(
                upright("box", place, size_m, side.yaw_rad, leaves, round_each_face=False)
            )
            start += width_m + (float(rng.uniform(0.4, 1.2)) if rng.random() < 0.3 else 0.0)
    return hedges
