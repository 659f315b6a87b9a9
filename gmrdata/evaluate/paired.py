"""Two runs scored on the same clips: difference, interval, and whether it could be chance."""

from dataclasses import dataclass

import numpy as np

from gmrdata.evaluate.intervals import Interval, ratio_interval, resampled_counts


@dataclass(frozen=True)
class PairedDifference:
    """How a run differs from the first one in one metric, mean over clips."""

    n_clips: int
    """Clips in which both have a figure."""
    difference: float
    """Mean of the run's figures minus the first run's."""
    interval95: Interval | None
    """Ends of its 95 % bootstrap interval over clips; None for fewer than two clips."""
    p_value: float | None
    """Two-sided permutation test over clips: how often a difference as large comes about where it
    is chance which of the two runs a figure belongs to; None for fewer than two clips."""


def paired_difference(
    first: np.ndarray,
    other: np.ndarray,
    resamples: int,
    permutations: int,
    rng: np.random.Generator,
) -> PairedDifference:
    """Compare two runs clip by clip.

    Args:
        first: (n,) figures of the first run, n >= 1.
        other: (n,) figures of the other run, same clips.
        resamples: How often clips are drawn for the interval.
        permutations: How many permutations are drawn at most; all 2^n of them are used where
            they are no more than that, and p is exact.
        rng: Draws clips and permutations.
    """
    differences = other - first
    n = len(differences)
    if n < 2:
        return PairedDifference(n, float(differences.mean()), None, None)
    counts = resampled_counts(n, resamples, rng)
    interval = ratio_interval(differences, np.ones(n), counts)
    p_value = _p_value(first, other, permutations, rng)
    return PairedDifference(n, float(differences.mean()), interval, p_value)


def _p_value(
    first: np.ndarray, other: np.ndarray, permutations: int, rng: np.random.Generator
) -> float:
    from scipy.stats import permutation_test

    found = permutation_test(
        (other, first),
        lambda a, b, axis: np.mean(a - b, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=permutations,
        alternative="two-sided",
        rng=rng,
    )
    return float(found.pvalue)
