"""Some frames of a sequence with their masks, as small pictures."""

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


def frame_tiles(files: SequenceFiles, masks_dir: Path, n_frames: int) -> list[Tile]:
    """Evenly spaced frames of a sequence.

    Args:
        files: The sequence.
        masks_dir: Its masks, there or not.
        n_frames: Number of frames T; 0 if unknown: then as many as there are images.
    """
    try:
        require_inside(files.root, files.image_dir)
    except GmrdataError:
        return []
    numbers = list(range(n_frames)) or _numbers(files.image_dir)
    if not numbers or not files.image_dir.is_dir():
        return []
    chosen = np.linspace(0, len(numbers) - 1, min(N_TILES, len(numbers))).round().astype(int)
    return [_tile(files, masks_dir, numbers[at]) for at in chosen]


def jpeg(picture: np.ndarray, width_px: int | None = None) -> bytes:
    """JPEG bytes of a picture (h, w, 3) BGR, made `width_px` wide if that is given."""
    if width_px is not None:
        height_px = max(1, round(width_px * picture.shape[0] / picture.shape[1]))
        picture = cv2.resize(picture, (width_px, height_px), interpolation=cv2.INTER_AREA)
    ok, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise BadFrames(f"a picture of {picture.shape} can't be encoded as JPEG")
    return encoded.tobytes()


def _tile(files: SequenceFiles, masks_dir: Path, number: int) -> Tile:
    path = files.image_path(number)
    try:
        # A link could show a file from anywhere on the page.
        require_inside(files.root, path)
        image = read_color(path)
    except (GmrdataError, OSError) as error:
        return Tile(number, None, str(error))
    no_mask = np.zeros(image.shape[:2], np.uint8)
    if not masks_dir.is_dir():
        return Tile(number, masked_tile(image, no_mask, TILE_WIDTH_PX), "no masks were made")
    try:
        mask = read_gray(find_mask(masks_dir, path), (image.shape[1], image.shape[0]))
    except (GmrdataError, OSError) as error:
        return Tile(number, masked_tile(image, no_mask, TILE_WIDTH_PX), str(error))
    return Tile(number, masked_tile(image, mask, TILE_WIDTH_PX), "")


def _numbers(image_dir: Path) -> list[int]:
    found = [number_in_name(path.name) for path in image_dir.glob("image_*.jpg")]
    return sorted(number for number in found if number is not None)
