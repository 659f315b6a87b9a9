"""Bootstrap intervals of means over clips (Efron 1979; the percentile interval)."""

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
