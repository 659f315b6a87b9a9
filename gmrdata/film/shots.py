"""Prepare a motion for the camera: cut, frame rate, centre, and the camera's path."""

from dataclasses import replace

import numpy as np
from pydantic import Field

from gmrdata.film.programmes import Programme, camera_path
from gmrdata.motion.resample import resample, slice_motion
from gmrdata.values import limits
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config

RATES_HZ = (30.0, 20.0, 10.0)
"""Multiples of the 10 fps at which GMR works, so that every phase is a set of real frames."""
MIN_FRAMES = 5


class Film(Config):
    """What the clips of a set share."""

    duration_s: float = Field(default=4.8, gt=0, le=limits.LONGEST_S)
    """Longest clip [s]; a longer motion is cut after it."""
    fps_hz: float | None = Field(default=None, ge=1, le=240)
    """Frame rate [Hz]; when left out 30, 20 or 10: the highest within `max_frames`."""
    max_frames: int = Field(default=56, ge=10, le=limits.MOST_FRAMES)
    """Most frames of a clip whose rate is chosen; a long one gets 10 fps and more frames."""
    width_px: int = Field(default=640, ge=64, le=limits.LARGEST_SIDE_PX)
    height_px: int = Field(default=360, ge=64, le=limits.LARGEST_SIDE_PX)
    hfov_deg: float = Field(default=60.0, gt=10, lt=120)
    """Horizontal field of view [degrees]."""


def frame_rate_hz(duration_s: float, film: Film) -> float:
    """The recipe's rate, or the highest multiple of 10 fps within `film.max_frames`."""
    fitting = (rate for rate in RATES_HZ if duration_s * rate <= film.max_frames)
    return film.fps_hz or next(fitting, RATES_HZ[-1])


def film_motion(motion: Motion, film: Film) -> Motion:
    """The part of a motion that is filmed, at its frame rate, with its middle over the origin."""
    duration_s = min(motion.n_frames / motion.fps_hz, film.duration_s)
    rate_hz = min(frame_rate_hz(duration_s, film), motion.fps_hz)
    cut = resample(slice_motion(motion, 0, round(duration_s * motion.fps_hz)), rate_hz)
    if cut.n_frames < MIN_FRAMES:
        enough = f"it takes {MIN_FRAMES / rate_hz:.2f} s, {MIN_FRAMES} frames at {rate_hz:g} Hz"
        what = f"{duration_s:.2f} s are too short to film; {enough}"
        raise BadMotionFile(f"{motion.source}: {what}. Take a longer trial")
    low, high = cut.pelvis_m.min(axis=0), cut.pelvis_m.max(axis=0)
    middle_m = np.array([*(low + high)[:2] / 2, 0.0])
    return replace(cut, pelvis_m=cut.pelvis_m - middle_m)


def plan_clip(
    clip_id: str, motion: Motion, programme: Programme, film: Film, rng: np.random.Generator
) -> Clip:
    """A motion with the camera that is to film it; `rng` chooses what the programme leaves open."""
    lens = film.width_px, film.height_px, film.hfov_deg
    camera = camera_path(programme, motion.pelvis_m, motion.fps_hz, *lens, rng)
    # Nanometres and nanoradians: once in many runs a last bit of the path differed, and a clip's
    # bytes count in the recipe of everything that is made of it.
    camera = replace(camera, world_from_cam=np.round(camera.world_from_cam, 9) + 0.0)
    n = motion.n_frames
    return Clip(clip_id, motion, np.ones(n, dtype=bool), np.arange(n), camera)
