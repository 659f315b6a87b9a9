"""Posing a body of another rest pose into SMPL's T-pose."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.training.default_body import FRONT, LEFT, UP, symmetric, t_pose_rotmats, t_posed
from gmrdata.values.body import JOINT, MIRRORED, PARENTS, BodyModel

SIDES = (("left", LEFT), ("right", -LEFT))


def t_skeleton(small_body: BodyModel) -> np.ndarray:
    """Joints (24, 3) of an exact T-pose with the pelvis at the origin."""
    joints_m = small_body.joints_template_m - small_body.joints_template_m[0]
    for side, _ in SIDES:
        for joint in ("elbow", "wrist", "hand"):
            shoulder_m = joints_m[JOINT[f"{side}_shoulder"]]
            joints_m[JOINT[f"{side}_{joint}"], 1:] = shoulder_m[1:]
        for joint in ("knee", "ankle"):
            joints_m[JOINT[f"{side}_{joint}"], ::2] = joints_m[JOINT[f"{side}_hip"], ::2]
        joints_m[JOINT[f"{side}_foot"], 0] = joints_m[JOINT[f"{side}_hip"], 0]
    return joints_m


def swing(rng: np.random.Generator) -> np.ndarray:
    """A leg's rotation away from straight down, without any twist."""
    level = np.array([rng.uniform(-1, 1), 0.0, rng.uniform(-1, 1)])
    return Rotation.from_rotvec(level).as_matrix()


def other_pose(rng: np.random.Generator) -> np.ndarray:
    """(24, 3, 3) rotation of each body part from the T-pose to some other rest pose."""
    parts = np.tile(np.eye(3), (24, 1, 1))
    for side, outward in SIDES:
        arm, hand = Rotation.random(2, random_state=int(rng.integers(2**31))).as_matrix()
        bend = Rotation.from_rotvec(rng.uniform(0.2, 2.0) * np.cross(outward, FRONT)).as_matrix()
        yaw = Rotation.from_rotvec(rng.uniform(-1, 1) * UP).as_matrix()
        legs = {"hip": swing(rng), "knee": swing(rng), "ankle": yaw, "foot": yaw}
        arms = {"shoulder": arm, "elbow": arm @ bend, "wrist": hand, "hand": hand}
        for joint, rotmat in (legs | arms).items():
            parts[JOINT[f"{side}_{joint}"]] = rotmat
    return parts


def posed_by_parts(joints_m: np.ndarray, parts: np.ndarray) -> np.ndarray:
    posed_m = np.zeros_like(joints_m)
    for joint in range(1, 24):
        parent = PARENTS[joint]
        posed_m[joint] = posed_m[parent] + parts[parent] @ (joints_m[joint] - joints_m[parent])
    return posed_m


def rest_pose(joints_m: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """The skeleton in the other pose, with knuckles 3 cm to the front and back of the hand's."""
    knuckles_m = [
        np.array([
            joints_m[JOINT[f"{side}_hand"]] + parts[JOINT[f"{side}_hand"]] @ (offset_m * FRONT)
            for side, _ in SIDES
        ])
        for offset_m in (0.03, -0.03)
    ]  # fmt: skip
    return np.concatenate([joints_m, *knuckles_m])[None]


@given(seed=st.integers(0, 2**32 - 1))
def test_the_t_pose_is_found_from_any_other(seed, small_body):
    rng = np.random.default_rng(seed)
    t_joints_m, parts = t_skeleton(small_body), other_pose(rng)
    joints_m = posed_by_parts(t_joints_m, parts)
    rest = rest_pose(joints_m, parts)
    np.testing.assert_allclose(
        t_pose_rotmats(rest)[0], np.swapaxes(parts, -1, -2), atol=1e-9, rtol=0
    )
    # A point fixed to each body part goes back to where it was in the T-pose.
    offsets_m = rng.normal(size=(24, 3))
    points_m = joints_m + np.einsum("jab,jb->ja", parts, offsets_m)
    found_joints_m, found_m = t_posed(rest, points_m[None], np.eye(24))
    np.testing.assert_allclose(found_joints_m[0], t_joints_m, atol=1e-9)
    np.testing.assert_allclose(found_m[0], t_joints_m + offsets_m, atol=1e-9)


def test_symmetric_takes_the_mean_of_both_sides():
    rng = np.random.default_rng(0)
    even = symmetric(rng.normal(size=(2, 28, 3)))
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(even[:, :24], even[:, list(MIRRORED)] * flip)
    for left, right in ((24, 25), (26, 27)):
        np.testing.assert_allclose(even[:, left], even[:, right] * flip)
    assert np.abs(even[:, 0, 0]).max() == 0.0
    np.testing.assert_allclose(symmetric(even), even)
