"""What a camera programme knows of its subject, and the random choices that it may use."""

from dataclasses import dataclass

import numpy as np

from gmrdata.geometry.look_at import smooth_path

FOLLOW_SIGMA_S = 0.35
"""Low-pass on the subject's path: steps bob at about 2 Hz, and an operator doesn't follow those."""
STANDING_M = 0.5
"""A subject that ends this close to its start has no walking direction."""
SWAY_HZ = (0.15, 0.35, 0.7, 1.3, 2.4)
"""A hand's unrest: sway below 1 Hz and some tremor above."""


@dataclass(frozen=True, eq=False)
class SubjectPath:
    """A subject's path over T frames."""

    time_s: np.ndarray
    """(T,), 0 at the middle of the clip [s]."""
    target_m: np.ndarray
    """(T, 3) what a camera that follows looks at: the smoothed, delayed pelvis, world [m]."""
    centre_m: np.ndarray
    """(3,) middle of the path, world [m]."""
    heading_rad: float
    """Walking direction, from x to y; a chosen one for a subject that stays in place."""
    speed_m_per_s: float
    """Mean speed along the walking direction, 0 when standing."""
    side: float
    """+1 or -1: which side of the path the camera takes."""
    jitter_rad: float
    """By how much the camera is off the exact side."""
    waves: np.ndarray
    """(T, 6) smooth noise of unit variance: 3 of position, 3 of rotation."""


def subject_path(
    pelvis_m: np.ndarray, fps_hz: float, lag_s: float, rng: np.random.Generator
) -> SubjectPath:
    """Look at a subject's path, and make the choices of one clip.

    Args:
        pelvis_m: (T, 3) pelvis, z-up world [m].
        fps_hz: Frame rate [Hz].
        lag_s: How late the camera follows [s].
        rng: Chooses.
    """
    n_frames = len(pelvis_m)
    time_s = (np.arange(n_frames) - (n_frames - 1) / 2) / fps_hz
    # The same draws in the same order for every programme, so that seeds are comparable.
    any_heading_rad, side = rng.uniform(-np.pi, np.pi), rng.choice([-1.0, 1.0])
    jitter_rad = np.deg2rad(rng.uniform(-8, 8))
    waves = _hand_waves(time_s, rng)
    span = pelvis_m[-1, :2] - pelvis_m[0, :2]
    walks = np.linalg.norm(span) > STANDING_M
    return SubjectPath(
        time_s=time_s,
        target_m=smooth_path(pelvis_m, fps_hz, FOLLOW_SIGMA_S, lag_s),
        centre_m=(pelvis_m.min(axis=0) + pelvis_m.max(axis=0)) / 2,
        heading_rad=float(np.arctan2(span[1], span[0]) if walks else any_heading_rad),
        speed_m_per_s=float(np.linalg.norm(span) * fps_hz / (n_frames - 1)) if walks else 0.0,
        side=float(side),
        jitter_rad=float(jitter_rad),
        waves=waves,
    )


def _hand_waves(time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(T, 6) smooth noise of unit variance with a 1/f spectrum."""
    frequencies_hz = np.array(SWAY_HZ) * rng.uniform(0.8, 1.2, (6, len(SWAY_HZ)))
    phases_rad = rng.uniform(0, 2 * np.pi, (6, len(SWAY_HZ)))
    amplitudes = 1 / frequencies_hz
    amplitudes /= np.sqrt((amplitudes**2).sum(axis=1, keepdims=True) / 2)
    angles = 2 * np.pi * frequencies_hz * time_s[:, None, None] + phases_rad
    return np.asarray((amplitudes * np.sin(angles)).sum(axis=-1))
