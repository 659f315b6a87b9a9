"""Large frames are worked on at a smaller size, and the cameras are those of the large ones."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cameras.files import load_cameras, load_points, load_quality
from gmrdata.cameras.frames import Frames, reduced
from gmrdata.cameras.match.tracks import errors_px, load_tracks, mean_over_points
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import list_images, read_gray
from gmrdata.values.errors import BadFrames, NoReconstruction
from tests.read.test_frames import with_exif

K_PX = np.array([[300.0, 0, 100], [0, 300, 60], [0, 0, 1]])


def a_frame(folder: Path, size_px: tuple[int, int] = (200, 120)) -> Frames:
    """White from column 100 on; the mask covers pixel (40, 20) alone."""
    image, mask = np.zeros(size_px[::-1], np.uint8), np.zeros(size_px[::-1], np.uint8)
    image[:, 100:] = 255
    mask[20, 40] = 255
    for name, values in {"frames": image, "masks": mask}.items():
        (folder / name).mkdir()
        cv2.imwrite(str(folder / name / "image_00007.png"), values)
    images = [folder / "frames" / "image_00007.png"]
    return Frames(images, folder / "masks", K_PX, size_px)


def test_pixels_scale_from_the_outer_corner(tmp_path: Path) -> None:
    small = reduced(a_frame(tmp_path), 50, tmp_path / "small")
    assert small.size_px == (50, 30)
    np.testing.assert_allclose(small.intrinsics_px, [[75, 0, 25], [0, 75, 15], [0, 0, 1]])
    (image,) = small.images
    assert image.stem == "image_00007"
    gray = read_gray(image, small.size_px)
    assert (gray[:, :25] == 0).all() and (gray[:, 25:] == 255).all()


def test_a_pixel_is_dynamic_if_any_part_of_it_is(tmp_path: Path) -> None:
    small = reduced(a_frame(tmp_path), 50, tmp_path / "small")
    assert small.masks_dir is not None
    mask = read_gray(small.masks_dir / "image_00007.png", small.size_px)
    assert np.argwhere(mask).tolist() == [[5, 10]] and mask.max() == 255


def test_small_frames_are_taken_as_they_are(tmp_path: Path) -> None:
    frames = a_frame(tmp_path)
    assert reduced(frames, 200, tmp_path / "small") is frames
    assert not (tmp_path / "small").exists()


def test_turned_frames_are_written_upright_for_colmap(tmp_path: Path) -> None:
    """COLMAP reads pictures as they are stored; the mask is of the upright picture."""
    frames = a_frame(tmp_path)
    (image,) = frames.images
    stored = np.rot90(cv2.imread(str(image)))
    cv2.imwrite(str(image), stored)
    with_exif(image, 6)
    upright = reduced(frames, 200, tmp_path / "small")
    assert upright.size_px == (200, 120) and np.array_equal(upright.intrinsics_px, K_PX)
    written = cv2.imread(str(upright.images[0]), cv2.IMREAD_GRAYSCALE)
    assert (written[:, 100:] == 255).all() and (written[:, :100] == 0).all()
    assert np.array_equal(upright.mask(upright.images[0]), frames.mask(image))


def test_a_mask_of_another_size_is_an_error(tmp_path: Path) -> None:
    frames = a_frame(tmp_path)
    cv2.imwrite(str(tmp_path / "masks" / "image_00007.png"), np.zeros((30, 50), np.uint8))
    with pytest.raises(BadFrames, match="image_00007"):
        reduced(frames, 50, tmp_path / "small")


def test_cameras_of_large_frames_have_their_size(dolly: Any, tmp_path: Path) -> None:
    """Frames of twice the size, worked on at the size that they had."""
    enlarge(dolly.images_dir, tmp_path / "frames", cv2.INTER_LINEAR)
    enlarge(dolly.masks_dir, tmp_path / "masks", cv2.INTER_NEAREST)
    first = read_gray(list_images(dolly.images_dir)[0])
    height_px, width_px = first.shape
    matrix = np.diag([2.0, 2, 1]) @ dolly.intrinsics_px
    config = SfmConfig(max_features=600, max_image_size_px=width_px)
    out_dir = reconstruct(tmp_path / "frames", tmp_path / "masks", matrix, tmp_path / "out", config)
    cameras, quality = load_cameras(out_dir), load_quality(out_dir)
    assert quality.worked_on_px == (width_px, height_px)
    assert (cameras.path.width_px, cameras.path.height_px) == (2 * width_px, 2 * height_px)
    np.testing.assert_array_equal(cameras.path.intrinsics_px, matrix)
    assert cameras.geometry == "full" and cameras.path.has_camera.all()
    assert quality.mean_reprojection_px < 1.0
    held, points = load_tracks(out_dir).of_adjusted(), load_points(out_dir)
    found_px = errors_px(held, points, cameras.path.world_from_cam, matrix, None)
    # The tracks are in the pixels of the given frames, the record in those worked on.
    again_px = mean_over_points(found_px, held.points) / 2
    assert again_px == pytest.approx(quality.mean_reprojection_px, rel=2e-3)
    turns = cameras.path.world_from_cam[:, :3, :3]
    true = dolly.world_from_cam[:, :3, :3]
    found = turns[0].T @ turns[-1]
    expected = true[0].T @ true[-1]
    cosine = (np.trace(found.T @ expected) - 1) / 2
    assert np.rad2deg(np.arccos(np.clip(cosine, -1, 1))) < 0.2
    assert not (out_dir / "colmap").exists()


def test_an_error_names_the_frames_that_were_given(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for i in range(6):
        path = tmp_path / "frames" / f"{i:05d}.png"
        cv2.imwrite(str(path), np.full((120, 160), 128, np.uint8))
    config = SfmConfig(max_image_size_px=80)
    with pytest.raises(NoReconstruction) as raised:
        reconstruct(tmp_path / "frames", None, K_PX, tmp_path / "out", config)
    assert str(tmp_path / "frames") in str(raised.value)
    assert "reduced" not in str(raised.value)


def enlarge(folder: Path, out_dir: Path, interpolation: int) -> None:
    out_dir.mkdir()
    for image in list_images(folder):
        twice = cv2.resize(read_gray(image), None, fx=2, fy=2, interpolation=interpolation)
        cv2.imwrite(str(out_dir / f"{image.stem}.png"), twice)
