"""Drawing people of a body: shapes that belong to usual adults."""

import numpy as np

from gmrdata.body.model import PHENOTYPES, BodyModel

JITTER = 0.1
"""Deviation by which a drawn person differs from the listed one, so that no two are the same."""
LARGEST_COEFFICIENT = 2.0
"""Of people of a body without a list of adults."""


def draw_person(body: BodyModel, rng: np.random.Generator, spread: float = 1.0) -> np.ndarray:
    """Draw someone: (S,) shape coefficients.

    The default body's people are adults of Anny's distribution (`adult_shapes`), in which the six
    phenotypes go together as they do there: independent coefficients would give a strong man's
    shoulders to a tired woman's hips.  Other bodies get normal coefficients within two deviations.

    Args:
        body: The body.
        rng: The same state gives the same person.
        spread: How far from the mean: 1 is the distribution itself, 0 always the mean person.
    """
    if body.adult_shapes is None:
        drawn = rng.normal(0.0, 1.0, body.n_shape)
        shape = np.clip(drawn, -LARGEST_COEFFICIENT, LARGEST_COEFFICIENT)
    else:
        adult = body.adult_shapes[int(rng.integers(len(body.adult_shapes)))]
        shape = adult + rng.normal(0.0, JITTER, body.n_shape)
    return np.asarray(spread * shape, dtype=np.float64)


def phenotypes_of(body: BodyModel, shape: np.ndarray) -> dict[str, float] | None:
    """Phenotypes of the listed adult of the nearest shape; None for a body without a list."""
    if body.adult_shapes is None or body.adult_phenotypes is None:
        return None
    nearest = np.linalg.norm(body.adult_shapes - shape, axis=1).argmin()
    return dict(zip(PHENOTYPES, body.adult_phenotypes[nearest].tolist(), strict=True))
