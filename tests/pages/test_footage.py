"""Overlays as videos: what is drawn lies where the projection says; people seen from above."""

from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gmrdata.cameras.files import Distortion, bent_points
from gmrdata.film.camera_moves import look_at
from gmrdata.pages import footage as footage_module
from gmrdata.pages import inference as drawing
from gmrdata.pages.footage import (
    BAR_BGR,
    BAR_PX,
    LARGEST_SIDE_PX,
    MOST_BYTES,
    NO_MARKS,
    Footage,
    Marks,
    direction_marks,
    footage_picture,
    reduced_camera,
    shown_rows,
    write_footage,
)
from gmrdata.pages.inference import (
    Framing,
    draw_body,
    film_camera,
    write_body_video,
    write_top_view,
)
from gmrdata.people.silhouette import silhouette
from gmrdata.solve.plan import MOST_PICTURES
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project
from gmrdata.values.errors import BadFrames
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.overlay import OVERLAY_BGR, floor_path_m
from gmrdata.write.take import Performer
from tests.motions import moved
from tests.write.takes import make_take

BENT = Distortion(-0.15, 0.02, 0.5)
GREY = 90
SIZE_PX = (1920, 1080)
ROW = 5  # nobody is drawn in it


@pytest.fixture
def footage(walk, small_body, tmp_path) -> Footage:
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
        (image,) * n,
        (None,) * n,
        times_s,
        view,
        None,
        (person,),
        NO_MARKS,
        np.arange(n) == 2,
        np.zeros(n, bool),
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
def test_the_dots_of_the_path_lie_where_the_camera_sees_the_floor(footage, lens):
    picture = footage_picture(replace(footage, lens=lens), ROW)
    assert picture.shape == (540 + BAR_PX, LARGEST_SIDE_PX, 3)
    (person,) = footage.people
    dots_m = floor_path_m(person)[:: max(1, round(footage.fps_hz))]
    dots_px = seen_px(dots_m, footage.camera, ROW, lens) / 2  # frames are shown at half their size
    assert len(dots_px) >= 1
    for x, y in np.floor(dots_px).astype(int):
        assert picture[y, x].tolist() == list(OVERLAY_BGR["path"])


@pytest.mark.parametrize("lens", [None, BENT])
def test_the_body_covers_what_its_vertices_cover(footage, lens):
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


def test_marks_lie_where_they_are_seen_and_in_their_frames_alone(footage):
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


