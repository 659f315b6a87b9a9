"""Some frames of a sequence with their masks, as small pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gmrdata.errors import BadFrames, GmrdataError
from gmrdata.frames import number_in_name, read_color, read_gray
from gmrdata.masks.folder import find_mask
from gmrdata.masks.sheet import masked_tile
from gmrdata.threedpw.layout import SequenceFiles, require_inside

N_TILES = 6
TILE_WIDTH_PX = 260
THUMBNAIL_WIDTH_PX = 88
JPEG_QUALITY = 80


@dataclass(frozen=True, eq=False)
class Tile:
    """One frame of the strip."""

    image_number: int
    """Number in the image's file name: the frame."""
    picture: np.ndarray | None
    """(h, w, 3) BGR, the masked part tinted; None if the image can't be read."""
    problem: str
    """Why there is no picture, or no mask on it; empty if there are both."""


def spaced(numbers: Sequence[int]) -> list[int]:
    """A few of some frames, evenly spaced from the first to the last."""
    at = np.linspace(0, len(numbers) - 1, min(N_TILES, len(numbers))).round().astype(int)
    return [numbers[i] for i in at]


def image_numbers(files: SequenceFiles) -> list[int]:
    """Numbers of the images that lie in a sequence's folder, in order; none if it leads out."""
    try:
        require_inside(files.root, files.image_dir)
    except GmrdataError:
        return []
    found = [number_in_name(path.name) for path in files.image_dir.glob("image_*.jpg")]
    return sorted(number for number in found if number is not None)


def read_tile(files: SequenceFiles, masks_dir: Path, number: int) -> Tile:
    """One frame with its mask; a file that can't be read is named, and no error.

    Args:
        files: The sequence.
        masks_dir: Its masks, there or not.
        number: The frame.
    """
    path = files.image_path(number)
    try:
        # A link could show a file from anywhere on the page.
        require_inside(files.root, path)
        image = read_color(path)
    except (GmrdataError, OSError) as error:
        return Tile(number, None, str(error))
    mask, problem = np.zeros(image.shape[:2], np.uint8), "no masks were made"
    if masks_dir.is_dir():
        try:
            mask = read_gray(find_mask(masks_dir, path), (image.shape[1], image.shape[0]))
            problem = ""
        except (GmrdataError, OSError) as error:
            problem = str(error)
    return Tile(number, masked_tile(image, mask, TILE_WIDTH_PX), problem)


def jpeg(picture: np.ndarray, width_px: int | None = None) -> bytes:
    """JPEG bytes of a picture (h, w, 3) BGR, made `width_px` wide if that is given."""
    if width_px is not None:
        height_px = max(1, round(width_px * picture.shape[0] / picture.shape[1]))
        picture = cv2.resize(picture, (width_px, height_px), interpolation=cv2.INTER_AREA)
    ok, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise BadFrames(f"a picture of {picture.shape} can't be encoded as JPEG")
    return encoded.tobytes()
