# SPDX-License-Identifier: GPL-3.0-or-later
"""A paved yard between houses."""

import numpy as np

from blender.places.layout import Yard, surroundings, yard_of
from blender.places.props import crates, drum, houses_round, pillar, planter, scatter, tree
from blender.textures.ground import paving, sky

WALL_MARGIN_M = 2.5
SMALLEST_HALF_SIDE_M = 6.5
GROUND_PX = 2048


def courtyard(
    subject_world_m: np.ndarray, camera_world_m: np.ndarray, rng: np.random.Generator
) -> Yard:
    """A yard between houses, with crates, drums, pillars, bushes and trees."""
    subject, camera = subject_world_m[:, :2], camera_world_m[:, :2]
    centre, half = surroundings(subject, camera, WALL_MARGIN_M, SMALLEST_HALF_SIDE_M)
    houses = houses_round(centre, half, (4.6, 8.2), rng)
    makers = (crates, crates, drum, pillar, planter, tree)
    props = scatter(makers, (0.35, 0.65), 30, (centre, half), (subject, camera), rng)
    things = (*houses, *props)
    side_m = float(2 * half.max() + 3.0)
    ground = paving(GROUND_PX, side_m, rng)
    return yard_of(centre, side_m, ground, things, sky(1024, 512, rng))
