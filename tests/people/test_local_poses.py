"""From real frames to people whom the stage of bodies can read, and where a body stands."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people.fit import FitConfig
from gmrdata.people.following import FollowConfig, Networks, follow_people, load_tracks
from gmrdata.people.local_poses import LocalPosesConfig, local_poses, poses_of, seen_landmarks
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.body_file import save_body
from gmrdata.read.frames import read_frames
from gmrdata.read.systems.result import read_system
from gmrdata.values.camera import Lens
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadMotionFile, StaleOutput
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.values.people import POSES_FILE, LocalPosesRecord, load_local_poses
from gmrdata.values.skinning import posed_joints_m
from gmrdata.world.bodies import BodiesConfig, make_bodies
from gmrdata.world.placement import assumed_place
from tests.filming import write_pictures
from tests.frame_sets import frame_set

LENS = Lens((820.0, 820.0), (150.0, 270.0), (300, 540))
TIMES = frame_set(np.array([4, 6, 8]), LENS.size_px, 15.0)


def posed(images_dir: Path, frames: FrameSet, out_dir: Path, networks: Networks) -> Path:
    """Local poses by the default recipe."""
    config = FollowConfig(min_frames=2)
    followed_dir = follow_people(read_frames(images_dir), out_dir / "followed", config, networks)
    poses = LocalPosesConfig()
    return local_poses(followed_dir, Filmed(frames, LENS), ANNY_FILE, out_dir / "poses", poses)


@pytest.fixture(scope="module")
def poses_dir(standing_people, networks, tmp_path_factory) -> Path:
    """One person of a real video, in a part of its pictures."""
    folder = tmp_path_factory.mktemp("local_poses")
    parts = (cv2.imread(str(path))[:, 450:750] for path in standing_people[:3])
    write_pictures(folder / "frames", parts)
    return posed(folder / "frames", TIMES, folder, networks)


def test_the_stage_of_bodies_reads_them(poses_dir, anny):
    record, people = load_local_poses(poses_dir)
    found = read_system(poses_dir, "camera")
    assert found.system == "gmrdata" and len(found.people) == len(people) >= 1
    person = found.people[0]
    assert person.in_camera is not None
    place = assumed_place(person.in_camera, record.size_px, poses_dir)
    assert place.camera is None
    assert person.frame_numbers.tolist() == [4, 6, 8]
    # Upright, on the ground before the camera: the head above the feet, some metres away.
    rotmats = np.concatenate([person.in_camera.root_rotmats[:, None], person.local_rotmats], axis=1)
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    joints_m, _ = posed_joints_m(rest_joints_m, rotmats, place.transl_m)
    assert (joints_m[:, 15, 1] < joints_m[:, 7, 1] - 1.0).all()
    assert (place.transl_m[:, 2] > 1).all() and (place.transl_m[:, 2] < 12).all()


def test_the_body_lies_on_the_person(poses_dir, anny):
    _, people = load_local_poses(poses_dir)
    image_px = load_tracks(poses_dir.with_name("followed"))[0].image_px
    rotmats = np.concatenate([people[0].root_rotmats[:, None], people[0].local_rotmats], axis=1)
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    joints_m, _ = posed_joints_m(rest_joints_m, rotmats, people[0].pelvis_m)
    seen_px = joints_m @ LENS.matrix_px.T
    ankles_px = seen_px[:, [7, 8], :2] / seen_px[:, [7, 8], 2:]
    height_px = np.ptp(image_px[0, :, 1])
    off_px = np.linalg.norm(ankles_px - image_px[:, [27, 28]], axis=-1)
    assert off_px.mean() < 0.12 * height_px


STALLED = replace(TIMES, times_s=np.array([0.0, 1 / 30, 0.2]))


def test_landmarks_have_the_frames_own_times(poses_dir):
    """By the frames' count a stall of 0.13 s lasted as long as any step."""
    track = load_tracks(poses_dir.with_name("followed"))[0]
    seen = seen_landmarks(track, STALLED.numbers, STALLED, LENS)
    assert seen.times_s.tolist() == [0, 1 / 30, 0.2]


