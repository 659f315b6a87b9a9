"""Frames as they are worked on: made smaller, read with their masks, and which follow each other.

Large frames are made smaller first.  A camera is held by hundreds of points, so it gains little
from more pixels than about a million, while everything takes as many times longer.
"""

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.people.folder import find_mask
from gmrdata.read.frames import gray_bytes, image_bytes, image_number, is_turned, read_gray
from gmrdata.stage.jobs import in_threads
from gmrdata.values.camera import Lens
from gmrdata.values.limits import MOST_DIGITS

MASK_MARGIN_PX = 8  # points nearer to a mask see what moves in half of their window
MOST_KEPT_BYTES = 2**28  # of decoded frames: five hundred of 960x540 px


@dataclass(frozen=True, eq=False)
class Frames:
    """T frames of one size, all in one folder, their masks and their calibration."""

    images: list[Path]
    masks_dir: Path | None  # Masks (255 = dynamic), one per frame; None to use whole frames
    intrinsics_px: np.ndarray  # (3, 3) calibration matrix [px]
    size_px: tuple[int, int]  # (width, height)
    kept: dict[Path, np.ndarray] = field(default_factory=dict)  # What `gray` decoded

    @property
    def numbers(self) -> np.ndarray:
        return np.array([image_number(image) for image in self.images])

    @property
    def row_of_name(self) -> dict[str, int]:
        """Row of each frame by its image's name, by which COLMAP knows it."""
        return {image.name: row for row, image in enumerate(self.images)}

    def rows_of(self, model: Any) -> Iterator[tuple[int, Any]]:
        """Row and image of each frame of a COLMAP model; in order, as COLMAP has hash tables."""
        row_of_name = self.row_of_name
        for image in map(model.image, sorted(model.reg_image_ids())):
            yield row_of_name[image.name], image

    def some(self, rows: np.ndarray) -> "Frames":
        """The frames of some rows."""
        return replace(self, images=[self.images[row] for row in rows])

    def gray(self, image: Path) -> np.ndarray:
        """A frame (h, w) uint8, not to be written to; decoded once, as far as memory is meant to
        hold it."""
        gray = self.kept.get(image)
        if gray is None:
            gray = read_gray(image, self.size_px)
            if (len(self.kept) + 1) * gray.nbytes <= MOST_KEPT_BYTES:
                self.kept[image] = gray
        return gray

    def mask(self, image: Path) -> np.ndarray:
        """A frame's mask (h, w) uint8."""
        if self.masks_dir is None:
            return np.zeros(self.size_px[::-1], dtype=np.uint8)
        return read_gray(find_mask(self.masks_dir, image), self.size_px)

    def read(self, image: Path, shrink: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """A shrunk frame (h, w) uint8, and where its background can be followed, (h, w) bool."""
        import cv2

        gray, masked = self.gray(image), self.mask(image)
        if shrink < 1:
            gray = cv2.resize(gray, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
            masked = cv2.resize(masked, gray.shape[::-1], interpolation=cv2.INTER_AREA)
        around = np.ones((2 * MASK_MARGIN_PX + 1,) * 2, np.uint8)
        return gray, cv2.dilate((masked > 0).astype(np.uint8), around) == 0


def reduced(
    frames: Frames, longest_px: int, out_dir: Path, radial: tuple[float, float] = (0.0, 0.0)
) -> Frames:
    """The frames if none is longer than that; else smaller grey ones and masks, in `out_dir`.

    Those that EXIF turns are written too, since COLMAP reads them as they are stored, and those of
    a lens with distortion, as a pinhole would show them.  Names that stand in another order as
    texts, or have a space, get new ones: COLMAP goes by that order, and lists pairs of names with a
    space between.
    """
    import cv2

    share = min(1.0, longest_px / max(frames.size_px))
    stem_of = _stems(frames)
    if share == 1 and not any(radial) and not any(map(is_turned, frames.images)):
        if all(stem == image.stem for image, stem in stem_of.items()):
            return frames
        links = linked({stem: image for image, stem in stem_of.items()}, frames.masks_dir, out_dir)
        return Frames(*links, frames.intrinsics_px, frames.size_px)
    width_px, height_px = (max(1, round(share * side_px)) for side_px in frames.size_px)
    size_px = width_px, height_px
    lens = Lens.of_matrix(frames.intrinsics_px, frames.size_px, radial).at_size(size_px)
    masks_dir = None if frames.masks_dir is None else out_dir / "masks"
    (out_dir / "frames").mkdir(parents=True)
    if masks_dir is not None:
        masks_dir.mkdir()
    seen_at = None
    if not lens.is_pinhole:  # where it shows each pixel of a pinhole's picture, as cv2.remap counts
        pinhole_px = np.meshgrid(*(np.arange(side_px) + 0.5 for side_px in size_px))
        seen_px = (lens.seen_px(np.stack(pinhole_px, axis=-1)) - 0.5).astype(np.float32)
        seen_at = np.ascontiguousarray(seen_px[..., 0]), np.ascontiguousarray(seen_px[..., 1])

    def reduce_one(image: Path) -> Path:
        # As PNG it would take 40 times as long to write, and 14 times to read.
        path = out_dir / "frames" / f"{stem_of[image]}.bmp"
        gray = read_gray(image, frames.size_px)
        small = cv2.resize(gray, size_px, interpolation=cv2.INTER_AREA)
        if seen_at is not None:
            small = cv2.remap(small, *seen_at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        path.write_bytes(image_bytes(".bmp", small))
        if masks_dir is not None:
            mask = _reduced_mask(frames.mask(image), size_px, seen_at)
            (masks_dir / f"{stem_of[image]}.png").write_bytes(gray_bytes(mask))
        return path

    images = in_threads(reduce_one, frames.images)
    return Frames(images, masks_dir, lens.matrix_px, size_px)


def _stems(frames: Frames) -> dict[Path, str]:
    """Names without suffix whose order as texts is that of the frames: their own, if it is, and if
    COLMAP's lists of pairs can hold them."""
    names, stems = [image.name for image in frames.images], [image.stem for image in frames.images]
    # A line has a space between two names, and begins with # where it is not read.
    unlisted = any(" " in name or name.startswith("#") for name in names)
    if unlisted or names != sorted(names) or stems != sorted(stems):
        stems = [f"{number:0{MOST_DIGITS}d}" for number in frames.numbers.tolist()]
    return dict(zip(frames.images, stems, strict=True))


def linked(
    images: Mapping[str, Path], masks_dir: Path | None, out_dir: Path
) -> tuple[list[Path], Path | None]:
    """Images by new names without suffix, in a folder of `out_dir`, and a folder of their masks;
    without copying them where the disk allows it."""
    files = {out_dir / "frames" / f"{stem}{image.suffix}": image for stem, image in images.items()}
    named, masks = list(files), None
    if masks_dir is not None:
        masks = out_dir / "masks"
        files |= {masks / f"{stem}.png": find_mask(masks_dir, i) for stem, i in images.items()}
    for path, file in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            # Of a symbolic link Linux would link the link itself, which may lead nowhere from here.
            os.link(file.resolve(), path)
        except OSError:
            shutil.copyfile(file, path)
    return named, masks


def _reduced_mask(
    mask: np.ndarray, size_px: tuple[int, int], seen_at: tuple[np.ndarray, np.ndarray] | None
) -> np.ndarray:
    """A mask of the smaller size; a pixel is dynamic if any part of it is, or the lens does not
    show it."""
    import cv2

    covered = cv2.resize(mask, size_px, interpolation=cv2.INTER_AREA) > 0
    white = 255 * covered.astype(np.uint8)
    if seen_at is None:
        return white
    edge, linear = cv2.BORDER_CONSTANT, cv2.INTER_LINEAR
    straight = cv2.remap(white, *seen_at, linear, borderMode=edge, borderValue=(255,))
    return 255 * (straight > 0).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Timeline:
    """When the T frames were taken, as far as times, names and pictures tell."""

    image_numbers: np.ndarray  # (T,) ascending; those of left-out and dropped ones are missing
    cuts: np.ndarray  # (C,) rows t after which the picture changes to another place

    def near(self, rows: np.ndarray, max_gap_frames: int) -> np.ndarray:
        """(R-1,) bool: neighbours of R rows in order with no cut and no long gap between them."""
        short = np.diff(self.image_numbers[rows]) <= max_gap_frames + 1
        cuts_before = np.searchsorted(np.sort(self.cuts), rows)
        return np.asarray(short & (np.diff(cuts_before) == 0))


def cuts_in_words(after_numbers: np.ndarray) -> str:
    """The end of a message about a failure, from the numbers (C,) of the images after which the
    picture changes."""
    if len(after_numbers) == 0:
        return ""
    return (
        f"; the picture changes to another place {len(after_numbers)} times, first after frame "
        f"{after_numbers[0]}: cut the sequence there, or put its images in order"
    )
