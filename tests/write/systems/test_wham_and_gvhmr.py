"""WHAM's and GVHMR's results, opened as their own tools open them, and read back."""

import pickle  # noqa: TID251  The oracle: joblib.load is this for a file without its own arrays.
from dataclasses import replace

import numpy as np
import pytest
import torch

from gmrdata.read.systems.result import read_system
from gmrdata.values.body import SMPL_REST_PELVIS_M
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion_metrics import orientation_errors_deg
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import apply, invert, rigid
from gmrdata.write.systems import TrackedPerson, gvhmr_bytes, wham_bytes
from tests.read.system_files import rotmats

MM, DEG = 1e-4, 0.01
Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
SMPLX_PELVIS_M = [0.0031, -0.3514, 0.0120]


@pytest.fixture(scope="module")
def people(walkers, small_body) -> list[TrackedPerson]:
    """Two walkers, of whom the second is not in frames 5 to 7; on a body that passes for SMPL's."""
    n = np.arange(walkers[0].motion.n_frames)
    rows = [n >= 0, (n < 5) | (n > 7)]
    motions = [replace(one.motion, body="smpl-female") for one in walkers]
    return [
        TrackedPerson(motion, small_body.rest_pelvis_m(motion.shape), valid, n + 3)
        for motion, valid in zip(motions, rows, strict=True)
    ]


def test_wham_by_plain_pickle(people, walkers, small_body, tmp_path):
    path, camera = tmp_path / "wham_output.pkl", camera_of(walkers[0])
    path.write_bytes(wham_bytes([replace(one, camera=camera) for one in people]))
    found = pickle.loads(path.read_bytes())
    assert list(found) == [0, 1]
    assert found[1].pop("body") == found[0].pop("body") == "smpl-female"
    assert {key: (value.shape, value.dtype) for key, value in found[1].items()} == {
        "pose": ((27, 72), np.float32), "trans": ((27, 3), np.float32),
        "pose_world": ((27, 72), np.float32), "trans_world": ((27, 3), np.float32),
        "betas": ((27, 10), np.float32), "frame_ids": ((27,), np.int64),
    }  # fmt: skip
    for number, person in enumerate(people):
        one, motion = found[number], person.motion.take(person.rows)
        assert one["frame_ids"].tolist() == person.frame_numbers[person.rows].tolist()
        joints_m = motion_joints_m(small_body, motion)
        for pose, trans, frame_from_world in (
            ("pose_world", "trans_world", rigid(Z_UP_FROM_Y_UP.T, np.zeros(3))),
            ("pose", "trans", invert(camera.world_from_cam[person.rows])),
        ):
            placed = rotmats(one[pose])
            seen = replace(
                motion,
                root_rotmats=placed[:, 0],
                local_rotmats=placed[:, 1:],
                pelvis_m=one[trans] + small_body.rest_pelvis_m(one["betas"][0]),
            )
            wanted_m = apply(frame_from_world, joints_m)
            assert np.abs(motion_joints_m(small_body, seen) - wanted_m).max() < MM


@pytest.mark.parametrize(("last", "n_betas"), [(0.0, 10), (0.3, 16)])
def test_wham_has_its_ten_betas_where_they_are_enough(people, tmp_path, last, n_betas):
    """A body of 10 that was loaded beside one of 16 had 6 zeros more, and SMPL's layers take 10."""
    shape = np.pad(people[0].motion.shape, (0, 16 - len(people[0].motion.shape)))
    shape[15] = last
    person = replace(people[0], motion=replace(people[0].motion, shape=shape))
    betas = pickle.loads(wham_bytes([person]))[0]["betas"]
    np.testing.assert_array_equal(betas[0], shape[:n_betas].astype(np.float32))
    assert betas.shape == (people[0].rows.sum(), n_betas)


def test_wham_comes_back(people, tmp_path):
    path = tmp_path / "wham_output.pkl"
    path.write_bytes(wham_bytes(people))
    assert "pose" not in pickle.loads(path.read_bytes())[0]
    for found, person in zip(read_system(path, "world").people, people, strict=True):
        motion, world = person.motion.take(person.rows), found.in_world
        assert world is not None
        turns = world.z_up_from_file[:, :3, :3]
        assert orientation_errors_deg(turns @ world.root_rotmats, motion.root_rotmats).max() < DEG
        assert orientation_errors_deg(found.local_rotmats, motion.local_rotmats).max() < DEG
        transl_m = world.transl_m + person.rest_pelvis_m
        pelvis_m = (turns @ transl_m[..., None])[..., 0]
        assert np.abs(pelvis_m - motion.pelvis_m).max() < MM
        assert found.frame_numbers.tolist() == person.frame_numbers[person.rows].tolist()
        assert (found.betas_body, path.name) == (motion.body, "wham_output.pkl")


def test_each_person_of_wham_is_seen_by_the_camera_of_their_own_rows(people, walkers, tmp_path):
    """The first one's camera was taken: of a person of fewer frames it ended in a traceback, and
    of other frames it gave wrong places without a word."""
    camera, later = camera_of(walkers[0]), slice(11, 26)
    second = people[1]
    part = TrackedPerson(
        second.motion.take(later), second.rest_pelvis_m, second.rows[later],
        second.frame_numbers[later], camera.at_rows(later),
    )  # fmt: skip
    found = []
    for given in ([replace(people[0], camera=camera), part], [replace(second, camera=camera)]):
        (tmp_path / "wham_output.pkl").write_bytes(wham_bytes(given))
        found.append(pickle.loads((tmp_path / "wham_output.pkl").read_bytes()))
    one, whole = found[0][1], found[1][0]
    same = np.isin(whole["frame_ids"], one["frame_ids"])
    assert one["frame_ids"].tolist() == list(range(14, 29)) and same.sum() == 15
    for key in ("pose", "trans", "pose_world", "trans_world"):
        np.testing.assert_allclose(one[key], whole[key][same], atol=1e-6)


