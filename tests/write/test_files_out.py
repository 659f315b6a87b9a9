"""The written files, read back by other readers: BVH, AMASS's npz, GLB."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.motion.amass import read_amass
from gmrdata.motion.files import read_motion
from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import DEFAULT_READING
from gmrdata.values.body import (
    JOINT,
    JOINT_NAMES,
    PARENTS,
    SMPL_LEG_M,
    WORLD_FROM_REST,
    BodyModel,
    leg_length_m,
)
from gmrdata.values.joint_names import find_joints
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import (
    global_rotmats,
    joint_positions_m,
    motion_joints_m,
    motion_vertices_m,
)
from gmrdata.write.amass import write_amass
from gmrdata.write.bvh import write_bvh
from gmrdata.write.glb import write_glb
from tests.motions import random_motion

Y_UP = WORLD_FROM_REST.T
"""From the z-up world to the files' y-up axes."""


@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    spread_rad=st.sampled_from([0.0, 0.2, 2.0]),
    fps_hz=st.sampled_from([10.0, 24.0, 25.0, 29.97, 30.0, 59.94, 60.0, 120.0]),
    n_frames=st.integers(2, 6),
)
def test_bvh_comes_back_through_our_reader(
    seed, spread_rad, fps_hz, n_frames, small_body, tmp_path_factory
):
    motion = random_motion(np.random.default_rng(seed), n_frames, spread_rad, fps_hz=fps_hz)
    path = tmp_path_factory.getbasetemp() / "some.bvh"
    write_bvh(path, motion, small_body)
    found = read_bvh(path, drop_rest_frame=False)
    assert found.fps_hz == fps_hz
    order = [
        joint
        for _, joint in sorted(
            (s, j) for j, s in find_joints(found.names, found.parents, None, path).items()
        )
    ]
    assert sorted(order) == list(range(24))
    rotmats = motion.rotmats
    rotmats[:, 0] = Y_UP @ rotmats[:, 0]
    np.testing.assert_allclose(found.local_rotmats, rotmats[:, order], atol=1e-6)
    world_from_joint = global_rotmats(found.parents, found.local_rotmats)
    joints_m = joint_positions_m(found.parents, world_from_joint, found.translations_m)
    expected_m = motion_joints_m(small_body, motion) @ Y_UP.T
    np.testing.assert_allclose(joints_m, expected_m[:, order], atol=1e-6)


def test_bvh_turns_the_short_way_between_frames(walk, small_body, tmp_path):
    """What shows a BVH at another rate goes straight from each angle to the next.  At half past a
    frame a leg stood elsewhere as it was lifted over 90 degrees, and the hips as they turned
    through half a turn."""
    n, motion = 30, walk(30.0, 30)
    lifted = Rotation.from_rotvec(np.linspace([0, 0, 0], [-2.5, 0.3, 0.1], n)).as_matrix()
    turned = Rotation.from_rotvec(np.linspace([0, 0, 0], [0, 0, 9], n)).as_matrix()
    local_rotmats = motion.local_rotmats.copy()
    local_rotmats[:, JOINT["left_hip"] - 1] = lifted
    roots = turned @ motion.root_rotmats
    motion = replace(motion, local_rotmats=local_rotmats, root_rotmats=roots)
    write_bvh(tmp_path / "walk.bvh", motion, small_body)
    lines = (tmp_path / "walk.bvh").read_text().splitlines()[-n:]
    angles_deg = np.array([line.split()[3:] for line in lines], dtype=float).reshape(n, 24, 3)
    assert np.abs(np.diff(angles_deg, axis=0)).max() < 35
    between = (angles_deg[1:] + angles_deg[:-1]).reshape(-1, 3) / 2
    found = Rotation.from_euler("ZXY", between, degrees=True)
    ends = [
        Rotation.from_euler("ZXY", rows.reshape(-1, 3), degrees=True)
        for rows in (angles_deg[:-1], angles_deg[1:])
    ]
    halfway = ends[0] * Rotation.from_rotvec((ends[0].inv() * ends[1]).as_rotvec() / 2)
    assert np.rad2deg((found.inv() * halfway).magnitude()).max() < 3


