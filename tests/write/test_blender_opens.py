"""Blender's own importers play the written GLB and BVH as the body moves: an independent reader."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.joint_names import MIXAMO
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.bvh import write_bvh
from gmrdata.write.glb import write_glb

SCRIPT = Path(__file__).with_name("import_by_blender.py")
ROWS = [0, 7, 19]


def test_blender_plays_what_was_written(
    walk: Callable[..., Motion], small_body: BodyModel, tmp_path: Path
) -> None:
    motion = walk(25.0, 20)
    glb, bvh, out = (tmp_path / name for name in ("body.glb", "motion.bvh", "out.npz"))
    write_glb(glb, motion, small_body)
    write_bvh(bvh, motion, small_body)
    command = [sys.executable, SCRIPT, glb, bvh, 25, out, *ROWS]
    subprocess.run(list(map(str, command)), capture_output=True, check=True)
    found = np.load(out)
    vertices_m = motion_vertices_m(small_body, motion, rows=np.array(ROWS))
    np.testing.assert_allclose(found["vertices_m"], vertices_m, atol=1e-4)
    joints_m = motion_joints_m(small_body, motion)[ROWS]
    order = [JOINT[MIXAMO[str(name)]] for name in found["names"]]
    assert sorted(order) == list(range(24))
    np.testing.assert_allclose(found["joints_m"], joints_m[:, order], atol=1e-4)