def test_wham_of_another_body_is_of_smpls_mean(people, tmp_path):
    """Its shape means nothing to SMPL, and its pelvis stood 0.22 m low by SMPL's own J0."""
    person = replace(people[0], motion=replace(people[0].motion, body="anny"))
    (tmp_path / "wham_output.pkl").write_bytes(wham_bytes([person]))
    found = pickle.loads((tmp_path / "wham_output.pkl").read_bytes())[0]
    assert found["body"] == "smpl-neutral" and not found["betas"].any()
    pelvis_m = (found["trans_world"] + SMPL_REST_PELVIS_M) @ Z_UP_FROM_Y_UP.T
    assert np.abs(pelvis_m - person.motion.pelvis_m[person.rows]).max() < MM


def test_gvhmr_by_torchs_safe_loader(people, walkers, tmp_path):
    path, person, camera = tmp_path / "hmr4d_results.pt", people[1], camera_of(walkers[0])
    has = np.arange(camera.n_frames) != 9
    known = np.where(has[:, None, None], camera.world_from_cam, np.nan)
    held = replace(camera, world_from_cam=known, has_camera=has)
    path.write_bytes(gvhmr_bytes(replace(person, camera=held)))
    found = torch.load(path, weights_only=True)
    n, motion = person.motion.n_frames, person.motion
    assert {key: tuple(value.shape) for key, value in found["smpl_params_global"].items()} == {
        "body_pose": (n, 63), "betas": (n, 10), "global_orient": (n, 3), "transl": (n, 3),
    }  # fmt: skip
    assert all(value.dtype == torch.float32 for value in found["smpl_params_incam"].values())
    np.testing.assert_allclose(found["K_fullimg"][4], camera.intrinsics_px, rtol=1e-6)
    assert np.flatnonzero(~found["valid"].numpy()).tolist() == [5, 6, 7, 9]
    # SMPL-X's pelvis is at transl + J0, and the root turns about it.
    for key, frame_from_world in (
        ("smpl_params_global", np.tile(rigid(Z_UP_FROM_Y_UP.T, np.zeros(3)), (n, 1, 1))),
        ("smpl_params_incam", invert(camera.world_from_cam)),
    ):
        params = {name: value.numpy().astype(float) for name, value in found[key].items()}
        rows = has if key == "smpl_params_incam" else np.ones(n, dtype=bool)
        assert np.isfinite(params["transl"]).all(axis=1).tolist() == rows.tolist()
        pelvis_m = apply(frame_from_world, motion.pelvis_m[:, None])[:, 0]
        assert np.abs(params["transl"] + SMPLX_PELVIS_M - pelvis_m)[rows].max() < MM
        root = frame_from_world[rows, :3, :3] @ motion.root_rotmats[rows]
        turned = rotmats(params["global_orient"][rows])[:, 0]
        assert orientation_errors_deg(turned, root).max() < DEG
        bent = rotmats(params["body_pose"])
        assert orientation_errors_deg(bent, motion.local_rotmats[:, :21]).max() < DEG
        assert not params["betas"].any()


def test_gvhmr_comes_back(people, tmp_path):
    path = tmp_path / "hmr4d_results.pt"
    path.write_bytes(gvhmr_bytes(people[1]))
    assert set(torch.load(path, weights_only=True)) == {"smpl_params_global", "valid"}
    (found,) = read_system(path, "world").people
    rows, motion = people[1].rows, people[1].motion
    assert found.frame_numbers.tolist() == np.flatnonzero(rows).tolist()
    world = found.in_world
    assert world is not None and found.rest_pelvis_m is not None
    turns = world.z_up_from_file[:, :3, :3]
    assert orientation_errors_deg(turns @ world.root_rotmats, motion.root_rotmats[rows]).max() < DEG
    pelvis_m = (turns @ (world.transl_m + found.rest_pelvis_m)[..., None])[..., 0]
    assert np.abs(pelvis_m - motion.pelvis_m[rows]).max() < MM


def test_frames_without_a_motion_are_left_out_or_refused(people, tmp_path):
    pelvis_m = people[1].motion.pelvis_m.copy()
    pelvis_m[6] = np.nan
    gap = replace(people[1], motion=replace(people[1].motion, pelvis_m=pelvis_m))
    (tmp_path / "a.pkl").write_bytes(wham_bytes([gap]))
    with pytest.raises(BadMotionFile, match="frame 6 has no motion"):
        (tmp_path / "a.pt").write_bytes(gvhmr_bytes(gap))
    with pytest.raises(BadMotionFile, match="frame 6 has no motion"):
        (tmp_path / "b.pkl").write_bytes(wham_bytes([replace(gap, rows=np.ones_like(gap.rows))]))
    with pytest.raises(BadMotionFile, match="no frame that may be used"):
        (tmp_path / "b.pkl").write_bytes(wham_bytes([replace(gap, rows=np.zeros_like(gap.rows))]))
    (tmp_path / "a.pkl").write_bytes(wham_bytes([None, gap]))
    assert list(pickle.loads((tmp_path / "a.pkl").read_bytes())) == [1]
    assert [one.name for one in tmp_path.iterdir()] == ["a.pkl"]
