"""Paired differences of two runs."""

import itertools

import numpy as np
import pytest

from gmrdata.score.intervals import paired_difference


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
