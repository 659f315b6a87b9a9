"""Cameras against known points."""

import numpy as np
import pytest

from gmrdata.cameras.map.models import place_frames
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.values import transforms
from gmrdata.values.camera import project


def test_a_left_out_frame_is_placed_by_the_points_of_its_neighbours() -> None:
    rng = np.random.default_rng(0)
    intrinsics_px = np.array([[300.0, 0, 160], [0, 300.0, 90], [0, 0, 1]])
    points = rng.uniform([-2, -1, 4], [2, 1, 7], (80, 3))
    cameras = np.tile(np.eye(4), (3, 1, 1))
    cameras[:, 0, 3] = [0.0, 0.3, 0.6]
    keypoints = [project(camera, points, intrinsics_px) for camera in cameras]
    every = np.arange(80)
    shuffled = rng.permutation(80)
    keypoints[1] = keypoints[1][np.argsort(shuffled)]
    pair = PairMatches(0, 1, np.stack([every, shuffled], axis=1), "CALIBRATED")
    seen = dict(enumerate(points))
    world_from_cam = cameras.copy()
    world_from_cam[[1, 2]] = np.nan
    observations = np.array([80, 0, 0])
    matches = Matches(keypoints, [pair])
    placed = place_frames([1, 2], world_from_cam, observations, {0: seen}, matches, intrinsics_px)
    assert placed == 1 and observations.tolist() == [80, 80, 0]
    assert world_from_cam[1] == pytest.approx(cameras[1], abs=1e-6)
    assert np.isnan(world_from_cam[2]).all()
    assert np.allclose(transforms.invert(world_from_cam[1]) @ cameras[1], np.eye(4), atol=1e-6)
