"""Keyframes: as many frames as the camera's motion needs, so that not each one goes through SIFT.

Corners of the background are followed from frame to frame (Lucas and Kanade 1981, pyramids by
Bouguet).  A frame becomes a keyframe when they have moved far enough since the last one, when half
of them are lost, or after the longest gap; a slow or short sequence gets more, evenly spread.

Following image points from one frame to another, and frames that are ready for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.masks.folder import find_mask
from gmrdata.read.frames import read_gray

WINDOW_PX = 21
LEVELS = 3
RETURN_PX = 0.5
"""A point that is followed there and back must come home this close [px]."""
MASK_MARGIN_PX = 8
"""Points nearer to a mask see what moves in half of their window."""
CENTRE_PX = 0.5
"""Our (0, 0) is the corner of the first pixel, OpenCV's its centre."""


def follow(
    before: np.ndarray,
    after: np.ndarray,
    points_px: np.ndarray,
    guess_px: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Find image points again in another frame (Lucas and Kanade 1981; pyramids: Bouguet 2000).

    Args:
        before: (H, W) uint8 frame.
        after: (H, W) uint8 frame.
        points_px: (N, 2) points of the frame before [px].
        guess_px: (N, 2) where they may be in the frame after; then only the finest level is
            searched [px].

    Returns:
        (N, 2) where they are [px], and (N,) bool: found, and found back.
    """
    if not len(points_px):
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    start = _to_opencv(points_px)
    guess = start.copy() if guess_px is None else _to_opencv(guess_px)
    levels = LEVELS if guess_px is None else 0
    there, ok = _flow(before, after, start, guess, levels)
    back, ok_back = _flow(after, before, there, start.copy(), levels)
    near = np.linalg.norm((back - start)[:, 0], axis=1) < RETURN_PX
    found = ok & ok_back & near
    return there[:, 0].astype(np.float64) + CENTRE_PX, found


def _flow(
    before: np.ndarray, after: np.ndarray, start: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    there, ok, _ = cv2.calcOpticalFlowPyrLK(
        before,
        after,
        start,
        guess,
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(there), np.asarray(ok)[:, 0] == 1


def read_frame(
    image: Path, masks_dir: Path | None, size_px: tuple[int, int], shrink: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """A frame (h, w) uint8, and where its background can be followed, (h, w) bool.

    Args:
        image: The frame.
        masks_dir: Masks (255 = dynamic), or None.
        size_px: (width, height) that the frame and its mask must have.
        shrink: Size of what is returned, as a share.

    Raises:
        BadFrames: the frame or its mask is missing or of another size.
    """
    gray = read_gray(image, size_px)
    masked = np.zeros_like(gray)
    if masks_dir is not None:
        masked = read_gray(find_mask(masks_dir, image), size_px)
    if shrink < 1:
        gray = cv2.resize(gray, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        masked = cv2.resize(masked, gray.shape[::-1], interpolation=cv2.INTER_AREA)
    around = np.ones((2 * MASK_MARGIN_PX + 1,) * 2, np.uint8)
    return gray, cv2.dilate((masked > 0).astype(np.uint8), around) == 0


def is_free(points_px: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 2) [px] inside the frame, on its background (H, W)."""
    column, row = np.floor(points_px).astype(int).T
    inside = (row >= 0) & (row < free.shape[0]) & (column >= 0) & (column < free.shape[1])
    inside[inside] = free[row[inside], column[inside]]
    return inside


def _to_opencv(points_px: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray((points_px - CENTRE_PX)[:, None], dtype=np.float32)


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
