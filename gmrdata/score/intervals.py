"""Bootstrap intervals of means over clips, and whether two runs differ by more than chance.

Intervals are percentile intervals (Efron 1979).  They are those of `scipy.stats.bootstrap` for the
same draws, which a test holds.  It is not used, because all figures of a score share their draws
here: for 37 clips and 2000 resamples a curve of 100 frames takes it 0.9 s in place of 0.05 s, a
pooled mean 20 ms in place of 11.  It also has no interval where a resample draws only clips without
a figure.
"""

from typing import NamedTuple

import numpy as np

from gmrdata.score import Interval
from gmrdata.values.shapes import Float

LEVEL = 0.95  # share of the resampled figures that an interval holds
Counts = Float[np.ndarray, "resamples clips"]
PerClip = Float[np.ndarray, " clips"]


def resampled_counts(n_clips: int, resamples: int, rng: np.random.Generator) -> Counts:
    """How often each clip is drawn in each resample."""
    drawn = rng.integers(0, n_clips, (resamples, n_clips))
    counts = np.zeros((resamples, n_clips))
    np.add.at(counts, (np.arange(resamples)[:, None], drawn), 1.0)
    return counts


def ratio_interval(sums: PerClip, weights: PerClip, counts: Counts) -> Interval | None:
    """Interval of sum(sums) / sum(weights) over resampled clips; None below two with weight."""
    if np.count_nonzero(weights) < 2:
        return None
    below = counts @ weights
    drawn = below > 0
    low, high = _ends((counts @ sums)[drawn] / below[drawn])
    return float(low), float(high)


def mean_intervals(
    values: Float[np.ndarray, "clips columns"], counts: Counts
) -> Float[np.ndarray, "2 columns"] | None:
    """Lower and upper ends for the means of several columns; None for fewer than two clips."""
    return _ends(counts @ values / len(values)) if len(values) >= 2 else None


def _ends(resampled: np.ndarray) -> np.ndarray:
    tail = (1 - LEVEL) / 2
    return np.asarray(np.quantile(resampled, [tail, 1 - tail], axis=0))


class PairedDifference(NamedTuple):
    """How a run differs from the first one in one metric; of one clip without interval and p."""

    n_clips: int
    difference: float | None  # mean over clips of the run's figures minus the first run's
    interval95: Interval | None  # ends of its 95 % bootstrap interval over clips
    p_value: float | None
    """Two-sided permutation test over clips: how often a difference as large comes about where it
    is chance which of the two runs a figure belongs to."""


def paired_difference(
    first: PerClip, other: PerClip, resamples: int, permutations: int, rng: np.random.Generator
) -> PairedDifference:
    """Compare two runs clip by clip; p is exact where all 2^n permutations are no more."""
    from scipy.stats import permutation_test

    differences = other - first
    n, mean = len(differences), float(differences.mean())
    if n < 2:
        return PairedDifference(n, mean, None, None)
    interval = ratio_interval(differences, np.ones(n), resampled_counts(n, resamples, rng))
    found = permutation_test(
        (other, first),
        lambda a, b, axis: np.mean(a - b, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=permutations,
        alternative="two-sided",
        rng=rng,
    )
    return PairedDifference(n, mean, interval, float(found.pvalue))