def test_directions_stand_still_while_the_camera_turns(footage):
    marks = direction_marks(footage.camera)
    rays = marks.world_m - footage.camera.centres_world_m[footage.camera.n_frames // 2]
    assert np.allclose(np.linalg.norm(rays, axis=1), 1.0)
    for row in (0, 11):
        assert len(marks.seen_m(row)) == len(rays) > 500


def test_the_bar_says_what_is_dropped_and_where_the_frame_is(footage):
    bar = footage_picture(footage, ROW)[-1]
    n = footage.camera.n_frames
    colours = [bar[int((row + 0.2) / n * LARGEST_SIDE_PX)].tolist() for row in range(n)]
    assert colours == [list(BAR_BGR["dropped" if row == 2 else "kept"]) for row in range(n)]
    assert bar[int((ROW + 0.5) / n * LARGEST_SIDE_PX)].tolist() == list(BAR_BGR["now"])


def test_the_video_has_all_frames_at_their_rate(footage, tmp_path):
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


def test_the_video_is_no_larger_than_asked(footage, tmp_path, monkeypatch):
    rng, path = np.random.default_rng(0), tmp_path / "noise.mp4"
    noise = rng.integers(0, 256, (12, *footage_picture(footage, 0).shape), dtype=np.uint8)
    monkeypatch.setattr(footage_module, "footage_picture", lambda _, row: noise[row])
    sizes = []
    for most in (MOST_BYTES, 300_000):
        monkeypatch.setattr(footage_module, "MOST_BYTES", most)
        assert write_footage(path, footage) == 12
        sizes.append(path.stat().st_size)
    assert 300_000 > sizes[1] > 30_000 and MOST_BYTES > sizes[0] > 2 * sizes[1]


def test_frames_of_another_size_and_no_frames_are_errors(footage, tmp_path):
    smaller = replace(footage, camera=replace(footage.camera, width_px=1280, height_px=720))
    with pytest.raises(BadFrames, match="1920x1080 px, but its camera has 1280x720 px"):
        footage_picture(smaller, 0)
    nothing = replace(footage, images=(None,) * 12)
    with pytest.raises(BadFrames, match="no frame"):
        write_footage(tmp_path / "overlay.mp4", nothing)
    assert not list(tmp_path.glob("*.mp4*"))


def test_a_frame_without_an_image_is_black_and_one_without_a_camera_is_bare(footage):
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
def test_frames_are_shown_as_long_as_they_last(times_s, fps_hz, rows, rate_hz):
    shown, shown_hz = shown_rows(times_s, fps_hz)
    assert shown.tolist() == rows and shown_hz == rate_hz


@given(arrays(float, st.integers(1, 60), elements=st.floats(0.001, 50.0)))
def test_any_times_give_few_rows_in_order(steps_s):
    times_s = np.cumsum(steps_s)
    fps_hz = 1.0 / float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    rows, rate_hz = shown_rows(times_s, fps_hz)
    assert 1 <= len(rows) <= MOST_PICTURES and (np.diff(rows) >= 0).all() and rate_hz > 0
    assert rows[0] == 0 and rows[-1] <= len(times_s) - 1
    lasts_s = len(rows) / rate_hz
    assert lasts_s >= (times_s[-1] - times_s[0]) * 0.99


def test_points_beyond_what_a_lens_can_show_are_left_out():
    points = np.array([[0.5, 0.0, 1.0], [5.0, 0.0, 1.0]])
    bent = bent_points(points, Distortion(-0.3, 0.0, 0.5))
    assert bent[0].tolist() == pytest.approx([0.5 * (1 - 0.3 * 0.25), 0.0, 1.0])
    assert np.isnan(bent[1, 0])


def test_points_beyond_the_fold_of_a_lens_are_left_out_where_its_terms_grow_again():
    """One 65 degrees beside the axis was drawn where the lens shows one at 29 degrees."""
    points = np.array([[1.2, 0.0, 1.0], [2.15, 0.0, 1.0], [0.0, 9.0, 1.0]])
    bent = bent_points(points, Distortion(-0.3, 0.03, 0.5))
    assert bent[0, 0] == pytest.approx(1.2 * (1 - 0.3 * 1.2**2 + 0.03 * 1.2**4))
    assert np.isnan(bent[1:, :2]).all()


FILM = Framing(intrinsics_from_fov(50.0, 160, 120), 160, 120)


def camera_at(centre_m: tuple[float, float, float]) -> np.ndarray:
    centre = np.array(centre_m)
    return transforms.rigid(look_at(centre, np.array([0.0, 0.0, 1.0])), centre)


def is_skin(picture: np.ndarray) -> np.ndarray:
    """Where the body is: bluish; grid, ground and shadow are grey."""
    return picture[..., 2].astype(int) - picture[..., 0] > 20


def test_the_body_covers_its_silhouette(walk, small_body):
    motion = walk(30.0, 4)
    motion = replace(motion, pelvis_m=motion.pelvis_m * [0, 0, 1])
    vertices_m = motion_vertices_m(small_body, motion)[2].astype(float)
    world_from_cam = camera_at((3.0, -2.0, 1.5))
    found = is_skin(draw_body(vertices_m, small_body.faces, world_from_cam, FILM))
    in_cam_m = transforms.apply(transforms.invert(world_from_cam), vertices_m)
    expected = silhouette(in_cam_m, small_body.faces, FILM.intrinsics_px, (160, 120)) > 0
    assert expected.sum() > 500
    assert (found & expected).sum() / (found | expected).sum() > 0.9


def test_the_nearer_triangle_hides_the_farther():
    """Two walls across the view; the nearer one is turned from the light and so darker."""
    wall = np.array([[0, -1, 0.2], [0, 1, 0.2], [0, 1, 1.8], [0, -1, 1.8]], dtype=float)
    step = np.array([1.0, 0, 0])
    near, far = wall + step, wall * [1, 0.5, 1] - step
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = camera_at((4.0, 0.0, 1.0))
    alone = draw_body(near, faces, camera, FILM)
    for order in ((near, far), (far, near)):
        vertices = np.concatenate(order)
        both = draw_body(vertices, np.concatenate([faces, faces + 4]), camera, FILM)
        assert np.array_equal(both[50:70, 60:100], alone[50:70, 60:100])
    from_behind = draw_body(near, faces, camera_at((-4.0, 0.0, 1.0)), FILM)
    assert not is_skin(from_behind).any()


def test_grid_lines_are_where_whole_metres_are():
    """Along a scan over the floor, dark pixels lie on lines x = whole metres."""
    vertices_m = np.array([[0.0, 0, 50], [0.1, 0, 50], [0, 0.1, 50.0]])  # far above the picture
    camera = camera_at((0.4, -3.0, 2.0))
    picture = draw_body(vertices_m, np.array([[0, 1, 2]]), camera, FILM).astype(int).sum(axis=2)
    along_m = np.linspace(-1.4, 1.4, 1500)
    points_m = np.stack([along_m, np.full(1500, 0.5), np.zeros(1500)], axis=1)
    columns, rows = project(camera, points_m, FILM.intrinsics_px).astype(int).T
    inside = (columns >= 0) & (columns < 160) & (rows >= 0) & (rows < 120)
    dark = picture[rows[inside], columns[inside]] < drawing.BACKGROUND.sum() - 60
    found_m = along_m[inside][dark]
    assert np.abs(found_m - found_m.round()).max() < 0.05
    assert {-1.0, 0.0, 1.0} <= set(found_m.round())


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_the_camera_keeps_the_person_in_view(turn, walk, small_body):
    motion = walk(30.0, 60)
    c, s = np.cos(turn), np.sin(turn)
    rotmat = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    motion = moved(motion, transforms.rigid(rotmat, np.zeros(3)))
    cameras = film_camera(motion)
    assert np.ptp(cameras[:, :3, :3], axis=0).max() < 1e-9
    for row in (0, 30, 59):
        vertices_m = motion_vertices_m(small_body, motion, rows=np.array([row]))[0]
        points = project(cameras[row], vertices_m.astype(float), FILM.intrinsics_px)
        assert (points >= 0).all() and (points < (160, 120)).all()
        assert np.ptp(points[:, 1]) > 40


def test_a_person_who_stays_is_filmed_from_the_front(walk):
    motion = walk(30.0, 30)
    staying = replace(motion, pelvis_m=np.tile([1.0, 2.0, 0.95], (30, 1)))
    front = (staying.root_rotmats @ (0.0, 0.0, 1.0)).mean(axis=0)[:2]
    to_camera = film_camera(staying)[0, :2, 3] - (1.0, 2.0)
    cosine = to_camera @ front / np.linalg.norm(to_camera) / np.linalg.norm(front)
    assert cosine > 0.9


@pytest.mark.parametrize(
    ("fps_hz", "n_frames", "rate", "n_filmed"),
    [(30.0, 5, 30, 5), (25.0, 5, 25, 5), (60.0, 5, 30, 3), (120.0, 9, 30, 3), (10.0, 3, 10, 3)],
)
def test_the_video_runs_in_real_time(fps_hz, n_frames, rate, n_filmed, walk, small_body, tmp_path):
    motion = walk(fps_hz, n_frames)
    write_body_video(tmp_path / "body.mp4", motion, small_body, (96, 80), "walk")
    with av.open(str(tmp_path / "body.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == Fraction(rate)
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == n_filmed
    assert all(frame.shape == (80, 96, 3) and is_skin(frame).sum() > 100 for frame in frames)


def test_the_view_from_above_is_a_picture(walk, tmp_path):
    write_top_view(tmp_path / "path.png", walk(30.0, 40))
    picture = cv2.imread(str(tmp_path / "path.png"))
    assert picture.shape == (600, 600, 3)
    purple = (picture[..., 0] > 150) & (picture[..., 1] < 120) & (picture[..., 2] > 80)
    assert purple.sum() > 200
    write_top_view(tmp_path / "again.png", walk(30.0, 40))
    assert (tmp_path / "path.png").read_bytes() == (tmp_path / "again.png").read_bytes()
