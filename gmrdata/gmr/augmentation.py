"""Augmentations: left and right exchanged, arms of others, and random turns of the joints.

A motion is reflected in a vertical plane of the world, x -> -x, and each joint takes over from its
counterpart on the other side.  In the body's frame, x to its left, that is the same reflection
M = diag(-1, 1, 1): a local rotation R becomes M R M, and of the motion between frames dR becomes
M dR M and dT becomes M dT.  The mirrored body is exactly the body's mirror image where its two
sides are alike.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import WindowConfig
from gmrdata.gmr.symmetries import COUNTERPARTS
from gmrdata.values.body import JOINT, MIRROR
from gmrdata.values.shapes import Float

AXES = np.array(MIRROR)  # diagonal of the reflection M
_SIGNS = np.outer(AXES, AXES)  # M R M multiplies each entry of R by one of these
_UPPER = np.arange(JOINT["neck"], len(JOINT)) - 1  # rows of neck, head and arms


def mirror_local(
    local_rotmats: Float[np.ndarray, "*batch 23 3 3"],
) -> Float[np.ndarray, "*batch 23 3 3"]:
    return mirror_rotmats(local_rotmats[..., COUNTERPARTS, :, :])


def mirror_rotmats(rotmats: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """M R M, for a root or a motion between frames."""
    return rotmats * _SIGNS.astype(rotmats.dtype)


def mirror_points_m(points_m: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """M p, for a pelvis or a motion between frames [m]."""
    return points_m * AXES.astype(points_m.dtype)


def with_exchanged_arms(
    local_rotmats: Float[np.ndarray, "batch frames 23 3 3"],
    probability: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "batch frames 23 3 3"]:
    """Local rotations of windows, some with neck, head and arms of the next window.

    The root's motion is left as it is: legs and trunk carry it, and arms change it a little.
    """
    chosen = np.flatnonzero(rng.random(len(local_rotmats)) < probability)
    exchanged = local_rotmats.copy()
    exchanged[chosen[:, None], :, _UPPER] = np.roll(local_rotmats, -1, axis=0)[
        chosen[:, None], :, _UPPER
    ]
    return exchanged


def turned(
    local_rotmats: Float[np.ndarray, "*batch frames 23 3 3"],
    config: WindowConfig,
    rng: np.random.Generator,
) -> Float[np.ndarray, "*batch frames 23 3 3"]:
    """Local rotations with each joint turned by `pose_noise_deg` and `posture_noise_deg`: R exp(n),
    with axis-angle vectors n of normal distribution.  The second n is the same in all frames."""
    rotvecs_rad = np.zeros(local_rotmats.shape[:-1])
    if config.pose_noise_deg > 0:
        noise = rng.normal(size=rotvecs_rad.shape)
        if config.pose_noise_time_s > 0:
            noise = _smoothed(noise, config.pose_noise_time_s * config.fps_hz)
        rotvecs_rad += _per_axis_rad(config.pose_noise_deg) * noise
    if config.posture_noise_deg > 0:
        of_window = rng.normal(size=(*rotvecs_rad.shape[:-3], 1, *rotvecs_rad.shape[-2:]))
        rotvecs_rad += _per_axis_rad(config.posture_noise_deg) * of_window
    turns = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3)).as_matrix()
    return local_rotmats @ turns.reshape(local_rotmats.shape).astype(local_rotmats.dtype)


def _per_axis_rad(deg: float) -> float:
    """Three numbers of variance 1 make a vector of mean square length 3."""
    return float(np.deg2rad(deg) / np.sqrt(3))


def _smoothed(noise: np.ndarray, sigma_frames: float) -> np.ndarray:
    """Noise (..., T, 23, 3) smoothed in time, of the variance that it had.

    The window's end is followed by its beginning, so that all frames have the same variance: the
    sum of the squared weights, which is what a single 1 becomes.
    """
    weights = gaussian_filter1d(np.eye(1, noise.shape[-3])[0], sigma_frames, mode="wrap")
    smooth = gaussian_filter1d(noise, sigma_frames, axis=-3, mode="wrap")
    return np.asarray(smooth / np.sqrt((weights**2).sum()))
