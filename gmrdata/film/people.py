"""How the filmed person looks: the recipe, and shapes that belong to usual adults."""

from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.values import limits
from gmrdata.values.body import PHENOTYPES, BodyModel
from gmrdata.values.records import Config

JITTER = 0.1
"""Deviation by which a drawn person differs from the listed one, so that no two are the same."""
LARGEST_COEFFICIENT = 2.0  # of people of a body without a list of adults


class TextureConfig(Config):
    """A picture that the body wears, such as those of the SMPL literature."""

    image: Path
    """.png or .jpg."""
    uv: Path
    """Picture coordinates of the faces: an .obj, or an .npz with `vt` (N, 2) and `ft` (F, 3)."""


class PersonConfig(Config):
    """How the person looks."""

    seed: int | None = Field(default=None, ge=0, le=limits.LARGEST_SEED)
    """Chooses skin, hair and clothes; None: the scene's seed does."""
    texture: TextureConfig | None = None
    """A picture instead of painted skin and clothes."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        worn = self.texture
        return {} if worn is None else {"texture_image": worn.image, "texture_uv": worn.uv}


def sample_person(body: BodyModel, rng: np.random.Generator, spread: float = 1.0) -> np.ndarray:
    """Someone's (S,) shape coefficients; a spread of 0 gives the mean person, 1 all sorts.

    The default body's people are adults of Anny's distribution (`adult_shapes`), in which the six
    phenotypes go together as they do there: independent coefficients would give a strong man's
    shoulders to a tired woman's hips.  Other bodies get normal coefficients within two deviations.
    """
    if body.adult_shapes is None:
        shape = rng.normal(0.0, 1.0, body.n_shape).clip(-LARGEST_COEFFICIENT, LARGEST_COEFFICIENT)
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
