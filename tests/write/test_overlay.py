"""Overlays as videos, decoded again: bodies lie where the cameras put them, times are kept."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from gmrdata.people.silhouette import silhouette
from gmrdata.values import transforms
from gmrdata.values.camera import project
from gmrdata.values.errors import BadFrames, BadMotionFile
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.overlay import draw_people, floor_path_m, write_overlay
from gmrdata.write.take import Performer, Take
from tests.filming import write_pictures
from tests.write.takes import HIDDEN, N_FRAMES, SIZE_PX

WITHOUT_IMAGE = 2


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> list[Path | None]:
    """Dark grey frames, one of which is missing."""
    grey = np.full((SIZE_PX[1], SIZE_PX[0], 3), 40, np.uint8)
    paths = write_pictures(tmp_path_factory.mktemp("overlay") / "frames", [grey] * N_FRAMES)
    return [None if row == WITHOUT_IMAGE else path for row, path in enumerate(paths)]


def silhouette_of(take: Take, person: Performer, row: int) -> np.ndarray:
    assert take.camera is not None
    vertices_m = motion_vertices_m(person.body, person.motion, rows=np.array([row]))[0]
    cam_from_world = transforms.invert(take.camera.world_from_cam[row])
    vertices_cam_m = transforms.apply(cam_from_world, vertices_m)
    faces, intrinsics_px = person.body.faces, take.camera.intrinsics_px
    return silhouette(vertices_cam_m, faces, intrinsics_px, SIZE_PX) > 0


def test_bodies_cover_their_silhouettes(take, images, tmp_path):
    write_overlay(tmp_path / "clip.mp4", take, images)
    with av.open(str(tmp_path / "clip.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == Fraction(2997, 100)
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == N_FRAMES
    for row, frame in enumerate(frames):
        assert frame.shape == (SIZE_PX[1], SIZE_PX[0], 3)
        if row in (WITHOUT_IMAGE, HIDDEN[-1]):  # nothing is drawn there
            assert np.abs(frame.astype(int) - (0 if row == WITHOUT_IMAGE else 40)).max() < 12
            continue
        there = [person for person in take.people if person.shown[row]]
        assert len(there) == (1 if row in HIDDEN else 2)
        expected = np.any([silhouette_of(take, person, row) for person in there], axis=0)
        yellow = frame[..., 0] > frame[..., 2].astype(int) + 10  # the paths
        elsewhere = cv2.dilate(yellow.astype(np.uint8), np.ones((5, 5))) == 0
        covered, expected = (frame.max(axis=2) > 75) & elsewhere, expected & elsewhere
        assert (covered & expected).sum() > 0.95 * (covered | expected).sum() > 500


def test_a_person_s_path_is_drawn_over_the_person_s_time_alone(take):
    """Everybody's path over the whole film was handled for each picture; the dots stay where they
    are."""
    shown = np.isin(np.arange(N_FRAMES), [3, 4, 6])
    person, camera = take.people[0]._replace(shown=shown), take.camera
    assert camera is not None
    path_m = floor_path_m(person, 2)
    assert np.isnan(path_m[:, 0]).tolist() == [True, False, False, True, False]
    np.testing.assert_array_equal(path_m[1:3, :2], person.motion.pelvis_m[3:5, :2])
    assert floor_path_m(person._replace(shown=np.zeros(N_FRAMES, bool))).shape == (0, 3)
    lengths: list[int] = []

    def bend(points_cam_m: np.ndarray) -> np.ndarray:
        lengths.append(len(points_cam_m))
        return points_cam_m

    image = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
    away = person._replace(shown=np.zeros(N_FRAMES, bool))
    draw_people(image, (person, away), camera, 0, 2, bend)
    assert lengths == [5, 0]


def test_the_path_lies_on_the_floor_and_has_the_gap(take, images, tmp_path):
    """Seen from above, in a frame in which the person is hidden."""
    second, camera = take.people[1], take.camera
    assert camera is not None
    path_m = second.motion.pelvis_m * [1.0, 1.0, 0.0]
    middle_m = np.nanmean(path_m, axis=0)
    above = transforms.rigid(np.diag([1.0, -1.0, -1.0]), middle_m + np.array([0.0, 0.0, 1.0]))
    still = replace(camera, world_from_cam=np.tile(above, (N_FRAMES, 1, 1)))
    still = replace(still, has_camera=np.ones(N_FRAMES, dtype=bool))
    write_overlay(tmp_path / "path.mp4", replace(take, people=(second,), camera=still), images)
    with av.open(str(tmp_path / "path.mp4")) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    yellow = frames[HIDDEN[0]].astype(int)
    drawn = yellow[..., 0] - yellow[..., 2] > 60
    points_px = project(above, path_m, camera.intrinsics_px)
    inside = ((points_px > 1) & (points_px < np.array(SIZE_PX) - 1)).all(axis=1)
    assert inside.sum() >= 5 and not inside[HIDDEN].any()
    for x, y in points_px[inside].astype(int):
        assert drawn[y, x]
    between = (points_px[HIDDEN[0] - 1] + points_px[HIDDEN[-1] + 1]) / 2
    assert not drawn[int(between[1]), int(between[0])]


def test_what_cannot_be_drawn_is_said(take, images, tmp_path):
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((48, 64, 3), np.uint8))
    for shown, frames, error, why in (
        (replace(take, camera=None), images, BadMotionFile, "no camera"),
        (take, images[:3], BadFrames, "3 images for 12 rows"),
        (take, [None] * N_FRAMES, BadFrames, "no row has an image"),
        (take, [small, *images[1:]], BadFrames, r"small\.png: 64x48 px, but its camera has 160x96"),
    ):
        with pytest.raises(error, match=why):
            write_overlay(tmp_path / "bad.mp4", shown, frames)
    assert [file.name for file in tmp_path.iterdir()] == ["small.png"]
