"""Blender's own importers play the written GLB, BVH and USD files: an independent reader."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.values.body import JOINT, JOINT_NAMES
from gmrdata.values.joint_names import MIXAMO
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.bvh import write_bvh
from gmrdata.write.glb import write_glb
from gmrdata.write.usd import write_usd
from tests.blender.jobs import in_blender
from tests.write.takes import SIZE_PX, make_take

SCRIPT = Path(__file__).with_name("import_by_blender.py")
ROWS = [0, 7, 11]
OPENCV_FROM_BLENDER = np.diag([1.0, -1.0, -1.0, 1.0])


def test_blender_plays_what_was_written(walk, small_body, tmp_path):
    """Of one person, so that the importer's objects need no names."""
    take = make_take(walk, small_body, 25.0)
    person, camera = take.people[0], take.camera
    assert camera is not None
    motion, out = walk(25.0, 20), tmp_path / "out.npz"
    paths = [tmp_path / name for name in ("body.glb", "motion.bvh", "take.usdc", "take.glb")]
    write_glb(paths[0], motion, small_body)
    write_bvh(paths[1], motion, small_body)
    write_usd(paths[2], replace(take, people=(person,)))
    write_glb(paths[3], person.motion, person.body, camera=camera)
    in_blender(SCRIPT, *paths, 25, out, *ROWS)
    found = np.load(out)
    vertices_m = motion_vertices_m(small_body, motion, rows=np.array(ROWS))
    np.testing.assert_allclose(found["glb_vertices_m"], vertices_m, atol=1e-4)
    joints_m = motion_joints_m(small_body, motion)[ROWS]
    order = [JOINT[MIXAMO[str(name)]] for name in found["bvh_names"]]
    assert sorted(order) == list(range(24))
    np.testing.assert_allclose(found["bvh_joints_m"], joints_m[:, order], atol=1e-4)
    joints_m = motion_joints_m(person.body, person.motion)[ROWS]
    order = [JOINT_NAMES.index(str(name)) for name in found["names"]]
    assert sorted(order) == list(range(24))
    np.testing.assert_allclose(found["joints_m"], joints_m[:, order], atol=1e-5)
    vertices_m = motion_vertices_m(person.body, person.motion, rows=np.array(ROWS))
    np.testing.assert_allclose(found["vertices_m"], vertices_m, atol=1e-5)
    for name in ("world_from_camera", "glb_world_from_camera"):
        seen = found[name] @ OPENCV_FROM_BLENDER
        np.testing.assert_allclose(seen, camera.world_from_cam[ROWS], atol=1e-5)
    # Blender's camera: the sensor's width stands for 160 pixels, shifts are in widths.
    focal = found["lens_mm"] / found["sensor_mm"]
    np.testing.assert_allclose(focal * SIZE_PX, [150.0, 160.0], atol=1e-4)
    np.testing.assert_allclose(found["shift"][0], (80 - 71.5) / 160, atol=1e-6)
    np.testing.assert_allclose(found["shift"][1], (55.25 - 48) / 160 * 150 / 160, atol=1e-6)
    # Of a GLB's camera it keeps the vertical field of view.
    focal_px = found["glb_lens_mm"] / found["glb_sensor_mm"] * SIZE_PX[1]
    assert focal_px == pytest.approx(160.0, abs=1e-3)
