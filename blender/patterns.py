# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns of cloth, as functions of the place on the cloth."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["plain", "stripes", "pinstripes", "checks", "dots", "blotches", "two_tone"]
KINDS: tuple[Kind, ...] = (
    "plain",
    "stripes",
    "pinstripes",
    "checks",
    "dots",
    "blotches",
    "two_tone",
)

BLOCK = 1 << 15
"""Places whose waves are summed at a time: fresh memory for all at once costs far more."""


@dataclass(frozen=True, eq=False)
class Cloth:
    """A cloth with a pattern in two colours."""

    kind: Kind
    first: np.ndarray
    """(3,) sRGB colour."""
    second: np.ndarray
    """(3,) sRGB colour."""
    period_m: float
    """After which the pattern repeats [m]; where two tones meet above or below the middle."""
    seed: int
    """Of blotches and of the weave."""


def colours_at(cloth: Cloth, across_m: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """(M, 3) sRGB colours of a cloth.

    Args:
        cloth: The cloth.
        across_m: (M,) place round the limb [m].
        along_m: (M,) place along the limb [m]; 0 in the garment's middle.
    """
    share = _share_of_second(cloth, across_m, along_m)[:, None]
    colours = cloth.first + share * (cloth.second - cloth.first)
    weave = waves(np.stack([across_m, along_m], axis=-1), 18.0, cloth.seed + 1)[:, None]
    return np.asarray(np.clip(colours * (1 + 0.07 * weave), 0, 1), dtype=np.float32)


def waves(places_m: np.ndarray, radians_per_m: float, seed: int) -> np.ndarray:
    """(M,) smooth random numbers of mean 0 and deviation 1 over places (M, D) [m]."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(0, radians_per_m, (places_m.shape[1], 8)).astype(np.float32)
    phases = rng.uniform(0, 2 * np.pi, 8).astype(np.float32)
    blocks = np.array_split(places_m, len(places_m) // BLOCK + 1)
    return np.concatenate([_summed_sines(block, turns, phases) for block in blocks]) / 2.0


def _summed_sines(places_m: np.ndarray, turns: np.ndarray, phases: np.ndarray) -> np.ndarray:
    w = np.sin(places_m.astype(np.float32) @ turns + phases).T
    # The pairs in which numpy sums eight numbers, which it does far slower row by row.
    return np.asarray(((w[0] + w[1]) + (w[2] + w[3])) + ((w[4] + w[5]) + (w[6] + w[7])))


def _share_of_second(cloth: Cloth, across_m: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """(M,) 0 where a cloth has its first colour, 1 where it has its second."""
    if cloth.kind == "plain":
        return np.zeros(len(along_m))
    if cloth.kind == "stripes":
        return np.asarray((along_m / cloth.period_m) % 1 < 0.45, dtype=np.float64)
    if cloth.kind == "pinstripes":
        return np.asarray((across_m / cloth.period_m) % 1 < 0.25, dtype=np.float64)
    if cloth.kind == "checks":
        warp, weft = ((at / cloth.period_m) % 1 < 0.5 for at in (across_m, along_m))
        return 0.5 * warp + 0.5 * weft
    if cloth.kind == "dots":
        row = np.floor(along_m / cloth.period_m)
        aside = (across_m / cloth.period_m + 0.5 * (row % 2)) % 1 - 0.5
        above = (along_m / cloth.period_m) % 1 - 0.5
        return np.asarray(np.hypot(aside, above) < 0.28, dtype=np.float64)
    if cloth.kind == "blotches":
        places_m = np.stack([across_m, along_m], axis=-1)
        blotches = waves(places_m, 2.2 / cloth.period_m, cloth.seed)
        return np.asarray(blotches > 0.25, dtype=np.float64)
    return np.asarray(along_m > cloth.period_m / 2, dtype=np.float64)
