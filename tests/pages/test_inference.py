"""The video and the view from above: who is where in them."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from gmrdata.film.camera_moves import look_at
from gmrdata.pages import inference as drawing
from gmrdata.pages.inference import Film, draw_body, film_camera, write_body_video, write_top_view
from gmrdata.people.silhouette import silhouette
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import intrinsics_from_fov, project
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m

FILM = Film(intrinsics_from_fov(50.0, 160, 120), 160, 120)


def camera_at(centre_m: tuple[float, float, float]) -> np.ndarray:
    centre = np.array(centre_m)
    return transforms.rigid(look_at(centre, np.array([0.0, 0.0, 1.0])), centre)


def is_skin(picture: np.ndarray) -> np.ndarray:
    """Where the body is: bluish; grid, ground and shadow are grey."""
    return picture[..., 2].astype(int) - picture[..., 0] > 20


def test_the_body_covers_its_silhouette(walk: Callable[..., Motion], small_body: BodyModel) -> None:
    motion = walk(30.0, 4)
    motion = replace(motion, pelvis_m=motion.pelvis_m * [0, 0, 1])
    vertices_m = motion_vertices_m(small_body, motion)[2].astype(float)
    world_from_cam = camera_at((3.0, -2.0, 1.5))
    found = is_skin(draw_body(vertices_m, small_body.faces, world_from_cam, FILM))
    in_cam_m = transforms.apply(transforms.invert(world_from_cam), vertices_m)
    expected = silhouette(in_cam_m, small_body.faces, FILM.intrinsics_px, (160, 120)) > 0
    assert expected.sum() > 500
    assert (found & expected).sum() / (found | expected).sum() > 0.9


def test_the_nearer_triangle_hides_the_farther() -> None:
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


def test_grid_lines_are_where_whole_metres_are(small_body: BodyModel) -> None:
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
def test_the_camera_keeps_the_person_in_view(
    turn: float, walk: Callable[..., Motion], small_body: BodyModel
) -> None:
    motion = walk(30.0, 60)
    c, s = np.cos(turn), np.sin(turn)
    rotmat = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    motion = replace(
        motion, root_rotmats=rotmat @ motion.root_rotmats, pelvis_m=motion.pelvis_m @ rotmat.T
    )
    cameras = film_camera(motion)
    assert np.ptp(cameras[:, :3, :3], axis=0).max() < 1e-9
    for row in (0, 30, 59):
        vertices_m = motion_vertices_m(small_body, motion, rows=np.array([row]))[0]
        points = project(cameras[row], vertices_m.astype(float), FILM.intrinsics_px)
        assert (points >= 0).all() and (points < (160, 120)).all()
        assert np.ptp(points[:, 1]) > 40


def test_a_person_who_stays_is_filmed_from_the_front(
    walk: Callable[..., Motion], small_body: BodyModel
) -> None:
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
def test_the_video_runs_in_real_time(
    fps_hz: float,
    n_frames: int,
    rate: int,
    n_filmed: int,
    walk: Callable[..., Motion],
    small_body: BodyModel,
    tmp_path: Path,
) -> None:
    motion = walk(fps_hz, n_frames)
    write_body_video(tmp_path / "body.mp4", motion, small_body, (96, 80), "walk")
    with av.open(str(tmp_path / "body.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == Fraction(rate)
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == n_filmed
    assert all(frame.shape == (80, 96, 3) and is_skin(frame).sum() > 100 for frame in frames)


def test_the_view_from_above_is_a_picture(walk: Callable[..., Motion], tmp_path: Path) -> None:
    write_top_view(tmp_path / "path.png", walk(30.0, 40))
    picture = cv2.imread(str(tmp_path / "path.png"))
    assert picture.shape == (600, 600, 3)
    purple = (picture[..., 0] > 150) & (picture[..., 1] < 120) & (picture[..., 2] > 80)
    assert purple.sum() > 200
    write_top_view(tmp_path / "again.png", walk(30.0, 40))
    assert (tmp_path / "path.png").read_bytes() == (tmp_path / "again.png").read_bytes()
