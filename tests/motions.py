"""Motions that tests make up, and clips of nothing else."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import embedded_motions
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, save_clip
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


def with_motion(clip: Clip, **changes: Any) -> Clip:
    """A clip with another motion, of which the fields are given that change."""
    return replace(clip, motion=replace(clip.motion, **changes))


def with_camera(clip: Clip, **changes: Any) -> Clip:
    """A clip with another camera, of which the fields are given that change."""
    return replace(clip, camera=replace(camera_of(clip), **changes))


def bare_clip(id: str, motion: Motion, valid: np.ndarray | None = None) -> Clip:
    """A clip without a camera and without images, all of whose frames can be used unless said."""
    n = motion.n_frames
    return Clip(id, motion, np.ones(n, bool) if valid is None else valid, np.full(n, -1), None)


def save_bare(path: Path, body: BodyModel, motion: Motion, valid: np.ndarray | None = None) -> Path:
    """Write such a clip, named like its file; gives the file."""
    save_clip(path, bare_clip(path.stem, motion, valid), body.rest_pelvis_m(motion.shape))
    return path


def walking_clips(
    body: BodyModel, ids: Sequence[str], seed: int = 0, *, fps_hz: float = 20.0, duration_s: float
) -> list[Clip]:
    """Generated walks as such clips."""
    rng, length = np.random.default_rng(seed), {"fps_hz": fps_hz, "duration_s": duration_s}
    motions = embedded_motions(body, rng, count=len(ids), **length)
    return [bare_clip(id, motion) for id, motion in zip(ids, motions, strict=True)]
