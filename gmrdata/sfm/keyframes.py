"""Keyframes: as many frames as the camera's motion needs, so that not each one goes through SIFT.

Corners of the background are followed from frame to frame (Lucas and Kanade 1981, pyramids by
Bouguet).  A frame becomes a keyframe when they have moved far enough since the last one, when half
of them are lost, or after the longest gap; a slow or short sequence gets more, evenly spread.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gmrdata.sfm.config import SfmConfig
from gmrdata.sfm.follow import CENTRE_PX, follow, is_free, read_frame

CORNERS = 400
CORNER_QUALITY = 0.01
CORNER_SPACING_PX = 8
FEATURELESS = 8
"""With fewer corners a frame shows nothing of the background."""
CUT_SHARE = 0.1
"""Where fewer corners than this survive one step, the two frames show different places."""
FEWEST_CORNERS = 20
"""With fewer to begin with, survival says nothing."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Which frames are keyframes, and what the choice was made on."""

    rows: np.ndarray
    """(K,) rows in order; the first and the last frame are among them."""
    survived: np.ndarray
    """(T-1,) share of the corners of frame t that were found again in frame t + 1."""
    corners: np.ndarray
    """(T-1,) number of corners that were looked for."""
    last_corners: int
    """Number of corners in the last frame."""

    @property
    def cuts(self) -> np.ndarray:
        """Rows t after which the picture changes to another place."""
        lost = (self.survived < CUT_SHARE) & (self.corners >= FEWEST_CORNERS)
        return np.flatnonzero(lost)

    @property
    def featureless(self) -> np.ndarray:
        """Rows that show nothing of the background: black, even, or wholly masked."""
        found = np.append(self.corners, self.last_corners)
        return np.flatnonzero(found < FEATURELESS)


def choose_keyframes(
    images: Sequence[Path],
    masks_dir: Path | None,
    size_px: tuple[int, int],
    config: SfmConfig,
) -> Keyframes:
    """Choose keyframes by how far the background moves in the image.

    Args:
        images: T frames in order.
        masks_dir: Masks (255 = dynamic), or None.
        size_px: (width, height) of the frames.
        config: The recipe.

    Raises:
        BadFrames: a frame or a mask is missing or of another size.
    """
    shrink = min(1.0, config.keyframe_image_size_px / max(size_px))
    step_px = config.keyframe_step * max(size_px) * shrink
    before, free = read_frame(images[0], masks_dir, size_px, shrink)
    start_px = now_px = _corners(before, free)
    n_start = len(start_px)
    rows, survived, corners = [0], [], []
    for row in range(1, len(images)):
        image, free = read_frame(images[row], masks_dir, size_px, shrink)
        next_px, found = follow(before, image, now_px)
        found &= is_free(next_px, free)
        survived.append(found.mean() if len(found) else 0.0)
        corners.append(len(found))
        start_px, now_px = start_px[found], next_px[found]
        moved_px = np.median(np.linalg.norm(now_px - start_px, axis=1)) if len(now_px) else np.inf
        late = row - rows[-1] >= config.keyframe_gap
        if moved_px >= step_px or len(now_px) < n_start / 2 or late or row == len(images) - 1:
            rows.append(row)
            start_px = now_px = _corners(image, free)
            n_start = len(start_px)
        before = image
    return Keyframes(
        _at_least(np.array(rows), len(images), config.min_keyframes),
        np.array(survived),
        np.array(corners, dtype=np.int64),
        len(now_px),
    )


def _at_least(rows: np.ndarray, n_frames: int, least: int) -> np.ndarray:
    """The rows, with evenly spread ones among them where they are fewer than `least`."""
    if len(rows) >= least:
        return rows
    spread = np.linspace(0, n_frames - 1, min(least, n_frames)).round().astype(rows.dtype)
    return np.union1d(rows, spread)


def _corners(image: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N, 2) corners of the background (Shi and Tomasi 1994) [px]."""
    found = cv2.goodFeaturesToTrack(
        image, CORNERS, CORNER_QUALITY, CORNER_SPACING_PX, mask=free.astype(np.uint8)
    )
    if found is None:
        return np.zeros((0, 2))
    return found[:, 0].astype(np.float64) + CENTRE_PX
