"""A reconstruction's cameras and points in the metric world of the clip that was made of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras import files
from gmrdata.cameras.match.tracks import TRACKS_FILE, Tracks, save_tracks
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadMotionFile, BadRecord
from gmrdata.world.compose import load_background, load_background_tracks
from tests.reconstructions import good_quality

SCALE, N_FRAMES = 0.37, 30
TURN = Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix()
AWAY_M = np.array([3.0, -1.0, 2.0])
POINTS = np.random.default_rng(2).normal(0, 5, (40, 3))


def in_sfm(camera: CameraPath) -> CameraPath:
    """The clip's cameras in the unit and the world of a reconstruction."""
    centres = (camera.centres_world_m - AWAY_M) @ TURN / SCALE
    rotmats = TURN.T @ camera.world_from_cam[:, :3, :3]
    return replace(camera, world_from_cam=transforms.rigid(rotmats, centres))


@pytest.fixture
def sfm_dir(walkers, tmp_path) -> Path:
    clip = walkers[0]
    marks = np.zeros(N_FRAMES, dtype=bool)
    cameras = files.SfmCameras(in_sfm(camera_of(clip)), "full", clip.image_numbers, marks)
    files.save_cameras(tmp_path / files.CAMERAS_FILE, cameras)
    files.save_points(tmp_path / files.POINTS_FILE, POINTS, np.full(len(POINTS), 2))
    good_quality(N_FRAMES).write(tmp_path / files.QUALITY_FILE)
    return tmp_path


def test_points_and_cameras_are_in_the_clips_world(walkers, sfm_dir):
    clip = walkers[0]
    found = load_background(sfm_dir, clip)
    np.testing.assert_allclose(
        found.camera.world_from_cam, camera_of(clip).world_from_cam, atol=1e-9
    )
    np.testing.assert_allclose(found.points_m, SCALE * POINTS @ TURN.T + AWAY_M, atol=1e-9)
    some = replace(clip, image_numbers=np.where(clip.image_numbers < 20, -1, clip.image_numbers))
    again = load_background(sfm_dir, some)  # the frames that both have fix it
    np.testing.assert_allclose(again.points_m, found.points_m, atol=1e-9)


def test_without_a_clip_it_is_in_its_own_world(walkers, sfm_dir):
    found = load_background(sfm_dir, None)
    assert np.array_equal(found.points_m, POINTS)
    expected = in_sfm(camera_of(walkers[0])).world_from_cam
    assert np.array_equal(found.camera.world_from_cam, expected)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: np.concatenate([m[:1], m[:-1]]), "is of other cameras"),
        (lambda m: transforms.rigid(m[:, :3, :3], m[0, :3, 3]), "has no metric scale"),
        (lambda m: np.full_like(m, np.nan), "has no frame of clip"),
    ],
)
def test_a_clip_of_other_cameras_is_refused(change, said, walkers, sfm_dir):
    camera = camera_of(walkers[0])
    world_from_cam = change(camera.world_from_cam)
    known = np.isfinite(world_from_cam[:, 0, 0])
    other = replace(
        walkers[0], camera=replace(camera, world_from_cam=world_from_cam, has_camera=known)
    )
    with pytest.raises(BadRecord, match=said):
        load_background(sfm_dir, other)


@pytest.mark.parametrize(("row", "point"), [(N_FRAMES, 0), (0, len(POINTS))])
def test_tracks_of_another_reconstruction_are_refused(row, point, walkers, sfm_dir):
    found = load_background(sfm_dir, walkers[0])
    names = tuple(f"{number:05d}.jpg" for number in range(N_FRAMES))
    good = Tracks(
        np.array([0, 3]), np.array([0, 39]), np.ones((2, 2)), np.ones(N_FRAMES, dtype=bool), names
    )
    save_tracks(sfm_dir / TRACKS_FILE, good)
    read = load_background_tracks(sfm_dir, found)
    assert np.array_equal(read.points, good.points) and read.image_names == names
    bad = replace(good, rows=np.array([0, row]), points=np.array([0, point]))
    save_tracks(sfm_dir / TRACKS_FILE, bad)
    with pytest.raises(BadRecord, match="its files are of different frames"):
        load_background_tracks(sfm_dir, found)
    # Colours are read from the images: a record of others must not name other files.
    for name in ("../../secret.jpg", "/secret.jpg", ""):
        save_tracks(sfm_dir / TRACKS_FILE, replace(good, image_names=(*names[1:], name)))
        with pytest.raises(BadRecord, match=f"'{name}' is no image's name"):
            load_background_tracks(sfm_dir, found)
    path = sfm_dir / TRACKS_FILE
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(BadMotionFile, match="not a readable .npz"):
        load_background_tracks(sfm_dir, found)
