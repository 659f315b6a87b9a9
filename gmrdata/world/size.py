"""People of a size that was told: a body as tall, as much further away.

Pictures don't tell how large a person is: one of twice the size, twice as far away, looks the same.
Shapes are changed along the direction in which a body grows with the least change of shape.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydantic import Field

from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config

UNKNOWN_SIGMA = 0.07
"""Spread of adults' sizes, as a share: 7.2 % in height over the default body's own adults."""
ESTIMATED_SIGMA = 0.05  # of bodies whose shape another system saw in the picture
TOLD_SIGMA = 0.015  # of a person whose height was told: shoes, and legs of another share of it
SMALL_M = 1.45
"""Height below which people are children, whose shoulders and legs are another share of it than
the body's, which is an adult's, by some 5 % at 1.1 m and 7 % at 1 m."""
CHILD_SHARE = 0.2  # that difference, by the logarithm of how much smaller they are
EVERYBODY = "everybody"
LEAST_M, MOST_M = 0.5, 2.5


class HeightConfig(Config):
    """Who is how tall."""

    person: str = EVERYBODY
    """Name of the person, as "person_0"; or "everybody"."""
    height_m: float = Field(ge=LEAST_M, le=MOST_M)
    """From the soles to the top of the head, without shoes [m]."""


def heights_of(said: float | Mapping[str, float] | None) -> tuple[HeightConfig, ...]:
    """One height for all, or heights by name; none where nothing was said."""
    named = {} if said is None else said if isinstance(said, Mapping) else {EVERYBODY: said}
    for name, height_m in named.items():
        if not LEAST_M <= height_m <= MOST_M:
            what = f"height {height_m:g} m of {name}"
            raise BadRecipe(f"{what}: it is in metres, from {LEAST_M:g} to {MOST_M:g}")
    return tuple(HeightConfig(person=name, height_m=value) for name, value in named.items())


def height_of(name: str, heights: tuple[HeightConfig, ...]) -> float | None:
    """What was told of a person, before what was told of everybody [m]."""
    told = {one.person: one.height_m for one in heights}
    return told.get(name, told.get(EVERYBODY))


def told_sigma(told_m: float) -> float:
    """Standard error of the size of a person whose height was told, as a share."""
    return float(np.hypot(TOLD_SIGMA, CHILD_SHARE * np.log(max(1.0, SMALL_M / told_m))))


def height_m(body: BodyModel, shape: np.ndarray) -> float:
    """Of a body of some shape in its rest pose [m]."""
    return float(np.ptp(body.rest_vertices_m(shape)[:, 1]))


def can_grow(body: BodyModel) -> bool:
    """Whether some shape of it is taller than another."""
    return bool(np.ptp(body.shape_dirs_m[:, 1], axis=0).any())


def of_height(motion: Motion, body: BodyModel, target_m: float) -> Motion:
    """A motion before the camera on a body of a height [m], as much further away as it is larger,
    so that it lies where it did in the picture; BadRecipe for a body of one size."""
    if not can_grow(body):
        raise BadRecipe(f"--height-m: the body {body.name} has one size only; leave it out")
    shape = motion.shape
    for _ in range(3):  # the top of the head may be another vertex then
        shape = shape + (target_m - height_m(body, shape)) * _growth(body, shape)
    return replace(motion, shape=shape, pelvis_m=motion.pelvis_m * _larger(body, motion, shape))


def of_size(motion: Motion, body: BodyModel, factor: float) -> Motion:
    """The same by a factor of its joints' distances; as it is on a body of one size."""
    if not can_grow(body):
        return motion
    own_m = height_m(body, motion.shape)
    grown = of_height(motion, body, own_m * factor)
    # A tall body's legs grow more than its height does.
    share = (_larger(body, motion, grown.shape) - 1) / (factor - 1) if factor != 1 else 1.0
    return of_height(motion, body, own_m * (1 + (factor - 1) / share))


def _growth(body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """Change of the shape (S,) that makes a body taller by 1 m."""
    heights_m = body.rest_vertices_m(shape)[:, 1]
    top, bottom = int(heights_m.argmax()), int(heights_m.argmin())
    slope = body.shape_dirs_m[top, 1] - body.shape_dirs_m[bottom, 1]
    return np.asarray(slope / float(slope @ slope))


def _larger(body: BodyModel, motion: Motion, shape: np.ndarray) -> float:
    """How much further apart the joints of another shape are."""
    before_m, after_m = (body.rest_joints_m(one) for one in (motion.shape, shape))
    spreads = [float(np.linalg.norm(m - m[0])) for m in (before_m, after_m)]
    return spreads[1] / spreads[0]
