# SPDX-License-Identifier: GPL-3.0-or-later
"""A park: grass and gravel between hedges, trees and benches, with houses further off."""

import numpy as np

from blender.places.layout import Thing, Yard, darken_contacts, direction, surroundings
from blender.places.props import bench, bush, houses_round, lamp, planter, scatter, tall_tree
from blender.textures.ground import hedge, meadow, sky

HEDGE_MARGIN_M = 3.0
SMALLEST_HALF_SIDE_M = 7.0
HOUSES_BEHIND_M = 4.5
HEDGE_PX_PER_M = 110.0
GROUND_PX = 3072


def park(subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator) -> Yard:
    """A lawn with hedges on all four sides.

    Nothing stands within about a metre of the subject or the camera, or between them.

    Args:
        subject_world_m: (T, 3) pelvis path [m].
        camera_world_m: (T, 3) optical centres [m].
        rng: Chooses everything else.
    """
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
    darken_contacts(ground, things, centre, side_m)
    return Yard(centre, side_m, ground, things, sky(1024, 512, rng))


def _hedges(centre: np.ndarray, half: np.ndarray, rng: np.random.Generator) -> list[Thing]:
    """Hedges of changing height and depth; what is left between them shows the houses."""
    hedges = []
    for side in range(4):
        yaw_rad = side * np.pi / 2
        along, out = direction(yaw_rad), direction(yaw_rad - np.pi / 2)
        length_m, depth_m = half if side % 2 == 0 else half[::-1]
        start = -float(length_m)
        while start < length_m - 0.4:
            width_m = float(min(rng.uniform(2.0, 4.5), length_m - start))
            height_m, step_m = float(rng.uniform(1.1, 2.3)), float(rng.uniform(0.0, 0.5))
            place = centre + along * (start + width_m / 2) + out * (depth_m + step_m + 0.5)
            hedges.append(
                Thing(
                    "box",
                    np.array([*place, height_m / 2]),
                    np.array([width_m, 1.0, height_m]),
                    yaw_rad,
                    hedge(width_m, height_m, HEDGE_PX_PER_M, rng),
                    (width_m, height_m),
                )
            )
            start += width_m + (float(rng.uniform(0.4, 1.2)) if rng.random() < 0.3 else 0.0)
    return hedges