def test_other_times_make_other_poses(poses_dir):
    folder, filmed = poses_dir.with_name("followed"), Filmed(STALLED, LENS)
    with pytest.raises(StaleOutput, match="times_s"):
        local_poses(folder, filmed, ANNY_FILE, poses_dir, LocalPosesConfig())


def test_a_fit_that_does_not_stand_still_is_said(poses_dir, anny, capsys):
    track = load_tracks(poses_dir.with_name("followed"))[0]
    seen = seen_landmarks(track, TIMES.numbers, TIMES, LENS)
    poses_of(seen, TIMES.frame_numbers, anny, LocalPosesConfig())
    assert not capsys.readouterr().err
    poses_of(seen, TIMES.frame_numbers, anny, LocalPosesConfig(fit=FitConfig(most_steps=1)))
    said = "person in frames 4 to 8: the fit stopped after 1 steps, before it stood still"
    assert capsys.readouterr().err.strip() == f"poses of a {said}"


def test_another_video_s_poses_are_refused(poses_dir):
    seen = read_system(poses_dir).people[0].in_camera
    assert seen is not None
    with pytest.raises(BadMotionFile, match="it is another video's"):
        assumed_place(seen, (1920, 1080), poses_dir)


def test_poses_for_another_lens_or_body_are_refused(poses_dir, small_body, tmp_path):
    """They stood where the other lens saw them: 17 % too near before one 1.2 times as long."""
    save_body(tmp_path / "small.npz", small_body)
    longer, bent = (replace(LENS, focal_px=(984.0, 984.0)), replace(LENS, radial=(-0.2, 0.0)))
    for lens, body_path, said in (
        (longer, ANNY_FILE, "lens of 820 px, k1 0, and here .* lens of 984 px, k1 0. Leave"),
        (bent, ANNY_FILE, "lens of 820 px, k1 0, and here .* lens of 820 px, k1 -0.2"),
        (LENS, tmp_path / "small.npz", f"the body anny-2 .* the body {small_body.name} "),
    ):
        filmed = Filmed(TIMES, lens)
        with pytest.raises(BadMotionFile, match=said):
            make_bodies(poses_dir, filmed, body_path, tmp_path / "bodies", BodiesConfig())
    about = Filmed(TIMES, replace(LENS, focal_px=(822.0, 822.0)))
    (files,) = make_bodies(poses_dir, about, ANNY_FILE, tmp_path / "bodies", BodiesConfig())
    np.testing.assert_array_equal(
        load_clip(files.clip_path).motion.pelvis_m, load_local_poses(poses_dir)[1][0].pelvis_m
    )


@pytest.mark.parametrize("shipped", ["BODY_FILE", "PRIOR_FILE"])
def test_poses_by_other_shipped_files_are_refused(shipped, poses_dir, tmp_path, monkeypatch):
    """A later version's may be others."""
    other = tmp_path / "other"
    other.write_bytes(b"other")
    monkeypatch.setattr(f"gmrdata.people.local_poses.{shipped}", other)
    followed_dir, config = poses_dir.parent / "followed", LocalPosesConfig()
    with pytest.raises(StaleOutput, match=r"made with other values of inputs\.(landmark|pose)_"):
        local_poses(followed_dir, Filmed(TIMES, LENS), ANNY_FILE, poses_dir, config)


def test_a_video_without_people_has_no_bodies(networks, grey_dir, tmp_path):
    made = posed(grey_dir, frame_set(np.arange(2), (160, 120), 15.0), tmp_path, networks)
    assert LocalPosesRecord.read(made / POSES_FILE).people == 0
    with pytest.raises(BadMotionFile, match="nobody is seen"):
        read_system(made)
