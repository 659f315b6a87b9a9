"""Random turns of the joints, for the network's input alone: an augmentation."""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import WindowConfig


def turned(local_rotmats: np.ndarray, config: WindowConfig, rng: np.random.Generator) -> np.ndarray:
    """Local rotations with each joint turned by `pose_noise_deg`.

    Args:
        local_rotmats: (..., T, 23, 3, 3) parent_from_joint.
        config: Size of the noise, the time over which it stays alike, and the frame rate.
        rng: Source of the noise.

    Returns:
        R exp(n), of the same shape and dtype, with axis-angle vectors n of normal distribution.
    """
    rotvecs_rad = rng.normal(size=local_rotmats.shape[:-1])
    if config.pose_noise_time_s > 0:
        rotvecs_rad = _smoothed(rotvecs_rad, config.pose_noise_time_s * config.fps_hz)
    # Three numbers of variance 1 make a vector of mean square length 3.
    rotvecs_rad *= np.deg2rad(config.pose_noise_deg) / np.sqrt(3)
    turns = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3)).as_matrix()
    return local_rotmats @ turns.reshape(local_rotmats.shape).astype(local_rotmats.dtype)


def _smoothed(noise: np.ndarray, sigma_frames: float) -> np.ndarray:
    """Noise (..., T, 23, 3) smoothed in time, of the variance that it had.

    The window's end is followed by its beginning, so that all frames have the same variance: the
    sum of the squared weights, which is what a single 1 becomes.
    """
    n_frames = noise.shape[-3]
    single = np.zeros(n_frames)
    single[0] = 1.0
    weights = gaussian_filter1d(single, sigma_frames, mode="wrap")
    smooth = gaussian_filter1d(noise, sigma_frames, axis=-3, mode="wrap")
    return np.asarray(smooth / np.sqrt((weights**2).sum()))
