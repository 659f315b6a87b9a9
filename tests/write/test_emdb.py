"""Clips as EMDB's files: opened by pickle itself, and read back to the clip."""

import pickle  # noqa: TID251  The oracle: what EMDB's own scripts open the files with.
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.emdb import sequence_clip
from gmrdata.read.emdb import find_sequences, read_emdb
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadSequence
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.emdb import emdb_name, emdb_sequence, seen_in_image, write_emdb

NAME = "P3_28_outdoor_walk_lunges"
MM, RAD = 1e-4, 1.7e-4  # 0.1 mm, 0.01 degrees


@pytest.fixture(scope="module")
def body(small_body) -> BodyModel:
    return replace(small_body, name="smpl-female")


@pytest.fixture(scope="module")
def clip(walkers, body) -> Clip:
    """A walk in which frames 2 and 10 to 12 are not valid, 4 has no motion and 6 no camera."""
    motion = replace(walkers[0].motion, body=body.name, gender="female")
    camera, valid = camera_of(walkers[0]), walkers[0].valid.copy()
    valid[[2, 4]] = False
    pelvis_m, world_from_cam = motion.pelvis_m.copy(), camera.world_from_cam.copy()
    pelvis_m[4], world_from_cam[6] = np.nan, np.nan
    camera = replace(camera, world_from_cam=world_from_cam, has_camera=np.arange(len(valid)) != 6)
    return Clip(NAME, replace(motion, pelvis_m=pelvis_m), valid, np.arange(len(valid)), camera)


@pytest.fixture
def path(clip, body, tmp_path) -> Path:
    subject, take = emdb_name(NAME)
    path = tmp_path / subject / take / f"{NAME}_data.pkl"
    sequence = emdb_sequence(NAME, clip, body, (False, True))
    write_emdb(path, sequence, *seen_in_image(clip, body))
    return path


def test_pickle_itself_finds_every_key_of_emdb(path, clip, body):
    found = pickle.loads(path.read_bytes())
    n = clip.motion.n_frames
    assert (found["gender"], found["name"], found["n_frames"]) == ("female", NAME, n)
    assert (found["emdb1"], found["emdb2"]) == (False, True)
    bad = [2, 4, 6, 10, 11, 12]
    assert np.flatnonzero(~found["good_frames_mask"]).tolist() == bad
    assert found["bboxes"]["invalid_idxs"].tolist() == bad
    assert found["kp2d"].shape == (n, 24, 2) and found["bboxes"]["bboxes"].shape == (n, 4)
    smpl, camera = found["smpl"], found["camera"]
    assert [smpl[key].shape for key in ("poses_root", "poses_body", "trans", "betas")] == [
        (n, 3), (n, 69), (n, 3), (10,),
    ]  # fmt: skip
    # Vertex by EMDB's own formulas: x = R (v - J0) + J0 + trans, then K E x.
    row, shape = 8, clip.motion.shape
    rest_pelvis_m = body.rest_pelvis_m(shape)
    root = Rotation.from_rotvec(smpl["poses_root"][row]).as_matrix()
    still = replace(
        clip.motion,
        root_rotmats=np.tile(np.eye(3), (n, 1, 1)),
        pelvis_m=np.tile(rest_pelvis_m, (n, 1)),
    )
    vertices_m = motion_vertices_m(body, still, np.array([row]))[0]
    world_m = (vertices_m - rest_pelvis_m) @ root.T + rest_pelvis_m + smpl["trans"][row]
    cam_m = world_m @ camera["extrinsics"][row][:3, :3].T + camera["extrinsics"][row][:3, 3]
    image = cam_m @ camera["intrinsics"].T
    image_px = image[:, :2] / image[:, 2:]
    size_px = [camera["width"], camera["height"]] * 2
    wanted_px = np.concatenate([image_px.min(axis=0), image_px.max(axis=0)]).clip(0, size_px)
    np.testing.assert_allclose(found["bboxes"]["bboxes"][row], wanted_px, atol=0.01)
    assert world_m[:, 1].max() - world_m[:, 1].min() > 1.5  # y is up


def test_the_clip_comes_back(path, clip, body):
    assert find_sequences(path.parents[2]) == [path]
    sequence = read_emdb(path)
    back = sequence_clip(NAME, sequence, body)
    assert np.array_equal(back.valid, sequence.good) and (back.motion.fps_hz, back.id) == (30, NAME)
    known = np.isfinite(clip.motion.pelvis_m).all(axis=1)
    np.testing.assert_allclose(back.motion.shape, clip.motion.shape)
    there, here = (motion_joints_m(body, one.motion)[known] for one in (clip, back))
    assert np.abs(there - here).max() < MM
    turned = np.swapaxes(clip.motion.rotmats[known], -1, -2) @ back.motion.rotmats[known]
    assert Rotation.from_matrix(turned.reshape(-1, 3, 3)).magnitude().max() < RAD
    seen = camera_of(clip).has_camera
    paths = [camera_of(one) for one in (clip, back)]
    np.testing.assert_allclose(*(one.world_from_cam[seen] for one in paths), atol=1e-9)
    assert np.array_equal(paths[1].has_camera, seen)
    assert np.array_equal(paths[0].intrinsics_px, paths[1].intrinsics_px)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: replace(m, fps_hz=25.0), "at 25 Hz, EMDB at 30 Hz"),
        (lambda m: replace(m, body="anny"), "has the body anny, EMDB has SMPL's"),
        (lambda m: replace(m, shape=np.ones(16)), "16 shape coefficients, EMDB has 10"),
        (lambda m: replace(m, frame="camera"), "in the camera's frame"),
    ],
)
def test_what_emdb_has_no_place_for_is_refused(clip, body, change, said):
    with pytest.raises(BadSequence, match=said):
        emdb_sequence(NAME, replace(clip, motion=change(clip.motion)), body, (True, True))


def test_a_good_frame_without_numbers_is_refused(clip, body, tmp_path):
    sequence = emdb_sequence(NAME, clip, body, (True, True))
    sequence = replace(sequence, good=np.ones_like(sequence.good))
    with pytest.raises(BadSequence, match="frame 4 is called good"):
        write_emdb(tmp_path / "a.pkl", sequence, *seen_in_image(clip, body))
    assert not list(tmp_path.iterdir())


def test_names_of_others_get_a_subject():
    assert emdb_name("P12_80_walk") == ("P12", "80_walk")
    assert emdb_name("gait_3") == ("P0", "gait_3")
