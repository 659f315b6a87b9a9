"""SIFT features of frames, in COLMAP's database; those inside masks last, and without descriptors.

Of large frames they are OpenCV's, which takes a third of the time.  It begins with the image at
twice its size, so it is given one of half the size: that has what a first octave of 0 has.  Small
frames have COLMAP's, which are placed more exactly.  Where few are outside masks, weaker ones are
taken too.

Each frame has an extractor of its own.  COLMAP's go from image to image, and VLFeat's then keep the
gradients of the octave that they looked at last: where all features of an image are in one octave,
as in small or blurred ones, the next image gets its orientations from the image before.  Which that
is hangs on the threads (pycolmap 4.2.1: 1 % of images of 160 x 120 had other features run by run).
Each has a database of its own too: `FeatureExtractor.extract` holds Python's lock, under which
threads wait for each other, and `extract_features` does not.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Self

import cv2
import numpy as np

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.stage.workers import own_cores
from gmrdata.values.errors import BadFrames

LAYERS = 3  # of an octave

_Table = tuple[np.ndarray, np.ndarray]
"""Keypoints (N, 6) and descriptors (N, 128) of an image."""
NO_FEATURES: _Table = np.zeros((0, 6), np.float32), np.zeros((0, 128), np.uint8)


@dataclass(frozen=True, eq=False)
class StoredDescriptors:
    """Descriptors (N, 128) uint8 by row, in one file: those of ten minutes fill a gigabyte."""

    path: Path
    spans: np.ndarray  # (T, 2) int: where those of each row begin and end

    def __getitem__(self, row: int) -> np.ndarray:
        start, stop = self.spans[row].tolist()
        table = np.fromfile(self.path, np.uint8, 128 * (stop - start), offset=128 * start)
        return table.reshape(-1, 128)

    def some(self, rows: np.ndarray) -> "StoredDescriptors":
        """Those of some rows (N,), by their new numbers."""
        return replace(self, spans=self.spans[rows])


class Features(NamedTuple):
    """What the database doesn't keep: of each of T frames, in order of the frames."""

    n_free: list[int]
    """How many features are outside the mask."""
    descriptors: StoredDescriptors | None
    """Of all features; None where nothing is masked."""


class _Found(NamedTuple):
    keypoints: np.ndarray  # (N, 6) float32: place [px], and the affine shape (2, 2)
    descriptors: np.ndarray  # (N, 128) uint8
    n_free: int


