"""Features of frames are those of each frame alone."""

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.features import _first_octave, find_features
from gmrdata.cameras.recipe import SfmConfig

INTRINSICS_PX = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])


def coarse_noise(folder: Path, n_frames: int) -> list[Path]:
    """Frames whose features all lie in the first octave."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for i in range(n_frames):
        coarse = rng.integers(0, 255, (30, 40)).astype(np.uint8)
        image = cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{i:05d}.png"), image)
    return sorted(folder.iterdir())


def keypoints_of(database_path: Path) -> dict[str, np.ndarray]:
    with closing(pycolmap.Database.open(database_path)) as database:
        images = database.read_all_images()
        return {image.name: database.read_keypoints(image.image_id) for image in images}


def test_features_are_those_of_each_frame_alone(tmp_path: Path) -> None:
    """COLMAP's extractor gave a frame the orientations of the frame before it."""
    images = coarse_noise(tmp_path / "frames", 12)
    frames = Frames(images, None, INTRINSICS_PX, (160, 120))
    find_features(frames, tmp_path / "all.db", SfmConfig(threads=4, first_octave=0))
    together = keypoints_of(tmp_path / "all.db")
    for image in images:
        alone = Frames([image], None, INTRINSICS_PX, (160, 120))
        find_features(alone, tmp_path / f"{image.stem}.db", SfmConfig(threads=1, first_octave=0))
        expected = keypoints_of(tmp_path / f"{image.stem}.db")[image.name]
        np.testing.assert_array_equal(together[image.name], expected)


@pytest.mark.parametrize(("asked", "octave"), [(None, -1), (0, 0)])
def test_features_are_those_of_colmap_for_a_single_frame(
    asked: int | None, octave: int, tmp_path: Path
) -> None:
    """Of a small frame, which is doubled if nobody says otherwise."""
    images = coarse_noise(tmp_path / "frames", 1)
    frames = Frames(images, None, INTRINSICS_PX, (160, 120))
    config = SfmConfig(max_features=600, first_octave=asked)
    found = find_features(frames, tmp_path / "own.db", config)
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features, options.sift.first_octave = 600, octave
    path = tmp_path / "colmap.db"
    pycolmap.extract_features(
        path, images[0].parent, extraction_options=options, device=pycolmap.Device.cpu
    )
    expected = keypoints_of(path)[images[0].name]
    np.testing.assert_array_equal(keypoints_of(tmp_path / "own.db")[images[0].name], expected)
    assert found.n_free == [len(expected)]


def test_frames_of_a_quarter_of_a_megapixel_are_taken_as_they_are() -> None:
    assert [_first_octave(size_px, SfmConfig()) for size_px in ((499, 500), (500, 500))] == [-1, 0]
    assert _first_octave((160, 120), SfmConfig(first_octave=1)) == 1


def test_features_inside_masks_are_last_and_have_no_descriptors(tmp_path: Path) -> None:
    images = coarse_noise(tmp_path / "frames", 2)
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :70] = 255
    (tmp_path / "masks").mkdir()
    for image in images:
        cv2.imwrite(str(tmp_path / "masks" / image.name), mask)
    frames = Frames(images, tmp_path / "masks", INTRINSICS_PX, (160, 120))
    found = find_features(frames, tmp_path / "masked.db", SfmConfig())
    places = keypoints_of(tmp_path / "masked.db")
    with closing(pycolmap.Database.open(tmp_path / "masked.db")) as database:
        for image in database.read_all_images():
            row = int(Path(image.name).stem)
            x_px, n_free = places[image.name][:, 0], found.n_free[row]
            assert (x_px[:n_free] >= 70).all() and (x_px[n_free:] < 70).all()
            kept = np.asarray(database.read_descriptors(image.image_id).data)
            np.testing.assert_array_equal(kept, found.descriptors[row][:n_free])
            assert len(found.descriptors[row]) == len(x_px)


