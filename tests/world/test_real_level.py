"""Up of real people whose true up something else measured: numbers, not pictures.

`real_level.npz` has poses that the built-in estimator found, of a man on a beam before a camera at
rest (Pose2Sim's demo, BSD-3; up by its calibration) and of a dancer before a phone (viser's
record3d_dance, Apache-2.0; up by LiDAR's floor), with some of the dancer's reconstructed points.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.world.level import body_cue, ground_cue, up_of
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m, ground_plane, standing
from gmrdata.world.recipe import ScaleConfig
from tests.world.test_level import angle_deg


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    with np.load(Path(__file__).with_name("real_level.npz")) as file:
        return {key: file[key].astype(np.float64) for key in file.files}


def motion_of(name: str, numbers: dict[str, np.ndarray], body: BodyModel) -> Motion:
    rotvecs, pelvis_m = numbers[f"{name}_rotvecs"], numbers[f"{name}_pelvis_m"]
    rotmats = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(-1, 24, 3, 3)
    shape, fps_hz = np.zeros(body.n_shape), float(numbers[f"{name}_fps_hz"])
    person = body.name, "neutral"
    return Motion(
        rotmats[:, 1:], rotmats[:, 0], pelvis_m, shape, fps_hz, *person, frame="world", source=name
    )


@pytest.mark.parametrize(("name", "trunk_deg", "most_deg"), [("man", 15, 5), ("dancer", 8, 3)])
def test_masses_above_feet_tell_up_where_trunks_lean(name, trunk_deg, most_deg, numbers, anny):
    motion, true = motion_of(name, numbers, anny), numbers[f"{name}_up"]
    assert angle_deg(motion.root_rotmats[:, :, 1].mean(axis=0), true) > trunk_deg
    up, level = up_of(body_cue([anny], [motion]), [])
    assert angle_deg(up, true) < min(most_deg, 2 * level.sigma_deg)


def test_the_dancers_floor_levels_the_world(numbers, anny):
    motion, config = motion_of("dancer", numbers, anny), ScaleConfig()
    soles_m = foot_points_m(anny, motion)[:, :, SOLE_POINTS]
    feet_m = soles_m[standing(soles_m, config.slip_m(motion.fps_hz))]
    bodies = body_cue([anny], [motion])
    plane = ground_plane(numbers["dancer_points_m"], feet_m, bodies.up, 1.0, config)
    assert plane is not None
    up, level = up_of(bodies, [ground_cue(plane.normal, plane.points, plane.rms)])
    assert angle_deg(up, numbers["dancer_up"]) < 1.5
    assert level.sigma_deg < 1.5 and all(cue.used for cue in level.cues)