@pytest.mark.parametrize("shape_given", [True, False])
def test_bvh_of_a_walk_comes_back_onto_the_body(shape_given, walk, small_body, tmp_path):
    """All of it, feet, shape, world and rate: the file's skeleton is the body's own."""
    shape = np.random.default_rng(3).normal(0, 1, small_body.n_shape)
    motion = replace(walk(29.97, 40), shape=shape)
    write_bvh(tmp_path / "walk.bvh", motion, small_body)
    found = read_motion(
        tmp_path / "walk.bvh",
        small_body,
        shape=shape if shape_given else None,
        drop_rest_frame=False,
    )
    assert "own skeleton" in found.source and found.fps_hz == 29.97
    rest_m = small_body.rest_joints_m(found.shape) - small_body.rest_joints_m(shape)
    np.testing.assert_allclose(rest_m - rest_m[0], 0.0, atol=1e-7)
    np.testing.assert_allclose(found.rotmats, motion.rotmats, atol=1e-7)
    off_m = motion_joints_m(small_body, found) - motion_joints_m(small_body, motion)
    assert np.abs(off_m).max() < 1e-6


def test_another_skeleton_is_not_taken_for_the_bodys_own(walk, small_body, tmp_path):
    motion = walk(30.0, 40)
    joints_m = small_body.joints_template_m.copy()
    joints_m[JOINT["left_foot"]] += [0.0, 0.001, 0.0]
    write_bvh(tmp_path / "walk.bvh", motion, replace(small_body, joints_template_m=joints_m))
    found = read_motion(tmp_path / "walk.bvh", small_body, drop_rest_frame=False)
    assert "flat foot" in found.source and "own skeleton" not in found.source
    np.testing.assert_array_equal(found.shape, np.zeros(10))


@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    gender=st.sampled_from(["female", "male", "neutral"]),
    on=st.sampled_from(["own", "other", "small"]),
    n_betas=st.sampled_from([10, 16]),
    fps_hz=st.sampled_from([10.0, 29.97, 59.94, 60.0, 120.0]),
)
@example(seed=338, gender="female", on="own", n_betas=10, fps_hz=59.94)
def test_amass_in_and_out_again_has_the_same_numbers(
    seed, gender, on, n_betas, fps_hz, small_body, tmp_path_factory
):
    """On its own body all of them; on one of another gender or kind all but betas and gender."""
    rng, folder = np.random.default_rng(seed), tmp_path_factory.getbasetemp()
    poses = np.zeros((4, 52, 3))
    poses[:, [*range(22), 22, 37]] = rng.normal(0, 0.5, (4, 24, 3))
    arrays: dict[str, Any] = {
        "poses": poses.reshape(4, 156),
        "trans": rng.normal(0, 3, (4, 3)),
        "betas": np.append(rng.normal(size=n_betas), np.zeros(16 - n_betas)),
        "gender": gender,
        "mocap_framerate": fps_hz,
    }
    np.savez(folder / "in_poses.npz", **arrays)
    name = {"own": f"smpl-{gender}", "other": "smpl-male", "small": "small"}[on]
    body = replace(grown_body(small_body, n_betas), name=name)
    is_own = name == f"smpl-{gender}"
    # Some of these people seem to stand along y, and nobody but the reader would ask.
    up_is_said = DEFAULT_READING.model_copy(update={"up": "z"})
    ground = None if is_own else False
    motion = read_amass(folder / "in_poses.npz", body, up_is_said, ground=ground)
    write_amass(folder / "out.npz", motion, body)
    with np.load(folder / "out.npz", allow_pickle=False) as found:
        for key in ("poses", "trans"):
            np.testing.assert_allclose(found[key], arrays[key], atol=1e-12, err_msg=key)
        assert found["mocap_framerate"] == fps_hz
        betas = arrays["betas"] if is_own else np.zeros(16)
        np.testing.assert_array_equal(found["betas"], betas)
        assert found["gender"] == ("neutral" if on == "small" else body.name.removeprefix("smpl-"))


