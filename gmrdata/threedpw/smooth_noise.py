"""Band-limited random curves: sums of slow sine waves, of an exact size over the clip."""

import numpy as np

N_WAVES = 4
LONGEST_SHARE = 4.0
"""The longest period is this many times the shortest."""


def smooth_noise(
    n_frames: int,
    fps_hz: float,
    shortest_period_s: float,
    n_channels: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Random curves without any part that is faster than a period.

    Args:
        n_frames: Number of frames N.
        fps_hz: Their rate [Hz].
        shortest_period_s: No wave has a shorter period [s].
        n_channels: Number of independent curves C.
        rng: Source of periods, phases and amplitudes.

    Returns:
        (N, C), each curve a sum of sine waves of standard-normal amplitudes.
    """
    times_s = np.arange(n_frames)[:, None, None] / fps_hz
    shape = (n_channels, N_WAVES)
    periods_s = shortest_period_s * np.exp(rng.uniform(0.0, np.log(LONGEST_SHARE), shape))
    phases_rad = rng.uniform(0.0, 2 * np.pi, shape)
    amplitudes = rng.normal(size=shape)
    return np.asarray(
        (amplitudes * np.sin(2 * np.pi * times_s / periods_s + phases_rad)).sum(axis=2)
    )


def with_peak(vectors: np.ndarray, peak: float) -> np.ndarray:
    """Scale vectors (N, C) so that the longest of the N has the length `peak`."""
    return vectors * (peak / np.linalg.norm(vectors, axis=1).max())


def with_rms(vectors: np.ndarray, rms: np.ndarray) -> np.ndarray:
    """Scale vectors (N, J, 3) so that the root mean square length over N is `rms` (J,)."""
    found = np.sqrt((vectors**2).sum(axis=2).mean(axis=0))
    return vectors * (rms / found)[:, None]
