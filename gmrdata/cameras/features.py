"""SIFT features of frames, in COLMAP's database; those inside masks last, and without descriptors.

Each frame has an extractor of its own.  COLMAP's go from image to image, and VLFeat's then keep the
gradients of the octave that they looked at last: where all features of an image are in one octave,
as in small or blurred ones, the next image gets its orientations from the image before.  Which that
is hangs on the threads (pycolmap 4.2.1: 1 % of images of 160 x 120 had other features run by run).
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.stage.jobs import own_cores


@dataclass(frozen=True, eq=False)
class Features:
    """What the database doesn't keep: of each of T frames, in order of the frames."""

    n_free: list[int] = field(default_factory=list)
    """How many features are outside the mask."""
    descriptors: list[np.ndarray] = field(default_factory=list)
    """(N, 128) uint8 of all features; empty where nothing is masked."""


@dataclass(frozen=True, eq=False)
class _Found:
    keypoints: np.ndarray  # (N, 6) float32: place [px], and the affine shape (2, 2)
    descriptors: np.ndarray  # (N, 128) uint8
    n_free: int


def find_features(
    frames: Frames, database_path: Path, config: SfmConfig, *, calibrated: bool = True
) -> Features:
    """Write images, their one camera and their features into a new database.

    Where the intrinsics are but a guess (not `calibrated`), the camera is COLMAP's own guess.
    A frame that can't be decoded has no features, and no image in the database.
    """
    id_of_name = _import_images(frames, database_path, calibrated)
    found = list(_all_found(frames, config))
    with closing(pycolmap.Database.open(database_path)) as database:
        for image, one in zip(frames.images, found, strict=True):
            if len(one.keypoints):
                image_id, free = id_of_name[image.name], one.descriptors[: one.n_free]
                sift = pycolmap.FeatureExtractorType.SIFT
                database.write_keypoints(image_id, one.keypoints)
                database.write_descriptors(image_id, pycolmap.FeatureDescriptors(sift, free))
    masked = frames.masks_dir is not None
    descriptors = [one.descriptors for one in found] if masked else []
    return Features([one.n_free for one in found], descriptors)


def pinhole_params(intrinsics_px: np.ndarray) -> list[float]:
    """fx, fy, cx, cy of a calibration matrix [px]."""
    return [float(intrinsics_px[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))]


def _import_images(frames: Frames, database_path: Path, calibrated: bool) -> dict[str, int]:
    """Ids by name; images get them here, in order."""
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE" if calibrated else "SIMPLE_RADIAL"
    if calibrated:
        reader.camera_params = ",".join(map(repr, pinhole_params(frames.intrinsics_px)))
    names, folder = [image.name for image in frames.images], frames.images[0].parent
    pycolmap.Database.open(database_path).close()
    pycolmap.import_images(database_path, folder, pycolmap.CameraMode.SINGLE, names, reader)
    with closing(pycolmap.Database.open(database_path)) as database:
        return {image.name: image.image_id for image in database.read_all_images()}


def _all_found(frames: Frames, config: SfmConfig) -> Iterator[_Found]:
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = 1
    options.max_image_size = max(frames.size_px)
    options.sift.max_num_features = config.max_features
    options.sift.max_num_orientations = config.max_orientations
    options.sift.first_octave = config.first_octave
    with ThreadPoolExecutor(config.threads or own_cores()) as threads:
        yield from threads.map(partial(_find, frames, options), frames.images)


def _find(frames: Frames, options: Any, image: Path) -> _Found:
    bitmap = pycolmap.Bitmap.read(image, as_rgb=False)
    if bitmap is None:
        return _Found(np.zeros((0, 6), np.float32), np.zeros((0, 128), np.uint8), 0)
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    keypoints, descriptors = extractor.extract(bitmap)
    table = [(k.x, k.y, k.a11, k.a12, k.a21, k.a22) for k in keypoints]
    places = np.array(table, np.float32).reshape(-1, 6)
    data = np.asarray(descriptors.data).reshape(-1, 128)
    if frames.masks_dir is None:
        return _Found(places, data, len(places))
    column, row = places[:, :2].astype(int).T
    masked = frames.mask(image)[row, column] > 127
    order = np.argsort(masked, kind="stable")
    return _Found(places[order], data[order], int((~masked).sum()))
