"""Which joints the camera sees, on a body of boxes with a wall beside it and someone passing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.read.body_file import save_body
from gmrdata.values.body import JOINT, JOINT_NAMES, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from tests.blender.jobs import ask_blender, facing_x

PLACES_M = {
    "front": (4.0, 0.0, 1.2),
    "left": (0.0, 4.0, 1.0),
    "behind the wall": (-4.0, 0.0, 1.0),
    "passer-by in front": (4.0, 0.0, 1.0),
    "passer-by behind": (4.0, 0.0, 1.0),
}
PASSER_BY_X_M = (9.0, 9.0, 9.0, 1.0, -3.0)
"""Where someone else stands in each of these cases, in the same pose."""
WALL_M = [(-1.0, -2.0, 0.0), (-1.0, 2.0, 0.0), (-1.0, 2.0, 0.8), (-1.0, -2.0, 0.8)]


def about_z(angle_rad: float) -> np.ndarray:
    return Rotation.from_euler("z", angle_rad).as_matrix()


def standing(body: BodyModel) -> Motion:
    """Facing +x, the left arm hanging down, the right forearm folded behind the back."""
    n_frames = len(PLACES_M)
    local = np.tile(np.eye(3), (n_frames, 23, 1, 1))
    local[:, JOINT["left_shoulder"] - 1] = about_z(-1.4)
    local[:, JOINT["right_shoulder"] - 1] = about_z(1.4)
    # The right forearm, along -x in the rest pose, points to the left, a little down and back.
    along = np.array([0.9, -0.1, -0.4]) / np.linalg.norm([0.9, -0.1, -0.4])
    third = np.cross(-along, [0.0, 1.0, 0.0])
    third /= np.linalg.norm(third)
    elbow = np.stack([-along, np.cross(third, -along), third], axis=1)
    local[:, JOINT["right_elbow"] - 1] = about_z(1.4).T @ elbow
    return facing_x(body, [[0.0, 0.0, 0.95]] * n_frames, local)


@pytest.fixture(scope="module")
def seen(small_body, tmp_path_factory) -> dict[str, set[str]]:
    """Names of the visible joints for each place of the camera."""
    folder = tmp_path_factory.mktemp("visibility")
    motion = standing(small_body)
    joints_m = motion_joints_m(small_body, motion)
    aside_m = np.c_[PASSER_BY_X_M, np.zeros((len(PLACES_M), 2))]
    passer_by = replace(motion, pelvis_m=motion.pelvis_m + aside_m)
    np.savez(
        folder / "case.npz",
        vertices_m=motion_vertices_m(small_body, motion),
        passer_by_m=motion_vertices_m(small_body, passer_by),
        joints_m=joints_m,
        centres_m=np.array(list(PLACES_M.values())),
        wall_m=np.array(WALL_M),
    )
    save_body(folder / "body.npz", small_body)
    files = folder / "case.npz", folder / "body.npz"
    visible = ask_blender("visibility_by_blender.py", *files)
    return {
        place: {name for name, yes in zip(JOINT_NAMES, row, strict=True) if yes}
        for place, row in zip(PLACES_M, visible, strict=True)
    }


LEFT = {name for name in JOINT_NAMES if name.startswith("left")}
RIGHT = {name for name in JOINT_NAMES if name.startswith("right")}
LOWER_LEGS = {f"{side}_{name}" for side in ("left", "right") for name in ("knee", "ankle", "foot")}


def test_from_the_front_only_the_wrist_behind_the_back_is_hidden(seen):
    assert set(JOINT_NAMES) - seen["front"] == {"right_wrist"}


def test_from_the_side_the_body_hides_its_other_side(seen):
    # But for the forearm, which sticks out behind the back.
    assert seen["left"] & RIGHT == {"right_wrist", "right_hand"}
    # The left hand hangs before the hip.
    assert seen["left"] & LEFT == LEFT - {"left_hip"}
    assert {"head", "neck"} <= seen["left"] and "pelvis" not in seen["left"]


def test_from_behind_the_hand_shows_and_a_low_wall_hides_the_legs(seen):
    assert seen["behind the wall"] & LOWER_LEGS == set()
    assert {"right_wrist", "head", "neck", "left_shoulder"} <= seen["behind the wall"]


def test_a_passer_by_hides_what_is_behind_them_and_nothing_else(seen):
    trunk = {"pelvis", "spine1", "spine2", "spine3", "neck", "head"}
    assert seen["passer-by in front"] & trunk == set()
    assert seen["passer-by behind"] == set(JOINT_NAMES) - {"right_wrist"}
