"""Write frames as a video that every player shows: H.264 in mp4, the same bytes each time."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np

from gmrdata.read.frames import decoded
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import atomic_path

CRF = 18  # libx264's constant rate factor; 18 is about where losses stop being visible
LARGEST_FPS_DENOMINATOR = 1001


def write_video(
    frames: Iterable[np.ndarray],
    path: Path,
    fps_hz: float,
    *,
    crf: int = CRF,
    quick: bool = False,
    most_kbit: tuple[int, int] | None = None,
) -> int:
    """Write frames, (H, W, 3) uint8 of one size, red first, to an mp4; gives their number.

    It is written as a whole or not at all.  An odd width or height is made even by repeating the
    last column or row, because the pixel format (yuv420p, the one that players agree on) halves the
    colours' size.  `crf` is libx264's quality, 0 (lossless) to 51.  A `quick` video takes a
    tenth of the time, and shows a little less for its size.  `most_kbit` is what a player that
    reads so much a second, and holds so much, can take (x264's VBV): what moves much is coarser
    then.
    """
    import av

    rate = Fraction(fps_hz if np.isfinite(fps_hz) else 0).limit_denominator(LARGEST_FPS_DENOMINATOR)
    if not rate > 0:
        raise BadFrames(f"{path}: a video can't have {fps_hz} frames per second")
    n_written = 0
    size: tuple[int, ...] | None = None
    with atomic_path(path) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.pix_fmt = "yuv420p"
        stream.thread_count = 1  # more would be allowed to change the bytes
        # x264's assembly looks past the ends of rows when it weighs its choices, so that what lay
        # there by chance decided bytes in about one of eight files.  Its C code does not, and a
        # quick video weighs nothing: of five sizes, 100 files each had the same bytes.
        params, preset = ("threads=1", "superfast") if quick else ("threads=1:asm=0", "medium")
        if most_kbit is not None:
            params += ":vbv-maxrate={}:vbv-bufsize={}".format(*most_kbit)
        stream.options = {"crf": str(crf), "preset": preset, "x264-params": params}
        for frame in frames:
            even = _even(path, frame, size)
            if size is None:
                stream.height, stream.width = even.shape[:2]
            size = frame.shape
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
            n_written += 1
        if n_written == 0:
            raise BadFrames(f"{path}: no frames for a video")
        container.mux(stream.encode())
    return n_written


def write_video_of(images: list[Path], path: Path, fps_hz: float) -> int:
    """The same from image files, in the given order."""
    import cv2

    fault = "missing or not an image; make this file again"
    pictures = (decoded(image, cv2.IMREAD_COLOR, fault)[..., ::-1] for image in images)
    return write_video(pictures, path, fps_hz)


def _even(path: Path, frame: np.ndarray, size: tuple[int, ...] | None) -> np.ndarray:
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or 0 in frame.shape:
        raise BadFrames(f"{path}: a frame is {frame.dtype} {frame.shape}, not uint8 (H, W, 3)")
    if size is not None and frame.shape != size:
        raise BadFrames(f"{path}: a frame is {frame.shape}, the ones before are {size}")
    height, width = frame.shape[:2]
    return np.ascontiguousarray(np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), "edge"))
