"""The default body: what the mesh, its T-pose, its shapes and its skinning must be."""

import os
import socket
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmrdata.read.anny import BONES, build_anny, principal_directions, quantised
from gmrdata.read.bodies import anny_file, save_body
from gmrdata.values.body import JOINT, JOINT_NAMES, MIRRORED, BodyModel
from gmrdata.values.skinning_torch import posed_vertices
from tests.torch_joints import posed_joints

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


def test_mesh_is_one_closed_skin_that_faces_outward(anny: BodyModel) -> None:
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
def test_every_shape_stands_in_the_t_pose(anny: BodyModel, coefficient: float) -> None:
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


def test_palms_face_down_and_soles_are_level(anny: BodyModel) -> None:
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


def test_body_is_symmetric(anny: BodyModel) -> None:
    np.testing.assert_allclose(
        anny.joints_template_m[list(MIRRORED)] * FLIP, anny.joints_template_m, atol=1e-6
    )
    distance_m, twin = cKDTree(anny.template_m).query(anny.template_m * FLIP)
    assert distance_m.max() < 2e-4
    weights_apart = np.abs(anny.skin_weights[twin][:, list(MIRRORED)] - anny.skin_weights)
    assert weights_apart.max() < 5e-3


def test_shapes_are_adults(anny: BodyModel) -> None:
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


def test_fingers_follow_the_hand_and_the_skull_the_head(anny: BodyModel) -> None:
    tip_m = anny.joints_template_m[JOINT["left_hand"], 0] + 0.03
    fingers = anny.template_m[:, 0] > tip_m
    assert fingers.sum() > 100
    assert anny.skin_weights[fingers, JOINT["left_hand"]].min() > 0.99
    skull = anny.template_m[:, 1] > anny.joints_template_m[JOINT["head"], 1] + 0.1
    assert anny.skin_weights[skull, JOINT["head"]].min() > 0.99


def test_bent_toes_leave_the_heel_and_bend_whole(anny: BodyModel) -> None:
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


def test_raised_arm_and_bent_knee_keep_the_skin_whole(anny: BodyModel) -> None:
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


def test_renders_may_be_passed_on(anny: BodyModel) -> None:
    assert anny.name == "anny"
    assert "CC0-1.0" in anny.licence
    assert anny.pose_dirs_m is None


def test_each_joint_has_its_own_mixamo_bone() -> None:
    bones = [BONES[joint] for joint in JOINT_NAMES]
    assert len(set(bones)) == 24
    assert BONES["spine3"] == "mixamorig:Spine2"
    assert BONES["left_shoulder"] == "mixamorig:LeftArm"
    assert BONES["right_hand"] == "mixamorig:RightHandMiddle1"


def test_principal_directions_find_what_bodies_were_made_of() -> None:
    rng = np.random.default_rng(0)
    mean_m = rng.normal(size=(40, 3))
    axes = np.linalg.qr(rng.normal(size=(120, 3)))[0]
    made = rng.normal(size=(200, 3))
    made = (made - made.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(made.T))).T
    spread_m = np.array([0.5, 0.2, 0.1])
    points_m = mean_m + ((made * spread_m) @ axes.T).reshape(200, 40, 3)
    found_mean_m, dirs_m = principal_directions(points_m, 3)
    np.testing.assert_allclose(found_mean_m, mean_m, atol=1e-12)
    for k in range(3):
        direction = axes[:, k].reshape(40, 3) * spread_m[k]
        sign = np.sign((direction * mean_m).sum())
        np.testing.assert_allclose(dirs_m[..., k], sign * direction, atol=1e-10)


@pytest.mark.slow
def test_building_again_gives_the_same_file_and_leaves_nothing(
    anny: BodyModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Offline, with a killed build's leftovers in the way."""
    from anny.paths import get_anny_cache_path, get_anny_root_dir

    def no_network(*_: object) -> None:
        raise AssertionError("building the body wants the network")

    monkeypatch.setattr(socket.socket, "connect", no_network)
    cached = anny_file()
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    environment, cache, random_state = (
        dict(os.environ),
        get_anny_cache_path(),
        torch.get_rng_state(),
    )
    package = {
        p: p.stat().st_mtime_ns for p in get_anny_root_dir().rglob("*") if p.suffix != ".pyc"
    }
    work_dir = tmp_path / "work.partial"
    work_dir.mkdir()
    (work_dir / "left behind").write_text("cut off")
    save_body(tmp_path / "again.npz", build_anny(work_dir))
    assert (tmp_path / "again.npz").read_bytes() == cached.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.npz", "home"]
    assert list(home.iterdir()) == []
    assert dict(os.environ) == environment
    assert get_anny_cache_path() == cache
    assert torch.equal(torch.get_rng_state(), random_state)
    after = {p: p.stat().st_mtime_ns for p in get_anny_root_dir().rglob("*") if p.suffix != ".pyc"}
    assert {p for p in after if after[p] != package.get(p) and p.is_file()} == set()


def test_last_bits_of_sums_do_not_reach_the_file() -> None:
    """Two builds on one machine once differed by 1e-20 m in vertices of the midline."""
    lengths_m = np.array([0.0, 0.25, -1.3, 1e-4])
    noise_m = np.array([-1.4e-20, 3e-17, -2e-16, 1e-19])
    assert quantised(lengths_m).tobytes() == quantised(lengths_m + noise_m).tobytes()
    np.testing.assert_allclose(quantised(lengths_m), lengths_m, rtol=0, atol=0.5e-7)
