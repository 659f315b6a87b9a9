"""Bootstrap intervals, and whether two runs differ by more than chance."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import bootstrap

from gmrdata.score.summary import (
    mean_intervals,
    paired_difference,
    ratio_interval,
    resampled_counts,
)

RESAMPLES = 500


def test_interval_of_a_mean_is_scipys() -> None:
    """The same generator draws the same clips, so the ends are the same numbers."""
    values = np.random.default_rng(3).gamma(2.0, 2.0, 12)
    oracle = bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    counts = resampled_counts(12, RESAMPLES, np.random.default_rng(0))
    assert ratio_interval(values, np.ones(12), counts) == pytest.approx(tuple(oracle), rel=1e-9)
    columns = mean_intervals(np.stack([values, 2 * values], axis=1), counts)
    assert columns is not None
    np.testing.assert_allclose(columns, np.outer(tuple(oracle), [1, 2]), rtol=1e-9)


def test_interval_of_a_pooled_mean_is_scipys() -> None:
    """Clips of other lengths: a ratio of two sums, drawn together."""
    rng = np.random.default_rng(4)
    sums, weights = rng.gamma(5.0, 2.0, 9), rng.integers(1, 40, 9).astype(float)
    oracle = bootstrap(
        (sums, weights),
        lambda a, b, axis: a.sum(axis=axis) / b.sum(axis=axis),
        n_resamples=RESAMPLES,
        method="percentile",
        paired=True,
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    found = ratio_interval(sums, weights, resampled_counts(9, RESAMPLES, np.random.default_rng(0)))
    assert found == pytest.approx(tuple(oracle), rel=1e-9)
    found = ratio_interval(sums, weights, resampled_counts(9, 20_000, np.random.default_rng(1)))
    assert found == pytest.approx(tuple(oracle), rel=0.1)


@settings(max_examples=20)
@given(st.integers(2, 12), st.integers(0, 1000))
def test_each_resample_draws_as_many_clips_as_there_are(n_clips: int, seed: int) -> None:
    counts = resampled_counts(n_clips, 50, np.random.default_rng(seed))
    assert counts.shape == (50, n_clips) and (counts.sum(axis=1) == n_clips).all()


def test_one_clip_has_no_interval() -> None:
    counts = resampled_counts(1, 100, np.random.default_rng(0))
    assert ratio_interval(np.array([3.0]), np.ones(1), counts) is None
    counts = resampled_counts(3, 100, np.random.default_rng(0))
    assert ratio_interval(np.array([3.0, 0, 0]), np.array([2.0, 0, 0]), counts) is None
    assert mean_intervals(np.array([[1.0, 2.0]]), counts[:, :1]) is None


def test_clips_without_a_figure_do_not_count() -> None:
    counts = resampled_counts(3, 200, np.random.default_rng(0))
    low, high = ratio_interval(np.array([2.0, 6.0, 0.0]), np.array([1.0, 1.0, 0.0]), counts) or (
        0,
        0,
    )
    assert (low, high) == (2.0, 6.0)


def compared(first: list[float], other: list[float], seed: int = 0):  # type: ignore[no-untyped-def]
    return paired_difference(
        np.array(first), np.array(other), 500, 9999, np.random.default_rng(seed)
    )


def test_four_clips_that_all_got_better() -> None:
    """Of the 16 ways to give the signs, two have a mean as far from 0."""
    found = compared([4.0, 5.0, 6.0, 7.0], [3.0, 4.5, 5.0, 5.0])
    assert found.n_clips == 4
    assert found.difference == pytest.approx(-(1 + 0.5 + 1 + 2) / 4)
    assert found.p_value == pytest.approx(2 / 16)
    assert found.interval95 is not None
    assert -2 <= found.interval95[0] < found.interval95[1] <= -0.5


def test_p_is_the_share_of_all_sign_flips() -> None:
    rng = np.random.default_rng(2)
    first, other = rng.normal(5, 1, (2, 9))
    differences = other - first
    means = [np.mean(differences * signs) for signs in itertools.product((1, -1), repeat=9)]
    expected = np.mean(np.abs(means) >= abs(differences.mean()) - 1e-12)
    assert compared(list(first), list(other)).p_value == pytest.approx(expected)


def test_runs_that_are_the_same_do_not_differ() -> None:
    found = compared([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert (found.difference, found.interval95, found.p_value) == (0.0, (0.0, 0.0), 1.0)


def test_one_clip_says_nothing() -> None:
    found = compared([1.0], [3.0])
    assert (found.difference, found.interval95, found.p_value) == (2.0, None, None)


def test_the_same_seed_gives_the_same_numbers() -> None:
    rng = np.random.default_rng(5)
    first, other = (list(values) for values in rng.normal(5, 1, (2, 30)))
    assert compared(first, other, 1) == compared(first, other, 1)
