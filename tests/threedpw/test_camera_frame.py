"""People as the camera sees them, against SMPL's own formula, the keypoints and the exact clips."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.read.openpose import OPENPOSE_JOINTS
from gmrdata.read.threedpw import Sequence3DPW, read_sequence
from gmrdata.threedpw.clips import WORLD_FROM_3DPW, camera_clip, fitting_body, world_clip
from gmrdata.values.body import shape_on
from gmrdata.values.camera import project_cam
from gmrdata.values.clip import camera_of, load_clip, save_clip
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.values.transforms import apply, rigid
from gmrdata.world.compose import motion_in_camera, motion_in_world

NAME = "courtyard_walk_00"


@pytest.fixture
def sequence(make_dataset) -> Sequence3DPW:
    return read_sequence(make_dataset(), NAME)


@pytest.mark.parametrize("person", [0, 1])
def test_vertices_are_those_of_smpls_formula_moved_by_cam_poses(sequence, small_body, person):
    """x = R (v - J0) + J0 + trans in the world, then cam_poses: no pelvis in it but J0's."""
    clip = camera_clip(sequence, person, [small_body])
    given_person = sequence.arrays.people[person]
    j0_m = small_body.rest_pelvis_m(given_person.betas)
    assert np.linalg.norm(j0_m) > 0.2  # else the offset would be tested on nothing
    at_origin = replace(
        clip.motion, root_rotmats=np.tile(np.eye(3), (30, 1, 1)), pelvis_m=np.tile(j0_m, (30, 1))
    )
    rest_m = motion_vertices_m(small_body, at_origin)
    root = Rotation.from_rotvec(given_person.poses_rad[:, :3]).as_matrix()
    world_m = apply(rigid(root, j0_m + given_person.trans_m), rest_m - j0_m)
    expected_m = apply(sequence.arrays.cam_from_world, world_m)
    found_m = motion_vertices_m(small_body, clip.motion)
    assert np.abs(found_m - expected_m).max() < 2e-6


@given(seed=st.integers(0, 10_000))
def test_the_pelvis_convention_is_the_rule_for_trans(seed):
    """R' = A R and t' = A (J0 + t) + b - J0 say the same as moving the pelvis."""
    rng = np.random.default_rng(seed)
    a, r = Rotation.random(2, random_state=seed).as_matrix()
    b, t, j0, vertex = rng.normal(size=(4, 3))
    moved = a @ (r @ (vertex - j0) + j0 + t) + b
    trans = a @ (j0 + t) + b - j0
    assert np.allclose(a @ r @ (vertex - j0) + j0 + trans, moved, atol=1e-12)


def test_the_camera_clip_meets_the_keypoints(sequence, small_body):
    for person in (0, 1):
        clip = camera_clip(sequence, person, [small_body])
        joints_m = motion_joints_m(small_body, clip.motion)[:, list(OPENPOSE_JOINTS.values())]
        points_px = sequence.arrays.people[person].poses2d_px[:, list(OPENPOSE_JOINTS)]
        seen = points_px[..., 2] > 0
        assert seen.mean() > 0.9
        off_px = project_cam(joints_m, sequence.arrays.intrinsics_px) - points_px[..., :2]
        assert np.abs(off_px[seen]).max() < 1e-6


def test_what_was_written_from_clips_comes_back(sequence, small_body, walkers):
    for person, exact in enumerate(walkers):
        camera = camera_of(exact)
        expected = motion_in_camera(exact.motion, camera.world_from_cam)
        clip = camera_clip(sequence, person, [small_body])
        assert clip.id == f"{NAME}.p{person}"
        assert clip.motion.frame == "camera" and clip.motion.fps_hz == 30.0
        assert clip.motion.gender == ("female", "male")[person]
        assert np.abs(clip.motion.pelvis_m - expected.pelvis_m).max() < 1e-12
        assert np.abs(clip.motion.root_rotmats - expected.root_rotmats).max() < 1e-12
        assert np.abs(clip.motion.local_rotmats - expected.local_rotmats).max() < 1e-12
        assert np.array_equal(clip.motion.shape, exact.motion.shape)
        assert np.array_equal(clip.valid, exact.valid)
        assert np.array_equal(clip.image_numbers, np.arange(30))
        found = camera_of(clip)
        assert not found.has_camera.any() and np.isnan(found.world_from_cam).all()
        assert (found.width_px, found.height_px) == (90, 160)
        assert np.array_equal(found.intrinsics_px, camera.intrinsics_px)


