"""How wrong a network's motions between frames are: a record that is kept beside the network.

The error is taken as a rate, in the body's axes, and as the sum of two Gauss-Markov processes: a
fast one, which forgets itself within a step or two, and a slow one, which lasts through a gap, such
as a pace that is thought too short.  Both grow with the speed that the network says.  What a gap of
some length adds up to is a variance of the error's mean over that time; the two are fitted to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass as part
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.fusion.fusion import ErrorProcess, SeenMotions, mean_variance
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion_deltas import deltas
from gmrdata.values.records import PART, Figure, Record

DELTA_ERRORS_FILE = "delta_errors.json"
SPEEDS_M_PER_S = (0.0, 0.3, 0.8, 1.4)
"""Speeds at which errors are given, between which they are interpolated."""
SPEED_TIME_S = 1.0  # over which a speed is the mean
SPANS_S = (0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Times over which the error's mean is looked at."""
FAST_TIMES_S = (0.05, 0.1, 0.2, 0.4)
SLOW_TIMES_S = (3.0, 10.0)
FEWEST_S = 20.0  # of motion behind a figure
Six = Annotated[tuple[Figure, ...], Field(min_length=6, max_length=6)]


@part(frozen=True, config=PART)
class ErrorPart:
    """One of the two processes."""

    time_s: Six
    """By axis, turn first: time in which it forgets itself to 1/e [s]."""
    turn_deg_per_s: tuple[tuple[Figure, Figure, Figure], ...]
    """By speed and axis (left, up, front): standard deviation."""
    place_m_per_s: tuple[tuple[Figure, Figure, Figure], ...]


class DeltaErrors(Record):
    """`delta_errors.json`."""

    format: Literal["gmrdata-delta-errors/1"] = "gmrdata-delta-errors/1"
    networks: tuple[str, ...]
    """Names of their runs."""
    fps_hz: float
    """The networks' rate."""
    people: tuple[str, ...]
    """Whom they were measured on and not trained on."""
    clips: int
    seconds: Figure
    pose_noise_deg: float
    """Root mean square error that was put on each joint [degrees]."""
    pose_noise_time_s: float
    speeds_m_per_s: tuple[Figure, ...]
    fast: ErrorPart
    slow: ErrorPart

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        n = len(self.speeds_m_per_s)
        tables = [t for p in (self.fast, self.slow) for t in (p.turn_deg_per_s, p.place_m_per_s)]
        if n < 1 or any(len(table) != n for table in tables):
            raise ValueError("its tables are not of as many speeds as `speeds_m_per_s`")
        if any(np.diff(self.speeds_m_per_s) <= 0):
            raise ValueError("`speeds_m_per_s` don't ascend")
        flat = [*self.fast.time_s, *self.slow.time_s]
        if min(flat) <= 0 or min(min(row) for table in tables for row in table) < 0:
            raise ValueError("a time or a standard deviation is not positive")
        return self


HEADINGS = (
    "speed [m/s]", "turn, fast [deg/s]", "turn, slow [deg/s]", "place, fast [m/s]",
    "place, slow [m/s]",
)  # fmt: skip


def error_rows(record: DeltaErrors) -> list[tuple[str, ...]]:
    """A row of `HEADINGS` for each speed: standard deviations along left, up and front."""
    fast, slow = record.fast, record.slow
    tables = fast.turn_deg_per_s, slow.turn_deg_per_s, fast.place_m_per_s, slow.place_m_per_s
    return [
        (f"{speed:g}", *(" ".join(f"{value:.3g}" for value in table[k]) for table in tables))
        for k, speed in enumerate(record.speeds_m_per_s)
    ]


@dataclass(frozen=True, eq=False)
class SeenBesideTruth:
    """Motions that a network sees, beside the true ones."""

    delta_rotmats: np.ndarray  # (T-1, 3, 3)
    delta_m: np.ndarray  # (T-1, 3) [m]
    true_rotmats: np.ndarray  # (T, 3, 3) world_from_root
    true_pelvis_m: np.ndarray  # (T, 3) [m]
    fps_hz: float


def seen_motions(
    delta_rotmats: np.ndarray, delta_m: np.ndarray, fps_hz: float, errors: DeltaErrors
) -> SeenMotions:
    """A network's motions with their errors by the speed that they have themselves."""
    speeds = mean_speeds_m_per_s(delta_m, fps_hz)
    fast, slow = (_process(one, speeds, errors) for one in (errors.fast, errors.slow))
    return SeenMotions(delta_rotmats, delta_m, fast, slow)


def _process(one: ErrorPart, speeds: np.ndarray, errors: DeltaErrors) -> ErrorProcess:
    tables = np.deg2rad(one.turn_deg_per_s), np.array(one.place_m_per_s)
    sigma = np.concatenate(tables, axis=1)
    at = [np.interp(speeds, errors.speeds_m_per_s, column) for column in sigma.T]
    return ErrorProcess(np.stack(at, axis=1), np.array(one.time_s))


