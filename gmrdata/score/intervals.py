"""Two runs scored on the same clips: difference, interval, and whether it could be chance.

Bootstrap intervals of means over clips (Efron 1979; the percentile interval).
"""

from dataclasses import dataclass

import numpy as np

LEVEL = 0.95
"""Share of the resampled figures that an interval holds."""

Interval = tuple[float, float]


def resampled_counts(n_clips: int, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """How often each clip is drawn in each resample: (resamples, n_clips) float64."""
    drawn = rng.integers(0, n_clips, (resamples, n_clips))
    counts = np.zeros((resamples, n_clips))
    np.add.at(counts, (np.arange(resamples)[:, None], drawn), 1.0)
    return counts


def ratio_interval(sums: np.ndarray, weights: np.ndarray, counts: np.ndarray) -> Interval | None:
    """Interval of sum(sums) / sum(weights) where clips are drawn with replacement.

    Args:
        sums: (n,) what each clip adds above the line.
        weights: (n,) what it adds below it; 0 for a clip without a figure.
        counts: (resamples, n) as `resampled_counts` gives them.

    Returns:
        Its ends, or None for fewer than two clips with a figure, of which nothing can be said.
    """
    if np.count_nonzero(weights) < 2:
        return None
    below = counts @ weights
    drawn = below > 0
    low, high = _ends((counts @ sums)[drawn] / below[drawn])
    return float(low), float(high)


def mean_intervals(values: np.ndarray, counts: np.ndarray) -> np.ndarray | None:
    """Intervals of the means of several columns at once.

    Args:
        values: (n, K) figures of each clip.
        counts: (resamples, n) as `resampled_counts` gives them.

    Returns:
        (2, K) lower and upper ends, or None for fewer than two clips.
    """
    if len(values) < 2:
        return None
    return _ends(counts @ values / len(values))


def _ends(resampled: np.ndarray) -> np.ndarray:
    tail = (1 - LEVEL) / 2
    return np.asarray(np.quantile(resampled, [tail, 1 - tail], axis=0))


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
