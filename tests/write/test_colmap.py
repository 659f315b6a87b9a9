"""COLMAP models, opened by pycolmap."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest

from gmrdata.cameras.files import Distortion
from gmrdata.cameras.match.tracks import Tracks, errors_px, mean_over_points
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath, project
from gmrdata.values.errors import BadMotionFile
from gmrdata.write.cameras import BINARY_FOLDER, TEXT_FOLDER, ColmapPoints, write_colmap

K_PX = np.array([[500.0, 0, 310], [0, 480, 250], [0, 0, 1]])
N_FRAMES, N_POINTS = 6, 30
NAMES = [f"image_{n:05d}.jpg" for n in range(100, 100 + N_FRAMES)]


@pytest.fixture(scope="module")
def camera() -> CameraPath:
    """A camera on rails, unknown in frame 2."""
    world_from_cam = transforms.rigid(np.eye(3), np.eye(3)[0] * 0.3 * np.arange(N_FRAMES)[:, None])
    known = np.arange(N_FRAMES) != 2
    world_from_cam[~known] = np.nan
    return CameraPath(K_PX, 640, 480, world_from_cam, known)


def some_points(camera: CameraPath) -> ColmapPoints:
    """Points of which every frame with a camera sees two thirds, in no order, with noise."""
    rng = np.random.default_rng(8)
    points_m = rng.uniform([-2, -2, 5], [3, 2, 9], (N_POINTS, 3))
    rows, points = np.nonzero(rng.random((N_FRAMES, N_POINTS)) < 2 / 3)
    known = camera.has_camera[rows]
    rows, points = rng.permutation(np.stack([rows, points])[:, known], axis=1)
    seen_px = project(camera.world_from_cam[rows], points_m[points][:, None], K_PX)[:, 0]
    return ColmapPoints(points_m, rows, points, seen_px + rng.normal(0, 0.5, seen_px.shape))


def models(folder: Path) -> list[Any]:
    """The binary and the text model."""
    return [pycolmap.Reconstruction(str(folder / name)) for name in (BINARY_FOLDER, TEXT_FOLDER)]


def test_names_with_spaces_are_in_the_binary_model_alone(camera, tmp_path, capsys):
    """In the text a name ends at its first space, so that all images had one name."""
    names = [name and f"walk ({row}).jpg" for row, name in enumerate(NAMES)]
    write_colmap(tmp_path / "model", camera, names, some_points(camera))
    assert [path.name for path in (tmp_path / "model").iterdir()] == ["sparse"]
    model = pycolmap.Reconstruction(str(tmp_path / "model" / BINARY_FOLDER))
    assert {image.name for image in model.images.values()} < set(names)
    said = " ".join(capsys.readouterr().err.split())
    assert said.startswith(next(name for name in names if " " in name) + ": no COLMAP model as")


def test_pycolmap_reads_cameras_points_and_tracks(camera, tmp_path):
    points = some_points(camera)
    write_colmap(tmp_path, camera, NAMES, points)
    for model in models(tmp_path):
        (lens,) = model.cameras.values()
        assert (lens.model.name, lens.width, lens.height) == ("PINHOLE", 640, 480)
        np.testing.assert_allclose(lens.calibration_matrix(), K_PX)
        assert sorted(image.name for image in model.images.values()) == [*NAMES[:2], *NAMES[3:]]
        for image in model.images.values():
            row = NAMES.index(image.name)
            pose = transforms.invert(camera.world_from_cam[row])[:3]
            np.testing.assert_allclose(image.cam_from_world().matrix(), pose, atol=1e-12)
            seen = {tuple(spot.xy) for spot in image.points2D if spot.has_point3D()}
            expected = points.image_px[points.rows == row]
            assert len(seen) == len(expected)
            np.testing.assert_allclose(sorted(seen), expected[np.lexsort(expected.T[::-1])])
        assert model.num_points3D() == N_POINTS
        assert model.compute_num_observations() == len(points.rows)


@pytest.mark.parametrize("lens", [None, Distortion(0.1, -0.05, 0.1)])
def test_the_error_of_the_model_is_that_of_the_tracks(camera, lens, tmp_path):
    points = some_points(camera)
    radial = None if lens is None else (lens.k1, lens.k2)
    write_colmap(tmp_path, camera, NAMES, points, radial=radial)
    tracks = Tracks(
        points.rows, points.points, points.image_px, camera.has_camera, tuple(NAMES)
    )  # fmt: skip
    found_px = errors_px(tracks, points.world_m, camera.world_from_cam, K_PX, lens)
    for model in models(tmp_path):
        stored_px = model.compute_mean_reprojection_error()
        model.update_point_3d_errors()
        again_px = model.compute_mean_reprojection_error()
        expected_px = mean_over_points(found_px, points.points)
        assert stored_px == pytest.approx(again_px, rel=1e-9)
        assert again_px == pytest.approx(expected_px, rel=1e-9)
        assert 0.3 < expected_px < (1.0 if lens is None else 20.0)


def test_frames_without_an_image_are_left_out_and_points_may_lack(camera, tmp_path):
    write_colmap(tmp_path, camera, [None, *NAMES[1:]])
    for model in models(tmp_path):
        assert (model.num_reg_images(), model.num_points3D()) == (N_FRAMES - 2, 0)
    with pytest.raises(BadMotionFile, match="no frame has both a camera and an image"):
        write_colmap(tmp_path, camera, [None, None, NAMES[2], None, None, None])


def test_points_that_nothing_sees_have_no_error_and_are_left_out(camera, tmp_path):
    points = some_points(camera)
    more = ColmapPoints(
        np.concatenate([points.world_m, np.ones((5, 3))]),
        points.rows, points.points, points.image_px,
    )  # fmt: skip
    write_colmap(tmp_path, camera, NAMES, more)
    assert all(model.num_points3D() == N_POINTS for model in models(tmp_path))


def test_points_get_the_colours_of_the_images(camera, tmp_path):
    images_dir = tmp_path / "images"
    images_dir.mkdir()
    blue_green_red = np.full((480, 640, 3), (200, 100, 50), np.uint8)
    for name in NAMES:
        cv2.imwrite(str(images_dir / name), blue_green_red)
    write_colmap(tmp_path, camera, NAMES, some_points(camera), images_dir=images_dir)
    colours = [point.color for model in models(tmp_path) for point in model.points3D.values()]
    assert np.abs(np.array(colours, dtype=int) - (50, 100, 200)).max() <= 4  # it is JPEG
