"""A FrameSet without images, for those who ask only for numbers, times and size; even images."""

from pathlib import Path

import numpy as np

from gmrdata.read.frames import write_gray
from gmrdata.values.frame_set import FrameSet


def frame_set(
    frame_numbers: np.ndarray, size_px: tuple[int, int], fps_hz: float, n_frames: int | None = None
) -> FrameSet:
    """Images 0, 1, ... that are these frames of a video."""
    n = len(frame_numbers)
    return FrameSet(
        folder=Path(),
        paths=tuple(Path(f"{number:05d}.jpg") for number in range(n)),
        numbers=np.arange(n),
        size_px=size_px,
        frame_numbers=frame_numbers,
        n_frames=n_frames,
        times_s=np.arange(n) / fps_hz,
        rate_hz=fps_hz,
    )


def grey_images(folder: Path, n: int = 3, size_px: tuple[int, int] = (64, 48)) -> Path:
    """A folder of images 0.png, 1.png, ... in which nothing is to be seen."""
    for number in range(n):
        write_gray(folder / f"{number}.png", np.full(size_px[::-1], 128, np.uint8))
    return folder
