"""Whether a network's errors lie within their error bars, on people whom nothing was fitted to."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gmrdata.fusion.network_errors import (
    FittedErrors,
    HeldOut,
    SeenBesideTruth,
    error_rates,
    fit_errors,
    span_sigma,
)
from gmrdata.fusion.network_evidence import doubt_factors, mean_speeds_m_per_s

SPANS_S = (0.1, 1.0)


def honesty_rows(held_out: Mapping[str, Sequence[HeldOut]]) -> list[dict[str, Any]]:
    """A row for each fold: shares [%] of its errors, along one axis and as means over a span,
    within one and two standard deviations that the other folds say."""
    rows = []
    for name, fold in held_out.items():
        others = [run for other, one in held_out.items() if other != name for run in runs_of(one)]
        fitted, row = fit_errors(others), dict[str, Any]({"left out": name})
        for span_s in SPANS_S:
            ratios = np.concatenate([_ratios(run, fitted, span_s) for run in runs_of(fold)])
            for what, axes in (("turn", slice(0, 3)), ("place", slice(3, 6))):
                for k in (1, 2):
                    share = 100 * float((ratios[:, axes] <= k).mean())
                    row[f"{what} {span_s:g} s, {k} sigma"] = round(share, 1)
        rows.append(row)
    return rows


def least_shares(rows: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """The least of them over the folds, within one and within two [%]."""
    one, two = (
        min(row[key] for row in rows for key in row if key.endswith(f"{k} sigma")) for k in (1, 2)
    )
    return one, two


def runs_of(held_out: Sequence[HeldOut]) -> list[SeenBesideTruth]:
    return [run for one in held_out for run in one.runs]


def _ratios(run: SeenBesideTruth, fitted: FittedErrors, span_s: float) -> np.ndarray:
    """Errors over their standard deviations (n, 6)."""
    n = max(1, round(span_s * run.fps_hz))
    if n > len(run.delta_m):
        return np.zeros((0, 6))
    sigma = span_sigma(
        fitted.fast, fitted.slow, mean_speeds_m_per_s(run.delta_m, run.fps_hz), span_s
    )
    sigma = sigma * doubt_factors(run.doubt, run.fps_hz, fitted.doubt)
    values = np.column_stack([error_rates(run), sigma**2])
    means = np.lib.stride_tricks.sliding_window_view(values, n, axis=0).mean(axis=-1)
    return np.abs(means[:, :6]) / np.sqrt(means[:, 6:])
