"""The parts that camera programmes are made of: where a camera goes, and where it looks.

Azimuths are those of the direction from the middle of the subject's path to the camera.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gmrdata.values.errors import BadRecipe
from gmrdata.values.transforms import rotmats_from_rotvecs

FOLLOW_SIGMA_S = 0.35
"""Low-pass on the subject's path: steps bob at about 2 Hz, and an operator doesn't follow those."""
STANDING_M = 0.5  # a subject that ends this close to its start has no walking direction
SWAY_HZ = (0.15, 0.35, 0.7, 1.3, 2.4)  # a hand's unrest: sway below 1 Hz and some tremor above
SLOWEST_M_PER_S = 0.3  # speed of a travelling camera whose subject stays in place


def look_at(centres_world_m: np.ndarray, targets_world_m: np.ndarray) -> np.ndarray:
    """World_from_cam rotations (..., 3, 3), OpenCV axes, level, of centres and targets (..., 3)."""
    forward = np.asarray(targets_world_m, dtype=np.float64) - centres_world_m
    right = np.cross(forward, (0.0, 0.0, 1.0))
    length = np.linalg.norm(forward, axis=-1, keepdims=True)
    level = np.linalg.norm(right, axis=-1, keepdims=True)
    if not np.all(level > 1e-6 * np.maximum(length, 1e-6)):
        what = "the camera would look straight up or down, or be inside its subject"
        raise BadRecipe(f"{what}; give it another height or distance")
    forward, right = forward / length, right / level
    return np.stack([right, np.cross(forward, right), forward], axis=-1)


def smooth_path(points_m: np.ndarray, fps_hz: float, sigma_s: float, lag_s: float) -> np.ndarray:
    """A path (T, 3) [m] as a camera operator follows it: Gaussian low-pass, and late by `lag_s`."""
    smooth = gaussian_filter1d(points_m, max(sigma_s * fps_hz, 1e-3), axis=0, mode="nearest")
    frames = np.arange(len(points_m))
    late = np.clip(frames - lag_s * fps_hz, 0, len(points_m) - 1)
    return np.stack([np.interp(late, frames, column) for column in smooth.T], axis=-1)


@dataclass(frozen=True, eq=False)
class SubjectPath:
    """A subject's path over T frames."""

    time_s: np.ndarray  # (T,), 0 at the middle of the clip [s]
    target_m: np.ndarray  # (T, 3) smoothed, delayed pelvis, which a follower looks at, world [m]
    centre_m: np.ndarray  # (3,) middle of the path, world [m]
    heading_rad: float  # walking direction, from x to y; a chosen one for a subject in place
    speed_m_per_s: float  # mean speed along the walking direction, 0 when standing
    side: float  # +1 or -1: which side of the path the camera takes
    jitter_rad: float  # by how much the camera is off the exact side
    waves: np.ndarray  # (T, 6) smooth noise of unit variance: 3 of position, 3 of rotation


def subject_path(
    pelvis_m: np.ndarray, fps_hz: float, lag_s: float, rng: np.random.Generator
) -> SubjectPath:
    """The path of a pelvis (T, 3) [m], and the random choices of one clip."""
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


def station(
    subject: SubjectPath, azimuth_rad: float, distance_m: float, height_m: float
) -> np.ndarray:
    """A place (3,) for the camera, on the ground `distance_m` from the path's middle [m]."""
    place_m = subject.centre_m + distance_m * _direction(azimuth_rad)
    return np.array([*place_m[:2], height_m])


def line(
    subject: SubjectPath,
    place_m: np.ndarray,
    along_rad: float,
    speed_m_per_s: float | None,
    share: float,
) -> np.ndarray:
    """Centres (T, 3) on a straight line through a place (3,) in the middle of the clip [m].

    Of the two senses of the line's direction `along_rad` the camera takes that which goes with the
    subject.  Its speed is that in this sense; None: `share` of the subject's along the line.
    """
    along, heading = _direction(along_rad), _direction(subject.heading_rad)
    along = along if along @ heading >= 0 else -along
    if speed_m_per_s is None:
        own_m_per_s = share * subject.speed_m_per_s * float(along @ heading)
        speed_m_per_s = max(own_m_per_s, SLOWEST_M_PER_S)
    return np.asarray(place_m + speed_m_per_s * subject.time_s[:, None] * along)


def held(
    subject: SubjectPath, world_from_cam: np.ndarray, drift_m: float, shake_deg: float
) -> np.ndarray:
    """Cameras (T, 4, 4) with a hand's unrest; BadRecipe where that takes one below the ground."""
    unsteady = world_from_cam.copy()
    unsteady[:, :3, 3] += drift_m * subject.waves[:, :3]
    if (lowest_m := float(unsteady[:, 2, 3].min())) <= 0:
        what = f"the hand that holds the camera would go down to a height of {lowest_m:.2f} m"
        raise BadRecipe(f"{what}; give more height_m, or less drift_m or handheld_m")
    if shake_deg > 0:
        shake = rotmats_from_rotvecs(np.deg2rad(shake_deg) * subject.waves[:, 3:])
        unsteady[:, :3, :3] = unsteady[:, :3, :3] @ shake
    return unsteady


def _direction(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
