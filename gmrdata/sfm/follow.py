"""Following image points from one frame to another, and frames that are ready for it."""

from pathlib import Path

import cv2
import numpy as np

from gmrdata.frames import read_gray
from gmrdata.masks.folder import find_mask

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
