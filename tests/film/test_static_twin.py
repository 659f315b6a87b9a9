"""A moving camera's twin that stands still."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.film.programmes import Circular, LinearPanning, Programme, camera_path, static_twin
from gmrdata.values.camera import CameraPath, in_frame, person_box
from gmrdata.values.errors import BadRecipe


def filmed(programme: Programme, length_m: float) -> tuple[CameraPath, np.ndarray]:
    x_m = np.linspace(-length_m / 2, length_m / 2, 41)
    pelvis_m = np.stack([x_m, np.zeros(41), np.full(41, 0.95)], axis=-1)
    rng = np.random.default_rng(4)
    return camera_path(programme, pelvis_m, 10.0, 640, 360, 60.0, rng), pelvis_m


def test_it_stands_where_the_camera_is_at_the_middle_of_the_clip() -> None:
    camera, pelvis_m = filmed(Circular(distance_m=9.0), 2.0)
    twin = static_twin(camera, pelvis_m)
    np.testing.assert_allclose(
        twin.centres_world_m, np.tile(camera.centres_world_m[20], (41, 1)), atol=1e-12
    )
    np.testing.assert_array_equal(twin.world_from_cam, np.tile(twin.world_from_cam[0], (41, 1, 1)))
    # The optical axis goes through the middle of the path, which is over the origin.
    towards = np.array([0.0, 0.0, 0.95]) - twin.centres_world_m[0]
    np.testing.assert_allclose(
        twin.world_from_cam[0, :3, 2], towards / np.linalg.norm(towards), atol=1e-12
    )
    np.testing.assert_array_equal(twin.intrinsics_px, camera.intrinsics_px)


def test_it_steps_back_no_further_than_it_must() -> None:
    camera, pelvis_m = filmed(LinearPanning(distance_m=3.0), 6.0)
    twin = static_twin(camera, pelvis_m)
    assert in_frame(twin, person_box(pelvis_m)).mean() == 1.0
    there, moving = twin.centres_world_m[0], camera.centres_world_m[20]
    assert there[2] == moving[2]
    bearing = [np.arctan2(*place[1::-1]) for place in (there, moving)]
    assert bearing[0] == pytest.approx(bearing[1])
    steps = (np.linalg.norm(there[:2]) - np.linalg.norm(moving[:2])) / 0.25
    assert steps >= 1 and steps == pytest.approx(round(steps))
    nearer = there - np.array([*there[:2], 0]) / np.linalg.norm(there[:2]) * 0.25
    pose = np.array(twin.world_from_cam)
    pose[:, :3, 3] = nearer
    assert in_frame(replace(twin, world_from_cam=pose), person_box(pelvis_m), 0.03).mean() < 1.0


def test_a_path_that_no_static_camera_sees_is_refused() -> None:
    camera, pelvis_m = filmed(LinearPanning(distance_m=6.0), 80.0)
    with pytest.raises(BadRecipe, match="up to 25 m"):
        static_twin(camera, pelvis_m)


def test_a_middle_frame_without_a_camera_is_refused() -> None:
    camera, pelvis_m = filmed(Circular(), 2.0)
    poses = camera.world_from_cam.copy()
    poses[20] = np.nan
    with pytest.raises(BadRecipe, match="middle frame"):
        static_twin(replace(camera, world_from_cam=poses), pelvis_m)


def test_frames_with_a_point_outside_are_told_one_by_one() -> None:
    camera, pelvis_m = filmed(Circular(), 2.0)
    twin = static_twin(camera, pelvis_m)
    points = person_box(pelvis_m)
    points[5, 0] = twin.centres_world_m[0] - twin.world_from_cam[0, :3, 2]  # behind the camera
    points[7, 3] += 50 * twin.world_from_cam[0, :3, 0]  # far to the right
    seen = in_frame(twin, points)
    np.testing.assert_array_equal(np.flatnonzero(~seen), [5, 7])
    assert in_frame(twin, points).mean() == 39 / 41
