"""Some frames of a sequence with their masks, as small pictures.

The reasons for which frames are dropped, by kind: those that differ in a number are of one.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gmrdata.masks.folder import find_mask
from gmrdata.pages.masks_sheet import masked_tile
from gmrdata.read.frames import number_in_name, read_color, read_gray
from gmrdata.read.threedpw_layout import SequenceFiles, require_inside
from gmrdata.values.errors import BadFrames, GmrdataError

COLOURS = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#c9b800", "#8a6d3b")
"""Colour-blind readers tell these apart (Okabe and Ito 2008), on white and on black."""
OTHER = "#8f979e"
"""The colour of all further kinds."""


@dataclass(frozen=True)
class Kind:
    """One kind of reason."""

    words: str
    """The reason; "…" for the number in which several differ."""
    colour: str
    """Its colour."""


def kinds_of(reasons: Sequence[Sequence[str]]) -> dict[str, Kind]:
    """The kind of each reason that occurs, in the order in which they do.

    Args:
        reasons: (P, T) why each frame is dropped; empty where it is kept.
    """
    found = list(dict.fromkeys(reason for person in reasons for reason in person if reason))
    groups: dict[str, list[str]] = {}
    for reason in found:
        groups.setdefault(re.sub(r"[0-9]+", "…", reason), []).append(reason)
    kinds: dict[str, Kind] = {}
    for number, (pattern, members) in enumerate(groups.items()):
        colour = COLOURS[number] if number < len(COLOURS) else OTHER
        kind = Kind(members[0] if len(members) == 1 else pattern, colour)
        kinds |= dict.fromkeys(members, kind)
    return kinds


def counts_of(reasons: Sequence[Sequence[str]], kinds: Mapping[str, Kind]) -> dict[Kind, int]:
    """How many frames of all people are dropped for each kind, the most frequent first."""
    counts = Counter(kinds[reason] for person in reasons for reason in person if reason)
    return dict(counts.most_common())


def example_frames(reasons: Sequence[Sequence[str]], kinds: Mapping[str, Kind]) -> dict[Kind, int]:
    """For each kind the middle one of the frames that are dropped for it, of whoever comes first.

    Args:
        reasons: (P, T) why each frame is dropped; empty where it is kept.
        kinds: Their kinds.
    """
    frames: dict[Kind, list[int]] = {}
    for person in reasons:
        earlier = set(frames)
        for frame, reason in enumerate(person):
            if reason and kinds[reason] not in earlier:
                frames.setdefault(kinds[reason], []).append(frame)
    return {kind: of_kind[len(of_kind) // 2] for kind, of_kind in frames.items()}


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
