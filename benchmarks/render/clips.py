"""The clips that the measurements render: embedded walks, filmed by each programme."""

from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.film.programmes import (
    Circular,
    Film,
    Linear,
    LinearPanning,
    Panning,
    Programme,
    Small,
    Static,
    film_motion,
    plan_clip,
)
from gmrdata.motion.gait import make_gait
from gmrdata.read.body_file import read_body
from gmrdata.values.clip import Clip, camera_of, save_clip

FPS_HZ = 10.0
HAND: dict[str, Any] = {"handheld_deg": 0.6, "handheld_m": 0.02}
MOVING: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "linear_panning": LinearPanning(),
    "panning": Panning(),
    "small": Small(),
}
PROGRAMMES: dict[str, Programme] = MOVING | {
    "static": Static(),
    "circular_handheld": Circular(**HAND),
    "linear_handheld": Linear(**HAND),
    "linear_panning_handheld": LinearPanning(**HAND),
    "panning_handheld": Panning(**HAND),
}


def walk_clip(
    path: Path,
    body_path: Path,
    programme: Programme,
    n_frames: int,
    size_px: tuple[int, int],
    seed: int = 1,
    every: int = 1,
) -> Path:
    """Write a planned clip of someone who walks; gives its path.

    Args:
        path: The clip file to write.
        body_path: Its body.
        programme: Its camera, planned for n_frames * every frames at 10 fps.
        n_frames: Its frames.
        size_px: (width, height).
        seed: Of the gait and of the camera.
        every: Keep one of so many frames, to see the whole of a long take in a few frames.
    """
    body, rng = read_body(body_path), np.random.default_rng(seed)
    film = Film(
        duration_s=n_frames * every / FPS_HZ,
        fps_hz=FPS_HZ,
        width_px=size_px[0],
        height_px=size_px[1],
    )
    # An embedded gait needs some steps; a short clip is cut from it.
    walk = make_gait("walk", max(film.duration_s, 2.0), 30.0, body, rng)
    clip = plan_clip(path.stem, film_motion(walk, film), programme, film, rng)
    clip = _thinned(clip, every) if every > 1 else clip
    assert clip.motion.n_frames == n_frames
    save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
    return path


def _thinned(clip: Clip, every: int) -> Clip:
    """One of so many frames."""
    motion, camera = clip.motion, camera_of(clip)
    motion = motion.take(slice(None, None, every), motion.fps_hz / every)
    camera = camera.at_rows(slice(None, None, every))
    n = motion.n_frames
    return Clip(clip.id, motion, clip.valid[::every], np.arange(n), camera)
