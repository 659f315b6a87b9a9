# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky."""

import numpy as np

from blender.textures.base import noise


def sky(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """An equirectangular sky with clouds, row 0 at the zenith and the last row at the nadir."""
    up = np.linspace(1, -1, height_px)[:, None, None]
    blue = np.array([0.30, 0.52, 0.82]) * np.clip(up, 0, 1) ** 0.5
    haze = np.array([0.80, 0.86, 0.92]) * (1 - np.clip(up, 0, 1) ** 0.5)
    half = noise(height_px, width_px // 2, rng, height_px // 5, 7, 0.6)
    clouds = np.clip(np.concatenate([half, half[:, ::-1]], axis=1) * 0.5 - 0.1, 0, 0.85)[..., None]
    return np.asarray((blue + haze) * (1 - clouds) + 0.95 * clouds, dtype=np.float32)
