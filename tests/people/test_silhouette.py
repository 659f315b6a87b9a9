"""Silhouettes of the projected body."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.silhouette import (
    SilhouetteConfig,
    dilate,
    rows_that_show,
    silhouette,
    silhouette_masks,
)
from gmrdata.read.body_file import save_body
from gmrdata.read.frames import read_frames, read_gray
from gmrdata.stage.store import StageRecord
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project_cam
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadFrames, BadMotionFile, MissingInput
from gmrdata.values.people import PersonFiles
from gmrdata.values.skinning import motion_vertices_m
from tests.motions import made_up

INTRINSICS_PX = intrinsics_from_fov(60.0, 160, 120)


def square(x_px: float, y_px: float, side_px: float, depth_m: float) -> np.ndarray:
    """Corners (4, 3) of an upright square whose image is given, in the camera frame [m]."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side_px + [x_px, y_px]
    rays = np.column_stack([corners, np.ones(4)]) @ np.linalg.inv(INTRINSICS_PX).T
    return rays * depth_m


FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_square_covers_exactly_its_pixels():
    # Image corners on pixel centres: those pixels and all between are inside.
    mask = silhouette(square(40.5, 30.5, 20, 2.0), FACES, INTRINSICS_PX, (160, 120))
    expected = np.zeros((120, 160), np.uint8)
    expected[30:51, 40:61] = 255
    assert np.array_equal(mask, expected)


def test_faces_behind_the_camera_leave_no_trace():
    mask = silhouette(square(40.5, 30.5, 20, -2.0), FACES, INTRINSICS_PX, (160, 120))
    assert not mask.any()


@pytest.fixture
def camera_clip(small_body) -> Clip:
    """A person 4 m in front of the camera who turns a little."""
    n = 3
    turn = np.linspace(0, 0.6, n)
    # SMPL's rest frame (y up) seen by a camera with y down: half a turn about x.
    upside_down = np.diag([1.0, -1.0, -1.0])
    about_y = np.zeros((n, 3, 3))
    about_y[:, 0, 0] = about_y[:, 2, 2] = np.cos(turn)
    about_y[:, 0, 2], about_y[:, 2, 0] = np.sin(turn), -np.sin(turn)
    about_y[:, 1, 1] = 1.0
    motion = made_up(
        np.tile(np.eye(3), (n, 23, 1, 1)),
        upside_down @ about_y,
        np.tile([0.2, 0.1, 4.0], (n, 1)),
        shape=np.zeros(small_body.n_shape),
        body=small_body.name,
        frame="camera",
    )
    unknown = np.full((n, 4, 4), np.nan)
    camera = CameraPath(INTRINSICS_PX, 160, 120, unknown, np.zeros(n, dtype=bool))
    return Clip("turning", motion, np.ones(n, dtype=bool), np.arange(5, 5 + n), camera)


