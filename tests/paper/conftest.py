"""A walking person of the small body, filmed by a moving camera, and manifests of such clips."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import Circular, camera_path
from gmrdata.manifest.current import Quality
from gmrdata.motion.gait import embedded_motions
from gmrdata.values.clip import Clip
from tests.clip_manifests import write_clips

WriteSet = Callable[..., Path]


@pytest.fixture(scope="session")
def filmed(small_body) -> tuple[Clip, ...]:
    """Three people over 2 s at 20 fps, each with a camera that circles round; all rows valid."""
    rng = np.random.default_rng(5)
    motions = embedded_motions(small_body, rng, count=3, fps_hz=20.0, duration_s=2.0)
    clips = []
    for number, motion in enumerate(motions):
        camera = camera_path(Circular(), motion.pelvis_m, motion.fps_hz, 640, 480, 60.0, rng)
        n = motion.n_frames
        clips.append(
            Clip(f"walk_{number}", motion, np.ones(n, bool), np.arange(100, 100 + n), camera)
        )
    return tuple(clips)


@pytest.fixture(scope="session")
def write_set(small_body) -> WriteSet:
    """Write clips and a manifest of them; gives the manifest."""

    def write(
        folder: Path, clips: Sequence[Clip], qualities: dict[str, Quality] | None = None
    ) -> Path:
        motions = ["none" if clip.camera is None else "circular" for clip in clips]
        return write_clips(
            folder, small_body, clips, qualities, camera_motions=motions, kind="synthetic"
        )

    return write
