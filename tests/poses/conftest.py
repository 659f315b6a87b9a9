"""Motions whose landmarks are known."""

import numpy as np
import pytest

from gmrdata.motion.gait import make_gait
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion


@pytest.fixture(scope="session")
def walk(anny: BodyModel) -> Motion:
    """Two seconds of somebody who walks, before a camera that stands 4 m away."""
    motion = make_gait("walk", 2.0, 15.0, anny, np.random.default_rng(1))
    # x right, y down, z forward: the camera looks along the world's y, 4 m from the middle.
    cam_from_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    middle_m = motion.pelvis_m.mean(0) - [0, 4.0, 0]
    return Motion(
        local_rotmats=motion.local_rotmats,
        root_rotmats=cam_from_world @ motion.root_rotmats,
        pelvis_m=(motion.pelvis_m - middle_m) @ cam_from_world.T,
        shape=motion.shape,
        fps_hz=motion.fps_hz,
        body=motion.body,
        gender=motion.gender,
        frame="camera",
        source=motion.source,
    )
