"""Up of real people whose true up something else measured: numbers, not pictures.

`real_level.npz` has poses that the built-in estimator found, of a man on a beam before a camera at
rest (Pose2Sim's demo, BSD-3; up by its calibration) and of a dancer before a phone (viser's
record3d_dance, Apache-2.0; up by LiDAR's floor), with some of the dancer's reconstructed points.
"""

from pathlib import Path

import numpy as np
import pytest

from gmrdata.motion.ground import motion_of
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import angles_deg, rotmats_from_rotvecs
from gmrdata.world.level import body_cue, ground_cue, up_of
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m, ground_plane, standing
from gmrdata.world.recipe import ScaleConfig


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    with np.load(Path(__file__).with_name("real_level.npz")) as file:
        return {key: file[key].astype(np.float64) for key in file.files}


def seen(name: str, numbers: dict[str, np.ndarray], body: BodyModel) -> Motion:
    """The poses that the estimator found."""
    rotmats, shape = rotmats_from_rotvecs(numbers[f"{name}_rotvecs"]), np.zeros(body.n_shape)
    fps_hz = float(numbers[f"{name}_fps_hz"])
    return motion_of(body, shape, rotmats, numbers[f"{name}_pelvis_m"], fps_hz, name)


@pytest.mark.parametrize(("name", "trunk_deg", "most_deg"), [("man", 15, 5), ("dancer", 8, 3)])
def test_masses_above_feet_tell_up_where_trunks_lean(name, trunk_deg, most_deg, numbers, anny):
    motion, true = seen(name, numbers, anny), numbers[f"{name}_up"]
    assert angles_deg(motion.root_rotmats[:, :, 1].mean(axis=0), true) > trunk_deg
    up, level = up_of([body_cue([anny], [motion])], [])
    assert angles_deg(up, true) < min(most_deg, 2 * level.sigma_deg)


def test_the_dancers_floor_levels_the_world(numbers, anny):
    motion, config = seen("dancer", numbers, anny), ScaleConfig()
    soles_m = foot_points_m(anny, motion)[:, :, SOLE_POINTS]
    feet_m = soles_m[standing(soles_m, config.slip_m(motion.fps_hz))]
    bodies = body_cue([anny], [motion])
    plane = ground_plane(numbers["dancer_points_m"], feet_m, bodies.up, 1.0, config)
    assert plane is not None
    up, level = up_of([bodies], [ground_cue(plane.normal, plane.points, plane.rms)])
    assert angles_deg(up, numbers["dancer_up"]) < 1.5
    assert level.sigma_deg < 1.5 and all(cue.used for cue in level.cues)
