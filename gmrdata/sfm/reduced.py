"""Large frames made smaller before cameras are sought in them.

A camera is held by hundreds of points, so it gains little from more pixels than about a million,
while everything takes as many times longer as there are more.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.frames import read_gray
from gmrdata.masks.folder import find_mask
from gmrdata.threads import in_threads

FAST_PNG = 1
"""zlib's level of compression."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames as they are worked on."""

    images: list[Path]
    """The frames."""
    masks_dir: Path | None
    """Masks (255 = dynamic), one per frame."""
    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix [px]."""
    size_px: tuple[int, int]
    """(width, height)."""


def reduced(frames: Frames, longest_px: int, out_dir: Path) -> Frames:
    """Frames whose longer side is at most so long; those that are given if it is so already.

    Args:
        frames: The frames.
        longest_px: Longer side [px].
        out_dir: Folder for smaller ones, in shades of grey, and for their masks.

    Raises:
        BadFrames: a mask is missing, or it or a frame is broken or of another size.
    """
    import cv2

    share = longest_px / max(frames.size_px)
    if share >= 1:
        return frames
    width_px, height_px = (max(1, round(share * side_px)) for side_px in frames.size_px)
    masks_dir = None if frames.masks_dir is None else out_dir / "masks"
    (out_dir / "frames").mkdir(parents=True)
    if masks_dir is not None:
        masks_dir.mkdir()

    def reduce_one(image: Path) -> Path:
        # As PNG it would take 40 times as long to write, and 14 times to read.
        path = out_dir / "frames" / f"{image.stem}.bmp"
        gray = read_gray(image, frames.size_px)
        small = cv2.resize(gray, (width_px, height_px), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(path), small)
        if masks_dir is not None and frames.masks_dir is not None:
            mask = read_gray(find_mask(frames.masks_dir, image), frames.size_px)
            # A pixel is dynamic if any part of it is.
            covered = cv2.resize(mask, (width_px, height_px), interpolation=cv2.INTER_AREA) > 0
            fast = [cv2.IMWRITE_PNG_COMPRESSION, FAST_PNG]
            cv2.imwrite(str(masks_dir / f"{image.stem}.png"), 255 * covered.astype(np.uint8), fast)
        return path

    images = in_threads(reduce_one, frames.images)
    # Pixel (0, 0) is an outer corner, so pixels scale as lengths do.
    scaling = np.diag([width_px / frames.size_px[0], height_px / frames.size_px[1], 1.0])
    return Frames(images, masks_dir, scaling @ frames.intrinsics_px, (width_px, height_px))