@pytest.fixture
def images_dir(tmp_path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in (5, 6, 7):
        cv2.imwrite(str(folder / f"image_{i:05d}.jpg"), np.full((120, 160, 3), 90, np.uint8))
    return folder


Masked = Callable[..., Path]


@pytest.fixture
def masked(small_body, images_dir, tmp_path) -> Masked:
    """Masks of clips of the small body."""

    def run(*clips: Clip, left_out: tuple[int, ...] = (), **settings: object) -> Path:
        people = []
        for clip in clips:
            folder = Path(tempfile.mkdtemp(dir=tmp_path))
            save_body(folder / "body.npz", small_body)
            rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
            save_clip(folder / "camera.npz", clip, rest_pelvis_m)
            people.append(PersonFiles(folder / "camera.npz", folder / "body.npz"))
        config = SilhouetteConfig.model_validate(settings)
        out_dir = Path(tempfile.mkdtemp(dir=tmp_path)) / "masks"
        return silhouette_masks(tuple(people), read_frames(images_dir, left_out), out_dir, config)

    return run


def test_every_vertex_of_the_body_is_masked(camera_clip, small_body, masked):
    out_dir = masked(camera_clip, dilate_px=2)
    vertices_m = motion_vertices_m(small_body, camera_clip.motion)
    for row, number in enumerate(camera_clip.image_numbers):
        mask = read_gray(out_dir / f"image_{number:05d}.png", (160, 120))
        assert set(np.unique(mask)) == {0, 255}
        points_px = project_cam(vertices_m[row], INTRINSICS_PX)
        x, y = np.floor(points_px).astype(int).T
        assert (mask[y, x] == 255).all()
        rows, columns = np.nonzero(mask)
        assert columns.min() > points_px[:, 0].min() - 5
        assert columns.max() < points_px[:, 0].max() + 5
        assert rows.min() > points_px[:, 1].min() - 5 and rows.max() < points_px[:, 1].max() + 5


def test_an_image_without_a_pose_is_an_error_unless_it_is_left_out(camera_clip, masked):
    clip = replace(camera_clip, image_numbers=np.array([5, 6, -1]))
    with pytest.raises(BadFrames, match=r"image_00007\.jpg: .*has no pose"):
        masked(clip)
    made = masked(clip, left_out=(7,))
    assert sorted(p.name for p in made.glob("*.png")) == ["image_00005.png", "image_00006.png"]
    inputs = ["body_0", "clip_0", "images", "left out 7"]
    assert sorted(StageRecord.of(made).inputs) == inputs


def test_clips_of_another_size_or_in_the_world_and_nobody_are_errors(camera_clip, masked, tmp_path):
    assert camera_clip.camera is not None
    turned = replace(camera_clip.camera, width_px=120, height_px=160)
    with pytest.raises(BadFrames, match="160x120 px, but .* says 120x160 px"):
        masked(replace(camera_clip, camera=turned))
    with pytest.raises(BadMotionFile, match="camera-frame motion"):
        masked(replace(camera_clip, motion=replace(camera_clip.motion, frame="world")))
    with pytest.raises(MissingInput, match="at least one person"):
        masked()
    assert not list(tmp_path.rglob("masks"))


def test_two_people_are_masked_both(camera_clip, masked):
    moved_m = camera_clip.motion.pelvis_m + np.array([0.6, 0.0, 0.5])
    other = replace(camera_clip, motion=replace(camera_clip.motion, pelvis_m=moved_m))
    alone, both = [masked(clip) for clip in (camera_clip, other)], masked(camera_clip, other)
    for path in sorted(both.glob("*.png")):
        masks = [read_gray(folder / path.name) for folder in alone]
        assert np.array_equal(read_gray(path), masks[0] | masks[1])
        assert (masks[0] != masks[1]).any()


def test_where_a_body_is_not_valid_its_neighbours_are_masked(camera_clip, masked):
    masks = masked(replace(camera_clip, valid=np.array([True, False, True])))
    before, between, after = (read_gray(path) for path in sorted(masks.glob("*.png")))
    assert np.array_equal(between, before | after)


@pytest.mark.parametrize(("without_body", "value"), [("everything", 255), ("nothing", 0)])
def test_a_body_that_is_unknown_for_long_masks_all_or_nothing(
    without_body, value, camera_clip, masked
):
    pelvis_m = camera_clip.motion.pelvis_m.copy()
    pelvis_m[1] = np.nan
    motion = replace(camera_clip.motion, pelvis_m=pelvis_m)
    clip = replace(camera_clip, motion=motion, valid=np.array([True, False, True]))
    masks = masked(clip, bridge_frames=0, without_body=without_body)
    assert (read_gray(sorted(masks.glob("*.png"))[1]) == value).all()


def test_rows_that_show_where_a_person_may_be():
    valid = np.array([False, True, False, False, True, False, False, False])
    assert rows_that_show(valid, 1, 5) == [1]
    assert rows_that_show(valid, 2, 2) == [1, 4]
    assert rows_that_show(valid, 3, 1) == []  # the one before is two rows away
    assert rows_that_show(valid, 0, 1) == [1]
    assert rows_that_show(valid, 7, 3) == [4]
    assert rows_that_show(valid, 7, 2) == []
    assert rows_that_show(np.zeros(4, dtype=bool), 2, 9) == []


def far_body(small_body: BodyModel) -> np.ndarray:
    """Its vertices 2.5 m in front of the camera, head up: most of its triangles are small."""
    rest_m = small_body.template_m
    return (rest_m - rest_m.mean(axis=0)) * [1.0, -1.0, -1.0] + [0.0, 0.0, 2.5]


def disc(radius_px: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1))


def test_dots_cover_what_filled_triangles_cover(small_body):
    vertices_m, size_px = far_body(small_body), (640, 480)
    intrinsics_px = intrinsics_from_fov(60.0, *size_px)
    filled = silhouette(vertices_m, small_body.faces, intrinsics_px, size_px)
    for radius_px in (1, 2, 4, 8):
        dotted = silhouette(vertices_m, small_body.faces, intrinsics_px, size_px, radius_px) > 0
        narrower = cv2.dilate(filled, disc(radius_px - 1)) > 0
        wider = cv2.dilate(filled, disc(radius_px + 1)) > 0
        assert dotted[narrower].all() and not dotted[~wider].any()


@given(
    spots=st.lists(st.tuples(st.integers(0, 29), st.integers(0, 39)), max_size=4),
    radius_px=st.integers(0, 9),
)
def test_dilation_of_the_occupied_part_is_that_of_all(spots, radius_px):
    mask = np.zeros((30, 40), np.uint8)
    for spot in spots:
        mask[spot] = 255
    assert np.array_equal(dilate(mask, radius_px), cv2.dilate(mask, disc(radius_px)))


@pytest.mark.parametrize("dilate_px", [0, 8])
def test_a_corner_that_is_no_number_leaves_no_trace(dilate_px):
    corners_m = square(40.5, 30.5, 20, 2.0)
    corners_m[1, 0] = np.nan  # a corner of the first triangle alone
    mask = silhouette(corners_m, FACES, INTRINSICS_PX, (160, 120), dilate_px)
    assert np.array_equal(
        mask, silhouette(corners_m, FACES[1:], INTRINSICS_PX, (160, 120), dilate_px)
    )