def grown_body(body: BodyModel, n_shape: int) -> BodyModel:
    """A body of other proportions, with so many coefficients."""
    more = ((0, 0), (0, 0), (0, n_shape - body.n_shape))
    return replace(
        body,
        template_m=1.07 * body.template_m,
        joints_template_m=1.07 * body.joints_template_m,
        shape_dirs_m=np.pad(body.shape_dirs_m, more, constant_values=0.003),
        joint_shape_dirs_m=np.pad(body.joint_shape_dirs_m, more, constant_values=0.003),
    )


@pytest.mark.parametrize("name", ["small", "smpl-neutral"])
def test_amass_comes_back_through_our_reader(name, walk, small_body, tmp_path):
    body = replace(small_body, name=name)
    motion = replace(walk(30.0, 20), body=name)
    write_amass(tmp_path / "walk.npz", motion, body)
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as arrays:
        assert arrays["poses"].shape == (20, 156)
        assert arrays["betas"].shape == (16,)
        assert arrays["betas"].any() == (name == "smpl-neutral" and motion.shape.any())
        leg_m = leg_length_m(body.rest_joints_m(motion.shape))
        scale = 1.0 if name == "smpl-neutral" else SMPL_LEG_M / leg_m
        steps_m = np.diff(arrays["trans"], axis=0)
        np.testing.assert_allclose(steps_m, scale * np.diff(motion.pelvis_m, axis=0), atol=1e-12)
    found = read_amass(tmp_path / "walk.npz", body, shape=motion.shape, ground=False)
    assert found.fps_hz == 30.0
    np.testing.assert_allclose(found.local_rotmats, motion.local_rotmats, atol=1e-9)
    np.testing.assert_allclose(found.root_rotmats, motion.root_rotmats, atol=1e-9)
    np.testing.assert_allclose(found.pelvis_m, motion.pelvis_m, atol=1e-9)


