"""How a motion is prepared for the camera."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gmrdata.film import programmes as film
from gmrdata.film.programmes import (
    Circular,
    Film,
    camera_path,
    film_motion,
    frame_rate_hz,
    plan_clip,
)
from gmrdata.motion.gait import make_gait
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile


@pytest.mark.parametrize(
    ("duration_s", "rate_hz"), [(1.44, 30.0), (1.9, 20.0), (2.8, 20.0), (2.9, 10.0), (60.0, 10.0)]
)
def test_short_motions_get_a_higher_rate(duration_s: float, rate_hz: float) -> None:
    assert frame_rate_hz(duration_s, Film(max_frames=56)) == rate_hz


def test_a_rate_that_is_given_is_kept() -> None:
    assert frame_rate_hz(1.0, Film(fps_hz=10)) == 10.0


def test_the_motion_is_cut_and_its_middle_lies_over_the_origin(small_body: BodyModel) -> None:
    rng = np.random.default_rng(3)
    motion = make_gait("walk", 6.0, 30.0, small_body, rng)
    filmed = film_motion(motion, Film(duration_s=4.0))
    assert (filmed.n_frames, filmed.fps_hz) == (40, 10.0)
    np.testing.assert_array_equal(filmed.root_rotmats, motion.root_rotmats[:120:3])
    low, high = filmed.pelvis_m.min(axis=0), filmed.pelvis_m.max(axis=0)
    np.testing.assert_allclose((low + high)[:2], 0, atol=1e-12)
    np.testing.assert_allclose(filmed.pelvis_m[:, 2], motion.pelvis_m[:120:3, 2])
    clip = plan_clip("a", filmed, Circular(), Film(), rng)
    assert clip.camera is not None and clip.camera.n_frames == 40
    assert (clip.camera.width_px, clip.camera.height_px) == (640, 360)


def test_too_short_a_motion_is_named(small_body: BodyModel) -> None:
    motion = make_gait("walk", 0.5, 30.0, small_body, np.random.default_rng(0))
    motion = replace(motion, source="short.bvh")
    with pytest.raises(BadMotionFile, match="0.10 s are too short to film; it takes 0.17 s, 5 f"):
        film_motion(motion, Film(duration_s=0.1))


def test_last_bits_of_a_camera_path_do_not_reach_the_clip(
    small_body: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two runs of one recipe once differed by 2e-15 m in one planned camera."""
    motion = film_motion(make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(1)), Film())
    planned = plan_clip("a", motion, Circular(), Film(), np.random.default_rng(2)).camera

    def noisy(*arguments: Any) -> CameraPath:
        path = camera_path(*arguments)
        return replace(path, world_from_cam=path.world_from_cam + 2e-15)

    monkeypatch.setattr(film, "camera_path", noisy)
    again = plan_clip("a", motion, Circular(), Film(), np.random.default_rng(2)).camera
    assert planned is not None and again is not None
    assert planned.world_from_cam.tobytes() == again.world_from_cam.tobytes()
