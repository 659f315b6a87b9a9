"""Motions that tests make up."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values import transforms
from gmrdata.values.motion import Motion

REST: dict[str, Any] = {
    "shape": np.zeros(10), "fps_hz": 10.0, "body": "small", "gender": "neutral", "frame": "world",
    "source": "made up",
}  # fmt: skip


def made_up(local: np.ndarray, root: np.ndarray, pelvis_m: np.ndarray, **given: Any) -> Motion:
    """A motion of the small body in the world at 10 fps, unless something else is given."""
    return Motion(local, root, pelvis_m, **REST | given)


def random_motion(
    rng: np.random.Generator, n_frames: int, spread_rad: float = 2.0, **given: Any
) -> Motion:
    """Any rotations, of so many radians about each axis, any places within some metres, and any
    shape, unless something else is given."""
    rotvecs = rng.normal(0, spread_rad, (n_frames * 24, 3))
    rotmats = Rotation.from_rotvec(rotvecs).as_matrix().reshape(n_frames, 24, 3, 3)
    pelvis_m, shape = rng.normal(0, 3, (n_frames, 3)), rng.normal(0, 0.5, 10)
    return made_up(rotmats[:, 1:], rotmats[:, 0], pelvis_m, **{"shape": shape} | given)


def moved(motion: Motion, b_from_a: np.ndarray) -> Motion:
    """A motion in another world, by a rigid (4, 4)."""
    return replace(
        motion,
        root_rotmats=b_from_a[:3, :3] @ motion.root_rotmats,
        pelvis_m=transforms.apply(b_from_a, motion.pelvis_m),
    )