LARGE_PX = (961, 641)
BLOB_PX = np.stack(np.meshgrid(np.arange(60.3, 900, 85), np.arange(52.6, 600, 85)), -1)


def blobs() -> np.ndarray:
    """Bright spots (H, W) at known places [px from the outer corner], each of its own size."""
    x, y = np.arange(LARGE_PX[0]) + 0.5, np.arange(LARGE_PX[1]) + 0.5
    image = np.full(LARGE_PX[::-1], 60.0)
    for n, (at_x, at_y) in enumerate(BLOB_PX.reshape(-1, 2)):
        sigma_px = 5 + n % 5
        across = np.exp(-(((x - at_x) / sigma_px) ** 2) / 2)
        image += 150 * np.exp(-(((y - at_y) / sigma_px) ** 2) / 2)[:, None] * across
    return np.round(image).astype(np.uint8)


def test_features_of_large_frames_are_where_the_frame_has_them(tmp_path: Path) -> None:
    """By OpenCV's SIFT on half the size, whose (0, 0) is the centre of a pixel."""
    cv2.imwrite(str(tmp_path / "00000.png"), blobs())
    frames = Frames([tmp_path / "00000.png"], None, INTRINSICS_PX, LARGE_PX)
    found = find_features(frames, tmp_path / "own.db", SfmConfig(max_orientations=1))
    places_px = keypoints_of(tmp_path / "own.db")["00000.png"][:, :2]
    assert found.n_free == [len(places_px)]
    true_px = BLOB_PX.reshape(-1, 2)
    apart_px = places_px[:, None] - true_px
    nearest = np.linalg.norm(apart_px, axis=2).argmin(axis=0)
    off_px = apart_px[nearest, np.arange(len(true_px))]
    there = np.linalg.norm(off_px, axis=1) < 1
    assert there.mean() > 0.95
    assert np.abs(off_px[there]).max() < 0.1 and np.abs(off_px[there].mean(axis=0)).max() < 0.02


@pytest.mark.parametrize(("masked_px", "weak_too"), [(0, False), (641, True)])
def test_weak_features_are_taken_where_masks_leave_few(
    masked_px: int, weak_too: bool, tmp_path: Path
) -> None:
    """Firm texture on the left, which a mask may hide, and a weak one on the right."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(-100, 101, (214, 321)).astype(np.float32)
    coarse[:, 214:] *= 0.1
    image = cv2.resize(coarse, LARGE_PX, interpolation=cv2.INTER_CUBIC) + 128
    mask = np.zeros(LARGE_PX[::-1], np.uint8)
    mask[:, :masked_px] = 255
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "00000.png"), np.clip(np.round(image), 0, 255).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "masks" / "00000.png"), mask)
    frames = Frames([tmp_path / "00000.png"], tmp_path / "masks", INTRINSICS_PX, LARGE_PX)
    find_features(frames, tmp_path / "own.db", SfmConfig())
    x_px = keypoints_of(tmp_path / "own.db")["00000.png"][:, 0]
    n_weak = int((x_px > 661).sum())
    assert n_weak > 600 if weak_too else n_weak < 150


def test_a_place_has_as_many_directions_as_are_asked_for(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (80, 120)).astype(np.uint8)
    image = cv2.resize(coarse, LARGE_PX, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(tmp_path / "00000.png"), image)
    frames = Frames([tmp_path / "00000.png"], None, INTRINSICS_PX, LARGE_PX)
    counts = []
    for most in (1, 2):
        path = tmp_path / f"{most}.db"
        find_features(frames, path, SfmConfig(max_features=300, max_orientations=most))
        keypoints = keypoints_of(path)["00000.png"]
        _, each = np.unique(keypoints[:, :2], axis=0, return_counts=True)
        assert each.max() == most and len(each) == 300
        counts.append(len(keypoints))
    assert counts[1] > counts[0] == 300
