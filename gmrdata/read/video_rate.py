"""The rate of a video's frames, from times that a container rounds.

Matroska, FLV and ASF count in whole milliseconds, GIF in hundredths of a second, and a file that
was made from one of these keeps such times.  The container's rate is taken where every time is on
its grid, within that rounding; else a rate that fits all times.
"""

from collections.abc import Sequence

import numpy as np

EXACT_S = 1e-6
REMUXED_S = 1 / 600  # that times of any file may be rounded to, from what it was made from
ROUNDINGS = 1.1  # between two times, each rounded in its own way
SAME_RATE = 2e-4  # as a share: a rate that is stated so near to a usual one is that one
LONGEST_STEP = 1.6  # of the median one: what takes longer are two
ALIKE = 0.1  # as a share: steps of one rate, where there are several
FIT_SIGMAS = 3.0  # standard errors of the fit within which a stated rate is taken
MOST_UNEVEN = 0.5  # of a step: more than that, and it is no one rate


def rated(
    times_s: np.ndarray, tick_s: float, stated_hz: Sequence[float]
) -> tuple[float, np.ndarray]:
    """Frames per second, and the times (T,) of T >= 2 frames without their rounding.

    Frames that were dropped leave gaps of whole steps.  Where the rate varies, times are left as
    they are, and the rate is that of most frames.

    Args:
        times_s: As the file has them, from the first frame on, rising.
        tick_s: What the file counts time in.
        stated_hz: Rates by the file's own word, the best first.
    """
    fit_hz, uneven, sigma_hz = _fit(times_s)
    # A fit over few frames is as coarse as their times.
    fitted = _usual(fit_hz, 2 * max(tick_s, REMUXED_S) / times_s[-1] * fit_hz)
    for rounding_s in (EXACT_S, tick_s, max(tick_s, REMUXED_S)):
        # A mean over the file's length, which is no usual rate, is as coarse as its times.
        coarse = 2 * rounding_s / times_s[-1]
        stated = [
            rate_hz
            for one in stated_hz
            for rate_hz in (*(_usual(one, SAME_RATE * one) or _usual(one, coarse * one)), one)
        ]
        for rate_hz in (*stated, *fitted):
            steps = _steps(times_s, rate_hz)
            if np.median(np.diff(steps)) == 1 and (
                np.ptp(times_s - steps / rate_hz) <= ROUNDINGS * rounding_s
            ):
                return rate_hz, steps / rate_hz
    if uneven >= MOST_UNEVEN:
        return _usual_step_hz(times_s), times_s
    # Each frame at a time of its own, as a clock of the recorder has it.
    near = [one for one in (*stated, *fitted) if abs(one - fit_hz) <= FIT_SIGMAS * sigma_hz]
    return (near[0] if near else fit_hz), times_s


def _steps(times_s: np.ndarray, rate_hz: float) -> np.ndarray:
    """(T,) whole steps of a rate from the first time on, at least one between two."""
    each = np.maximum(1, np.rint(np.diff(times_s) * rate_hz))
    return np.concatenate([[0.0], np.cumsum(each)])


def _usual_step_hz(times_s: np.ndarray) -> float:
    """The rate of most frames of a video whose rate varies."""
    each_s = np.diff(times_s)
    # One of the steps: between two kinds, half and half, no step is like their mean.
    median_s = np.quantile(each_s, 0.5, method="lower")
    rate_hz = 1.0 / float(each_s[np.abs(each_s / median_s - 1) <= ALIKE].mean())
    return (*_usual(rate_hz, SAME_RATE * rate_hz), rate_hz)[0]


def _fit(times_s: np.ndarray) -> tuple[float, float, float]:
    """A rate by least squares over all times, how far they are from it in steps, and its error."""
    each_s = np.diff(times_s)
    # Where a tick is long, single steps are half as long again as the median.
    single_s = each_s[each_s < LONGEST_STEP * np.median(each_s)]
    steps = _steps(times_s, 1.0 / float(single_s.mean()))
    step_s, first_s = np.polyfit(steps, times_s, 1)
    apart = (times_s - step_s * steps - first_s) / step_s
    error = float(apart.std() / max(np.linalg.norm(steps - steps.mean()), 1.0))
    return 1.0 / float(step_s), float(np.ptp(apart)), error / float(step_s)


def _usual(rate_hz: float, within_hz: float) -> list[float]:
    """Rates that cameras and programs have, so near to another."""
    usual_hz = round(rate_hz), round(rate_hz * 1.001) / 1.001, round(2 * rate_hz) / 2
    return [float(one) for one in usual_hz if one > 0 and abs(one - rate_hz) <= within_hz]
