"""The overlay video: what is drawn lies where the projection says, at the video's own speed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gmrdata.cameras.files import Distortion
from gmrdata.pages.footage import (
    BAR_BGR,
    BAR_PX,
    LARGEST_SIDE_PX,
    MOST_PICTURES,
    NO_MARKS,
    Footage,
    Marks,
    bent_points,
    direction_marks,
    footage_picture,
    reduced_camera,
    shown_rows,
    write_footage,
)
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, project
from gmrdata.values.errors import BadFrames
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.overlay import OVERLAY_BGR, floor_path_m
from gmrdata.write.take import Performer
from tests.write.takes import make_take

BENT = Distortion(-0.15, 0.02, 0.5)
GREY = 90
SIZE_PX = (1920, 1080)
ROW = 5  # nobody is drawn in it


@pytest.fixture
def footage(walk: Callable[..., Motion], small_body: BodyModel, tmp_path: Path) -> Footage:
    """Grey frames of 1920x1080 px with one person, who is hidden in `ROW`."""
    take = make_take(walk, small_body)
    assert take.camera is not None
    image, (width_px, height_px) = tmp_path / "grey.png", SIZE_PX
    cv2.imwrite(str(image), np.full((height_px, width_px, 3), GREY, np.uint8))
    given_px = np.array([take.camera.width_px, take.camera.height_px])
    larger = np.diag([*(np.array(SIZE_PX) / given_px), 1.0]) @ take.camera.intrinsics_px
    larger[[0, 1], [0, 1]] *= 0.75  # so wide that the floor is in view
    n = take.n_frames
    view = replace(
        take.camera,
        intrinsics_px=larger,
        width_px=width_px,
        height_px=height_px,
        has_camera=np.ones(n, dtype=bool),
        world_from_cam=np.where(
            take.camera.has_camera[:, None, None],
            take.camera.world_from_cam,
            take.camera.world_from_cam[0],
        ),
    )
    person = Performer("walk", take.people[0].motion, small_body, np.arange(n) != ROW)
    times_s = np.arange(n) / take.fps_hz
    return Footage(
        (image,) * n, (None,) * n, times_s, view, None, (person,), NO_MARKS, np.arange(n) == 2
    )


def seen_px(
    points_m: np.ndarray, view: CameraPath, row: int, lens: Distortion | None
) -> np.ndarray:
    """Where a lens shows world points in the given frame, by its definition."""
    points_cam = transforms.apply(transforms.invert(view.world_from_cam[row]), points_m)
    rays = points_cam[:, :2] / points_cam[:, 2:]
    k1, k2 = (0.0, 0.0) if lens is None else (lens.k1, lens.k2)
    r2 = (rays**2).sum(axis=1, keepdims=True)
    focal_px, centre_px = np.diag(view.intrinsics_px)[:2], view.intrinsics_px[:2, 2]
    return np.asarray(rays * (1 + k1 * r2 + k2 * r2**2) * focal_px + centre_px)


@pytest.mark.parametrize("lens", [None, BENT])
def test_the_dots_of_the_path_lie_where_the_camera_sees_the_floor(
    footage: Footage, lens: Distortion | None
) -> None:
    picture = footage_picture(replace(footage, lens=lens), ROW)
    assert picture.shape == (540 + BAR_PX, LARGEST_SIDE_PX, 3)
    (person,) = footage.people
    dots_m = floor_path_m(person)[:: max(1, round(footage.fps_hz))]
    dots_px = seen_px(dots_m, footage.camera, ROW, lens) / 2  # frames are shown at half their size
    assert len(dots_px) >= 1
    for x, y in np.floor(dots_px).astype(int):
        assert picture[y, x].tolist() == list(OVERLAY_BGR["path"])


@pytest.mark.parametrize("lens", [None, BENT])
def test_the_body_covers_what_its_vertices_cover(footage: Footage, lens: Distortion | None) -> None:
    row, (person,) = 1, footage.people
    alone = person._replace(shown=np.arange(12) == row)  # so that its path is a point, not drawn
    picture = footage_picture(replace(footage, lens=lens, people=(alone,)), row)
    vertices_m = motion_vertices_m(person.body, person.motion, rows=np.array([row]))[0]
    corners_px = seen_px(vertices_m, footage.camera, row, lens) / 2
    changed = (picture[:-BAR_PX] != GREY).any(axis=2)
    y, x = np.nonzero(changed)
    found_px = [x.min(), x.max() + 1, y.min(), y.max() + 1]
    expected_px = [f(corners_px[:, axis]) for axis in (0, 1) for f in (np.min, np.max)]
    assert found_px == pytest.approx(expected_px, abs=1.0)


def test_marks_lie_where_they_are_seen_and_in_their_frames_alone(footage: Footage) -> None:
    view = reduced_camera(footage.camera)
    world_m = transforms.apply(
        view.world_from_cam[3], np.array([[0.3, -0.2, 4.0], [-1.0, 0.4, 5.0]])
    )
    marks = Marks(world_m, np.array([3, 3]), np.array([0, 1]))
    marked = replace(footage, people=(), marks=marks)
    picture = footage_picture(marked, 3)
    for x, y in np.floor(project(view.world_from_cam[3], world_m, view.intrinsics_px)).astype(int):
        assert picture[y, x].tolist() == list(OVERLAY_BGR["path"])
    assert (footage_picture(marked, 4)[:-BAR_PX] == GREY).all()


def test_directions_stand_still_while_the_camera_turns(footage: Footage) -> None:
    marks = direction_marks(footage.camera)
    rays = marks.world_m - footage.camera.centres_world_m[footage.camera.n_frames // 2]
    assert np.allclose(np.linalg.norm(rays, axis=1), 1.0)
    for row in (0, 11):
        assert len(marks.seen_m(row)) == len(rays) > 500


def test_the_bar_says_what_is_dropped_and_where_the_frame_is(footage: Footage) -> None:
    bar = footage_picture(footage, ROW)[-1]
    n = footage.camera.n_frames
    colours = [bar[int((row + 0.2) / n * LARGEST_SIDE_PX)].tolist() for row in range(n)]
    assert colours == [list(BAR_BGR["dropped" if row == 2 else "kept"]) for row in range(n)]
    assert bar[int((ROW + 0.5) / n * LARGEST_SIDE_PX)].tolist() == list(BAR_BGR["now"])


def test_the_video_has_all_frames_at_their_rate(footage: Footage, tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    assert write_footage(path, footage) == 12
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
        pictures = [frame.to_ndarray(format="bgr24") for frame in container.decode(stream)]
        assert float(stream.average_rate or 0) == pytest.approx(footage.fps_hz, rel=1e-3)
    assert len(pictures) == 12
    expected = footage_picture(footage, 7).astype(int)
    assert np.abs(pictures[7][: expected.shape[0]] - expected).mean() < 3


def test_frames_of_another_size_and_no_frames_are_errors(footage: Footage, tmp_path: Path) -> None:
    smaller = replace(footage, camera=replace(footage.camera, width_px=1280, height_px=720))
    with pytest.raises(BadFrames, match="1920x1080 px, but its camera has 1280x720 px"):
        footage_picture(smaller, 0)
    nothing = replace(footage, images=(None,) * 12)
    with pytest.raises(BadFrames, match="no frame"):
        write_footage(tmp_path / "overlay.mp4", nothing)
    assert not list(tmp_path.glob("*.mp4*"))


def test_a_frame_without_an_image_is_black_and_one_without_a_camera_is_bare(
    footage: Footage,
) -> None:
    has_camera = np.arange(12) != 4
    view = replace(footage.camera, has_camera=has_camera)
    images = [None if row == 3 else image for row, image in enumerate(footage.images)]
    given = replace(footage, camera=view, images=images, people=())
    assert (footage_picture(given, 3)[:-BAR_PX] == 0).all()
    assert (footage_picture(given, 4)[:-BAR_PX] == GREY).all()


@pytest.mark.parametrize(
    ("times_s", "fps_hz", "rows", "rate_hz"),
    [
        (np.round(np.arange(300) / 29.97, 6), 29.97, list(range(300)), 29.97),
        (np.arange(2500) / 25.0, 25.0, list(range(0, 2500, 3)), 25 / 3),
        (np.array([0.0, 0.1, 0.2, 0.5, 0.6]), 10.0, [0, 1, 2, 2, 2, 3, 4], 10.0),
    ],
    ids=["constant", "long", "variable"],
)
def test_frames_are_shown_as_long_as_they_last(
    times_s: np.ndarray, fps_hz: float, rows: list[int], rate_hz: float
) -> None:
    shown, shown_hz = shown_rows(times_s, fps_hz)
    assert shown.tolist() == rows and shown_hz == rate_hz


@given(arrays(float, st.integers(1, 60), elements=st.floats(0.001, 50.0)))
def test_any_times_give_few_rows_in_order(steps_s: np.ndarray) -> None:
    times_s = np.cumsum(steps_s)
    fps_hz = 1.0 / float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    rows, rate_hz = shown_rows(times_s, fps_hz)
    assert 1 <= len(rows) <= MOST_PICTURES and (np.diff(rows) >= 0).all() and rate_hz > 0
    assert rows[0] == 0 and rows[-1] <= len(times_s) - 1
    lasts_s = len(rows) / rate_hz
    assert lasts_s >= (times_s[-1] - times_s[0]) * 0.99


def test_points_beyond_what_a_lens_can_show_are_left_out() -> None:
    points = np.array([[0.5, 0.0, 1.0], [5.0, 0.0, 1.0]])
    bent = bent_points(points, Distortion(-0.3, 0.0, 0.5))
    assert bent[0].tolist() == pytest.approx([0.5 * (1 - 0.3 * 0.25), 0.0, 1.0])
    assert np.isnan(bent[1, 0])