def test_the_datasets_world_is_turned_z_up(sequence, small_body, walkers):
    assert np.allclose(WORLD_FROM_3DPW @ (0, 1, 0, 1), (0, 0, 1, 1))
    for person, exact in enumerate(walkers):
        clip = world_clip(sequence, person, [small_body])
        assert np.abs(clip.motion.pelvis_m - exact.motion.pelvis_m).max() < 1e-12
        assert np.abs(clip.motion.root_rotmats - exact.motion.root_rotmats).max() < 1e-12
        cameras = camera_of(clip).world_from_cam
        assert np.array_equal(camera_of(clip).has_camera, exact.valid)
        off = cameras[exact.valid] - camera_of(exact).world_from_cam[exact.valid]
        assert np.abs(off).max() < 1e-12
        back = motion_in_world(camera_clip(sequence, person, [small_body]).motion, cameras)
        assert np.abs(back.pelvis_m - clip.motion.pelvis_m)[exact.valid].max() < 1e-12


def test_unusable_frames_are_not_valid_and_the_clip_can_be_stored(
    make_dataset, walk_arrays, small_body, tmp_path
):
    first = walk_arrays.people[0]
    cameras, poses = walk_arrays.cam_from_world.copy(), first.poses_rad.copy()
    trans = first.trans_m.copy()
    trans[7], trans[8] = 1e300, -np.inf
    cameras[0] = np.nan
    cameras[1, :3, :3] *= -1.0
    poses[5, 3] = np.nan
    poses[6, 3] = 1e300
    people = (replace(first, poses_rad=poses, trans_m=trans), walk_arrays.people[1])
    root = make_dataset(replace(walk_arrays, cam_from_world=cameras, people=people))
    (root / "imageFiles" / NAME / "image_00029.jpg").unlink()
    clip = camera_clip(read_sequence(root, NAME), 0, [small_body])
    assert np.flatnonzero(~clip.valid).tolist() == [0, 1, 5, 6, 7, 8, 10, 11, 12, 29]
    assert np.isfinite(clip.motion.pelvis_m[clip.valid]).all()
    assert np.isfinite(clip.motion.local_rotmats[clip.valid]).all()
    assert np.isnan(clip.motion.pelvis_m[[0, 1, 7, 8]]).all()
    assert np.isfinite(clip.motion.pelvis_m[10:13]).all()  # not aligned, and yet known
    assert clip.image_numbers[28:].tolist() == [28, -1]
    save_clip(tmp_path / "clip.npz", clip, small_body.rest_pelvis_m(clip.motion.shape))
    again = load_clip(tmp_path / "clip.npz")
    assert np.array_equal(again.valid, clip.valid)
    off_m = again.motion.pelvis_m - clip.motion.pelvis_m
    assert np.abs(off_m[clip.valid]).max() < 1e-12


def test_the_body_of_the_persons_gender_is_taken(walk_arrays, small_body):
    bodies = [replace(small_body, name=f"smpl-{name}") for name in ("neutral", "male", "female")]
    female, male = walk_arrays.people
    assert fitting_body(female, bodies, "x").name == "smpl-female"
    assert fitting_body(male, bodies, "x").name == "smpl-male"
    with pytest.raises(BadBodyFile, match="needs SMPL's female body, given: smpl-neutral, smpl-ma"):
        fitting_body(female, bodies[:2], "x")


def test_a_body_that_the_file_was_not_made_with_is_refused(walk_arrays, small_body):
    person = walk_arrays.people[0]
    elsewhere = replace(small_body, joints_template_m=small_body.joints_template_m + 0.05)
    with pytest.raises(BadBodyFile, match="87 mm from that of jointPositions"):
        fitting_body(person, [elsewhere], "x")
    more = replace(
        small_body,
        shape_dirs_m=np.repeat(small_body.shape_dirs_m, 2, axis=2),
        joint_shape_dirs_m=np.repeat(small_body.joint_shape_dirs_m, 2, axis=2),
    )
    with pytest.raises(BadBodyFile, match="has 10 betas, body small needs 20"):
        fitting_body(person, [more], "x")


def test_longer_betas_are_cut_to_the_bodys(walk_arrays, small_body):
    person = walk_arrays.people[1]
    longer = replace(person, betas=np.concatenate([person.betas, np.full(290, 7.0)]))
    assert np.array_equal(shape_on(small_body, longer.betas), person.betas)
    assert fitting_body(longer, [small_body], "x") is small_body
