"""The images of a sequence: which rows have one that can be used, their size, and K against it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.errors import BadFrames, BadSequence, MissingInput
from gmrdata.frames import check_images, number_in_name
from gmrdata.threedpw.layout import SequenceFiles, require_inside

CENTRE_TOLERANCE = 0.05
"""3DPW's principal points are the images' middles; by this share of the width or height they may
be elsewhere before K is taken for that of other images."""


@dataclass(frozen=True, eq=False)
class SequenceImages:
    """The images of N rows."""

    paths: tuple[Path, ...]
    """(N,) `image_{row:05d}.jpg`, there or not."""
    width_px: int
    """Width of the images as stored [px]."""
    height_px: int
    """Height of the images as stored [px]."""
    faults: tuple[str, ...]
    """(N,) why a row's image can't be used; empty where it can."""
    spare: int
    """Images in the folder that no row belongs to."""


def check_sequence_images(files: SequenceFiles, n_frames: int) -> SequenceImages:
    """Look at the image of each row: there, whole, of one size, and inside the dataset's folder.

    Args:
        files: The sequence.
        n_frames: Number of rows N.

    Raises:
        MissingInput: there is no folder of images.
        BadSequence: the folder is a link out of the dataset.
        BadFrames: not one image can be used.
    """
    if not files.image_dir.is_dir():
        raise MissingInput(
            f"{files.image_dir}: no such folder; unpack 3DPW's imageFiles.zip so that it is there"
        )
    require_inside(files.root, files.image_dir)
    paths = [files.image_path(row) for row in range(n_frames)]
    looked_at = [_look_at(files, path) for path in paths]
    sizes = Counter(size for size, _ in looked_at if size is not None)
    if not sizes:
        raise BadFrames(f"{files.image_dir}: not one image can be used: {looked_at[0][1]}")
    width_px, height_px = sizes.most_common(1)[0][0]
    return SequenceImages(
        paths=tuple(paths),
        width_px=width_px,
        height_px=height_px,
        faults=tuple(_fault(size, fault, (width_px, height_px)) for size, fault in looked_at),
        spare=_count_spare(files.image_dir, n_frames),
    )


def check_intrinsics(path: Path, intrinsics_px: np.ndarray, width_px: int, height_px: int) -> None:
    """Check that K is that of the images: 3DPW has portrait and landscape sequences.

    Args:
        path: The sequence file, for the message.
        intrinsics_px: (3, 3) calibration matrix [px].
        width_px: Width of the images [px].
        height_px: Height of the images [px].

    Raises:
        BadSequence: the principal point is that of the other orientation, or far from the middle.
    """
    centre_px = intrinsics_px[:2, 2]
    if _is_middle(centre_px, (width_px, height_px)):
        return
    found = (
        f"{path}: cam_intrinsics has its principal point at ({centre_px[0]:g}, {centre_px[1]:g}) "
        f"px, the images are {width_px}x{height_px} px"
    )
    if _is_middle(centre_px, (height_px, width_px)):
        raise BadSequence(
            f"{found}: it is that of the other orientation; a tool has turned the images, unpack "
            "imageFiles again"
        )
    raise BadSequence(
        f"{found}: it is that of other images; use the images at 3DPW's own size, uncropped"
    )


def _is_middle(centre_px: np.ndarray, size_px: Sequence[int]) -> bool:
    off = np.abs(centre_px / np.array(size_px) - 0.5)
    return bool((off <= CENTRE_TOLERANCE).all())


def _look_at(files: SequenceFiles, path: Path) -> tuple[tuple[int, int] | None, str]:
    """(width, height) of an image, or None and what is wrong with it."""
    if path.is_symlink():
        try:
            require_inside(files.root, path)
        except BadSequence:
            return None, f"{path.name} is a link out of the dataset"
    if not path.is_file():
        return None, f"{path.name} is missing"
    try:
        return check_images([path]), ""
    except BadFrames:
        what = "empty (0 bytes)" if path.stat().st_size == 0 else "truncated or no image"
        return None, f"{path.name} is {what}"


def _fault(size: tuple[int, int] | None, fault: str, expected: tuple[int, int]) -> str:
    if size is None or size == expected:
        return fault
    return f"image of {size[0]}x{size[1]} px, others have {expected[0]}x{expected[1]} px"


def _count_spare(image_dir: Path, n_frames: int) -> int:
    numbers = [number_in_name(path.name) for path in image_dir.glob("image_*.jpg")]
    return sum(number is not None and number >= n_frames for number in numbers)
