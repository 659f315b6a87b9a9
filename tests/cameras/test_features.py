"""Features of frames are those of each frame alone."""

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.features import find_features
from gmrdata.cameras.frames import Frames
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
    find_features(frames, tmp_path / "all.db", SfmConfig(threads=4))
    together = keypoints_of(tmp_path / "all.db")
    for image in images:
        alone = Frames([image], None, INTRINSICS_PX, (160, 120))
        find_features(alone, tmp_path / f"{image.stem}.db", SfmConfig(threads=1))
        expected = keypoints_of(tmp_path / f"{image.stem}.db")[image.name]
        np.testing.assert_array_equal(together[image.name], expected)


def test_features_are_those_of_colmap_for_a_single_frame(tmp_path: Path) -> None:
    images = coarse_noise(tmp_path / "frames", 1)
    frames = Frames(images, None, INTRINSICS_PX, (160, 120))
    found = find_features(frames, tmp_path / "own.db", SfmConfig(max_features=600))
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features, options.sift.first_octave = 600, 0
    path = tmp_path / "colmap.db"
    pycolmap.extract_features(
        path, images[0].parent, extraction_options=options, device=pycolmap.Device.cpu
    )
    expected = keypoints_of(path)[images[0].name]
    np.testing.assert_array_equal(keypoints_of(tmp_path / "own.db")[images[0].name], expected)
    assert found.n_free == [len(expected)]


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