def mean_speeds_m_per_s(delta_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """Speeds (T-1,) of motions (T-1, 3), each the mean over `SPEED_TIME_S` about it."""
    speeds = np.linalg.norm(delta_m, axis=1) * fps_hz
    return _window_means(speeds[:, None], round(SPEED_TIME_S * fps_hz / 2))[:, 0]


def _window_means(values: np.ndarray, reach: int) -> np.ndarray:
    """Means (T, C) over up to `reach` rows to either side; fewer at the ends."""
    rows = np.arange(len(values))
    start, stop = np.maximum(rows - reach, 0), np.minimum(rows + reach + 1, len(values))
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[stop] - sums[start]) / (stop - start)[:, None])


def error_rates(seen: SeenBesideTruth) -> np.ndarray:
    """By how much motions are off, (T-1, 6) in the body's axes [rad/s, m/s]."""
    true_deltas, true_m = deltas(seen.true_rotmats, seen.true_pelvis_m)
    wrong = true_deltas.swapaxes(-1, -2) @ seen.delta_rotmats
    turns = Rotation.from_matrix(wrong).as_rotvec()
    return np.concatenate([turns, seen.delta_m - true_m], axis=1) * seen.fps_hz


@dataclass(frozen=True, eq=False)
class FittedErrors:
    """The two processes, fitted."""

    fast: ErrorPart
    slow: ErrorPart


def fit_errors(clips: Sequence[SeenBesideTruth]) -> FittedErrors:
    """The processes whose means over 0.1 to 3 s vary as the errors of clips do.

    BadMotionFile where they are too few, or too short to tell a slow part.
    """
    variances, seconds = _variances(clips)
    enough = seconds[:, 0] >= FEWEST_S
    if not enough.any() or not (seconds[enough, SPANS_S.index(1.0)] > 0).any():
        raise BadMotionFile(
            f"the held-out motions are {seconds[:, 0].sum():.0f} s in all, at any one speed less"
            f" than {FEWEST_S:g} s, or none lasts a second. Hold out more of them"
        )
    parts = [_fit_axis(variances[enough, :, axis], seconds[enough]) for axis in range(6)]
    times = np.array([one[0] for one in parts])
    # (speed, part, axis); a speed that hardly occurs has the figures of the nearest that does.
    sigma = np.stack([one[1] for one in parts], axis=-1)
    known = np.flatnonzero(enough)
    nearest = np.abs(np.arange(len(SPEEDS_M_PER_S))[:, None] - known).argmin(axis=1)
    fast, slow = (_part(times[:, k], sigma[nearest, k]) for k in (0, 1))
    return FittedErrors(fast, slow)


def _part(times: np.ndarray, sigma: np.ndarray) -> ErrorPart:
    return ErrorPart(
        tuple(map(float, times)), _table(np.rad2deg(sigma[:, :3])), _table(sigma[:, 3:])
    )


def _table(sigma: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(left), float(up), float(front)) for left, up, front in sigma)


def _variances(clips: Sequence[SeenBesideTruth]) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares (speed, span, 6) of the errors' means over spans, and seconds (speed, span) of
    motion that they are of: each window counts where its mean speed is nearest."""
    squares = np.zeros((len(SPEEDS_M_PER_S), len(SPANS_S), 6))
    counts, seconds = np.zeros(squares.shape[:2]), np.zeros(squares.shape[:2])
    for clip in clips:
        rates = error_rates(clip)
        speeds = mean_speeds_m_per_s(clip.delta_m, clip.fps_hz)
        values = np.column_stack([rates, speeds])
        for k, span_s in enumerate(SPANS_S):
            n = max(1, round(span_s * clip.fps_hz))
            if n > len(rates):
                continue
            means = np.lib.stride_tricks.sliding_window_view(values, n, axis=0).mean(axis=-1)
            nearest = np.abs(means[:, 6:] - SPEEDS_M_PER_S).argmin(axis=1)
            np.add.at(squares[:, k], nearest, means[:, :6] ** 2)
            np.add.at(counts[:, k], nearest, 1.0)
            np.add.at(seconds[:, k], nearest, 1 / clip.fps_hz)
    return squares / np.maximum(counts, 1.0)[..., None], seconds


def _fit_axis(variances: np.ndarray, seconds: np.ndarray) -> tuple[tuple[float, float], np.ndarray]:
    """Times of the two processes [s], and their standard deviations (speed, 2), for variances
    (speed, span): those with the least sum of squares between logarithms."""
    weights = np.sqrt(np.minimum(seconds / FEWEST_S, 1.0))
    measured = np.log(np.maximum(variances, 1e-12))
    fits = []
    for times_s in product(FAST_TIMES_S, SLOW_TIMES_S):
        shapes = np.stack([mean_variance(np.array(SPANS_S) / time_s) for time_s in times_s])
        found = [
            least_squares(_log_misfit, np.sqrt(row[[0, -1]]) / 2, args=(shapes, at, weight))
            for row, at, weight in zip(variances, measured, weights, strict=True)
        ]
        fits.append((sum(one.cost for one in found), times_s, [np.abs(one.x) for one in found]))
    _, times_s, sigma = min(fits, key=lambda fit: fit[0])
    return times_s, np.array(sigma)


def _log_misfit(
    sigma: np.ndarray, shapes: np.ndarray, measured: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    return np.asarray(weights * (np.log(sigma**2 @ shapes + 1e-12) - measured))