class FeatureFinder:
    """Finds features in threads of its own, of each frame from when it is named first."""

    def __init__(self, frames: Frames, work_dir: Path, config: SfmConfig) -> None:
        self.frames, self.config = frames, config
        self._folder = TemporaryDirectory(dir=work_dir)
        self._n_threads = config.threads or own_cores()
        self._threads = ThreadPoolExecutor(self._n_threads)
        self._n_free: dict[Path, Future[int]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(cancel_futures=True)
        self._folder.cleanup()

    def begin(self, image: Path) -> None:
        """Begin with a frame, where another thread than that of the caller is meant to work."""
        if self._n_threads > 1:
            self._seek(image)

    def _seek(self, image: Path) -> None:
        if image not in self._n_free:
            find = partial(_find, self.frames, Path(self._folder.name), self.config)
            self._n_free[image] = self._threads.submit(find, image)

    def found(self, images: Sequence[Path]) -> Iterator[_Found]:
        """What some frames show, read back one by one."""
        for image in images:
            self._seek(image)
        n_free = [self._n_free[image].result() for image in images]
        enough = min(self.config.features.few_features, self.config.max_features)
        weak = float(np.median(n_free)) < enough and _is_large(self.frames, self.config)
        for image in images:
            with np.load(_kept(Path(self._folder.name), image, weak=weak)) as kept:
                yield _Found(kept["keypoints"], kept["descriptors"], int(kept["n_free"]))


def find_features(
    frames: Frames, database_path: Path, finder: FeatureFinder, *, calibrated: bool = True
) -> Features:
    """Write images, their one camera and their features into a new database.

    Where the intrinsics are but a guess (not `calibrated`), the camera is COLMAP's own guess.
    A frame that can't be decoded has no features, and no image in the database.
    """
    id_of_name = _import_images(frames, database_path, calibrated)
    sift, n_free, counts = pycolmap.FeatureExtractorType.SIFT, list[int](), list[int]()
    masked, path = frames.masks_dir is not None, database_path.with_suffix(".descriptors")
    with (
        closing(pycolmap.Database.open(database_path)) as database,
        path.open("wb") if masked else nullcontext() as stored,
    ):
        for image, one in zip(frames.images, finder.found(frames.images), strict=True):
            n_free.append(one.n_free)
            counts.append(len(one.keypoints))
            if len(one.keypoints):
                image_id, free = id_of_name[image.name], one.descriptors[: one.n_free]
                database.write_keypoints(image_id, one.keypoints)
                database.write_descriptors(image_id, pycolmap.FeatureDescriptors(sift, free))
                if stored is not None:
                    stored.write(one.descriptors.tobytes())
    ends = np.cumsum(counts)
    spans = np.stack([ends - counts, ends], axis=1)
    return Features(n_free, StoredDescriptors(path, spans) if masked else None)


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


def _find(frames: Frames, work_dir: Path, config: SfmConfig, image: Path) -> int:
    """Keep an image's features, and those with weak ones among them where it is large; how many of
    the first are outside its mask."""
    mask = None if frames.masks_dir is None else frames.mask(image)
    if _is_large(frames, config):
        firm, with_weak = _of_opencv(frames, image, config)
        weak = _unmasked_first(with_weak, mask)
        np.savez(_kept(work_dir, image, weak=True), **weak._asdict())
    else:
        firm = _of_colmap(image, frames.size_px, work_dir, config)
    features = _unmasked_first(firm, mask)
    np.savez(_kept(work_dir, image, weak=False), **features._asdict())
    return features.n_free


def _is_large(frames: Frames, config: SfmConfig) -> bool:
    return bool(np.prod(frames.size_px) >= config.features.large_pixels)


def _kept(work_dir: Path, image: Path, *, weak: bool) -> Path:
    """Where an image's features are kept until all are known."""
    return work_dir / f"{image.name}.{'weak' if weak else 'firm'}.npz"


def _unmasked_first(table: _Table, mask: np.ndarray | None) -> _Found:
    places, data = table
    if mask is None or not len(places):
        return _Found(places, data, len(places))
    column, row = places[:, :2].astype(int).T
    masked = mask[row, column] > 127
    order = np.argsort(masked, kind="stable")
    return _Found(places[order], data[order], int((~masked).sum()))


def _first_octave(size_px: tuple[int, int], config: SfmConfig) -> int:
    if config.first_octave is not None:
        return config.first_octave
    return -1 if np.prod(size_px) < config.features.small_pixels else 0


def _of_colmap(image: Path, size_px: tuple[int, int], work_dir: Path, config: SfmConfig) -> _Table:
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = 1
    options.max_image_size = max(size_px)
    options.sift.max_num_features = config.max_features
    options.sift.max_num_orientations = config.max_orientations
    options.sift.first_octave = _first_octave(size_px, config)
    own_path = work_dir / f"{image.name}.db"
    # Read by COLMAP too, whose grey is another mixture of the colours than OpenCV's.
    pycolmap.extract_features(
        own_path,
        image.parent,
        image_names=[image.name],
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )
    with closing(pycolmap.Database.open(own_path)) as database:
        ids = [one.image_id for one in database.read_all_images()]
        if not ids or not database.exists_keypoints(ids[0]):
            return NO_FEATURES
        descriptors = np.asarray(database.read_descriptors(ids[0]).data)
        return np.asarray(database.read_keypoints(ids[0])), descriptors.reshape(-1, 128)


def _of_opencv(frames: Frames, image: Path, config: SfmConfig) -> tuple[_Table, _Table]:
    """Those of the usual contrast, and those of half of it; looked for once."""
    try:
        gray, size_px = frames.gray(image), frames.size_px
    except BadFrames:
        return NO_FEATURES, NO_FEATURES
    octave = _first_octave(size_px, config)
    width_px, height_px = (round(side_px / 2 ** (octave + 1)) for side_px in size_px)
    small = cv2.resize(gray, (width_px, height_px), interpolation=cv2.INTER_AREA)
    # COLMAP's own threshold for edges.
    sift = cv2.SIFT.create(
        nOctaveLayers=LAYERS,
        contrastThreshold=config.features.weak_contrast,
        edgeThreshold=10,
        enable_precise_upscale=True,
    )
    everywhere = np.full(small.shape, 255, np.uint8)
    keypoints, floats = sift.detectAndCompute(small, everywhere)
    if not keypoints:
        return NO_FEATURES, NO_FEATURES
    larger = np.divide(size_px, small.shape[::-1])

    def table(rows: Iterable[int]) -> _Table:
        kept = _chosen(keypoints, rows, config)
        return _as_colmap_has_them([keypoints[i] for i in kept], floats[kept], larger, size_px)

    # OpenCV compares the contrast so.
    firm = np.flatnonzero([LAYERS * one.response >= config.features.contrast for one in keypoints])
    return table(firm.tolist()), table(range(len(keypoints)))


def _as_colmap_has_them(
    keypoints: Sequence[Any], floats: np.ndarray, larger: np.ndarray, size_px: tuple[int, int]
) -> _Table:
    """OpenCV's features of a frame that is `larger` (2,) times what they were sought in."""
    if not keypoints:
        return NO_FEATURES
    # OpenCV's (0, 0) is the centre of the first pixel, COLMAP's its corner.
    at_px = (np.array([one.pt for one in keypoints]) + 0.5) * larger
    at_px = np.clip(at_px, 0, np.nextafter(np.array(size_px, np.float32), np.float32(0)))
    size = np.array([one.size for one in keypoints]) / 2 * larger[0]
    turn = np.deg2rad([one.angle for one in keypoints])
    along, across = size * np.cos(turn), size * np.sin(turn)
    places = np.c_[at_px, along, -across, across, along].astype(np.float32)
    # As COLMAP has them: the root of each share (Arandjelovic and Zisserman 2012), in 512ths.
    shares = floats / np.maximum(floats.sum(axis=1, keepdims=True), 1e-9)
    return places, np.minimum(np.round(512 * np.sqrt(shares)), 255).astype(np.uint8)


def _chosen(keypoints: Sequence[Any], rows: Iterable[int], config: SfmConfig) -> list[int]:
    """Those rows of the features of the largest places, with the first directions of each."""
    places: dict[tuple[float, float, float], list[int]] = {}
    # All of one place follow each other, by their angle.
    for i in rows:
        places.setdefault((keypoints[i].size, *keypoints[i].pt), []).append(i)
    largest = sorted(places, reverse=True)[: config.max_features]
    return sorted(i for place in largest for i in places[place][: config.max_orientations])