class Glb:
    """A reader of what the glTF specification says of skins and animations, and nothing else."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        json_length, json_type = struct.unpack_from("<I4s", data, 12)
        assert json_type == b"JSON" and json_length % 4 == 0
        self.tree: dict[str, Any] = json.loads(data[20 : 20 + json_length])
        bin_length, bin_type = struct.unpack_from("<I4s", data, 20 + json_length)
        assert bin_type == b"BIN\0" and 28 + json_length + bin_length == len(data)
        self.data = data[28 + json_length :]

    def array(self, number: int) -> np.ndarray:
        accessor = self.tree["accessors"][number]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        dtype = {5121: "<u1", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        found = np.frombuffer(
            self.data, dtype, accessor["count"] * columns, view["byteOffset"]
        ).reshape(-1, columns)
        assert found.nbytes == view["byteLength"]
        if "min" in accessor:
            assert found.min(0).tolist() == accessor["min"]
            assert found.max(0).tolist() == accessor["max"]
        return found.astype(np.float64)

    def node_transforms(self, time_s: float) -> dict[int, np.ndarray]:
        """World transforms of all nodes with the animation at a time."""
        values: dict[tuple[int, str], np.ndarray] = {}
        (animation,) = self.tree["animations"]
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            times = self.array(sampler["input"])[:, 0]
            output = self.array(sampler["output"])
            at_s = np.clip(time_s, times[0], times[-1])  # single precision in the file
            node, path = channel["target"]["node"], channel["target"]["path"]
            if path == "rotation":
                values[node, path] = Slerp(times, Rotation.from_quat(output))(at_s).as_quat()
            else:
                values[node, path] = np.array([np.interp(at_s, times, c) for c in output.T])
        found: dict[int, np.ndarray] = {}

        def visit(node: int, parent: np.ndarray) -> None:
            entry = self.tree["nodes"][node]
            local = np.eye(4)
            rotation = values.get((node, "rotation"), entry.get("rotation", [0, 0, 0, 1]))
            local[:3, :3] = Rotation.from_quat(rotation).as_matrix()
            local[:3, 3] = values.get((node, "translation"), entry.get("translation", [0, 0, 0]))
            found[node] = parent @ local
            for child in entry.get("children", []):
                visit(child, found[node])

        for root in self.tree["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return found

    def skinned(self, time_s: float) -> np.ndarray:
        """Vertices of the one skinned mesh, (V, 3), y up."""
        (skin,) = self.tree["skins"]
        attributes = self.tree["meshes"][0]["primitives"][0]["attributes"]
        transforms = self.node_transforms(time_s)
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
        matrices = np.stack([transforms[node] for node in skin["joints"]]) @ inverse
        points = np.pad(self.array(attributes["POSITION"]), ((0, 0), (0, 1)), constant_values=1.0)
        joints = self.array(attributes["JOINTS_0"]).astype(int)
        weights = self.array(attributes["WEIGHTS_0"])
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)
        blended = (weights[..., None, None] * matrices[joints]).sum(axis=1)
        return (blended @ points[..., None])[:, :3, 0]


def written_glb(path: Path, motion: Motion, body: BodyModel) -> Glb:
    write_glb(path, motion, body)
    return Glb(path.read_bytes())


def test_glb_moves_as_the_body_does(walk, small_body, tmp_path):
    motion = walk(30.0, 40)
    glb = written_glb(tmp_path / "body.glb", motion, small_body)
    vertices_m = motion_vertices_m(small_body, motion)
    for row in (0, 1, 17, 39):
        np.testing.assert_allclose(glb.skinned(row / 30.0), vertices_m[row] @ Y_UP.T, atol=2e-5)
    names = [node["name"] for node in glb.tree["nodes"]]
    assert names == [*JOINT_NAMES, "z_up_world", "body"]
    parents = {c: n for n, node in enumerate(glb.tree["nodes"]) for c in node.get("children", [])}
    assert [parents[joint] for joint in range(1, 24)] == list(PARENTS[1:])


def test_glb_turns_the_short_way_between_frames(small_body, tmp_path):
    """Quaternions whose signs jumped would swing through half a turn between two frames."""
    motion = random_motion(np.random.default_rng(1), 5)
    glb = written_glb(tmp_path / "body.glb", motion, small_body)
    (animation,) = glb.tree["animations"]
    for sampler in animation["samplers"][:24]:
        quaternions = glb.array(sampler["output"])
        assert ((quaternions[1:] * quaternions[:-1]).sum(axis=1) >= 0).all()


def test_trimesh_opens_the_glb(walk, small_body, tmp_path):
    motion = walk(30.0, 10)
    write_glb(tmp_path / "body.glb", motion, small_body)
    scene = trimesh.load(tmp_path / "body.glb", process=False)
    (mesh,) = scene.geometry.values()
    rest_m = small_body.template_m + small_body.shape_dirs_m @ motion.shape
    np.testing.assert_allclose(mesh.vertices, rest_m, atol=1e-6)
    assert np.array_equal(mesh.faces, small_body.faces)
    assert {"left_knee", "z_up_world", "body"} <= set(scene.graph.nodes)


def test_the_same_motion_gives_the_same_bytes(walk, small_body, tmp_path):
    motion = walk(30.0, 10)
    for name, write in (("a.bvh", write_bvh), ("a.glb", write_glb), ("a.npz", write_amass)):
        for path in (tmp_path / name, tmp_path / f"again_{name}"):
            write(path, motion, small_body)
        assert (tmp_path / name).read_bytes() == (tmp_path / f"again_{name}").read_bytes()
