"""FrameSet: the images of one sequence, as they were checked once, and when they were taken."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import PositiveFloat, PositiveInt, model_validator

from gmrdata.values.camera import Lens
from gmrdata.values.errors import BadRecipe
from gmrdata.values.limits import HIGHEST_FPS_HZ, LOWEST_FPS_HZ
from gmrdata.values.records import Record

VIDEO_FILE = "video.json"
USUAL_HZ = 30.0  # of frames whose rate nobody says


class VideoRecord(Record):
    """`video.json` beside the frames: what the video is, and which frames were taken when."""

    format: Literal["gmrdata-video/3"] = "gmrdata-video/3"
    container: str
    codec: str
    pixel_format: str
    stored_size_px: tuple[int, int]
    """(width, height) in the file."""
    size_px: tuple[int, int]
    """(width, height) of the frames that were written."""
    is_turned: bool
    """The file says that its pictures are to be turned or mirrored, which was done."""
    n_deinterlaced: int
    """Frames whose two half pictures were of two times, of which the first was kept."""
    n_expected: int
    """Frames that the file holds by its own count, as far as it was read."""
    n_decoded: int
    """Those of them that could be decoded."""
    is_part: bool
    """It was read to a time before its end, so frames after those are not counted."""
    every: PositiveInt
    """An image's number is its frame's divided by this."""
    rate_hz: PositiveFloat
    """Images per second: the container's rate where all times are on its grid, else a fit."""
    numbers: tuple[int, ...]
    """By image: the frame's number among the decoded ones, from 0."""
    times_s: tuple[float, ...]
    """By image: its time, counted from the first frame's [s]."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if (n := len(self.numbers)) != len(self.times_s):
            raise ValueError(f"{n} numbers, but {len(self.times_s)} times_s")
        return self

    @property
    def n_lost(self) -> int:
        return self.n_expected - self.n_decoded

    @property
    def frame_of(self) -> dict[int, int]:
        """By an image's number: which of the decoded frames it is, from 0."""
        return {number // self.every: number for number in self.numbers}

    def times_of(self, image_numbers: np.ndarray) -> np.ndarray:
        """(T,) times of images by number [s]; NaN of a number that no image has."""
        known = dict(zip(self.frame_of, self.times_s, strict=True))
        return np.array([known.get(int(number), np.nan) for number in image_numbers])


@dataclass(frozen=True, eq=False)
class FrameSet:
    """T images in one folder, upright and of one size; `gmrdata.read.frames.read_frames` makes it,
    and nobody lists or opens the folder again to find out."""

    folder: Path
    paths: tuple[Path, ...]  # (T,) in the order of their numbers
    numbers: np.ndarray  # (T,) int, ascending, as in the images' names
    size_px: tuple[int, int]  # (width, height)
    frame_numbers: np.ndarray  # (T,) int: which frame of the video each is, counted from 0
    n_frames: int | None  # Of the whole video; None where only a part of it was read
    times_s: np.ndarray  # (T,) from the video's first frame on; NaN where nobody says
    rate_hz: float  # Images per second; NaN where nobody says
    video: VideoRecord | None = None  # None of images that came from no video
    video_path: Path | None = None  # The video's file, where it was read for this
    left_out: Mapping[int, Path] = field(default_factory=dict)
    """Images of the folder that are not among these, by number."""

    @property
    def inputs(self) -> dict[str, Path]:
        """The files by role, for a stage's record, which so tells that other images are taken."""
        left_out = {f"left out {number}": path for number, path in self.left_out.items()}
        return {"images": self.folder} | left_out

    def with_rate(self, fps_hz: float | None) -> "FrameSet":
        """The same with times: a video has its own, and images need a rate; errors as of
        `require_rate`."""
        require_rate(self.folder, fps_hz, has_times=bool(np.isfinite(self.rate_hz)))
        if fps_hz is None:
            return self
        return replace(self, times_s=self.frame_numbers / fps_hz, rate_hz=fps_hz)

    @property
    def numbers_in_time(self) -> np.ndarray:
        """(T,) the images' numbers, with room for frames that the camera dropped: the next one is
        shown later by whole frames of the video."""
        every = 1 if self.video is None else self.video.every
        steps = np.maximum(1, np.rint(np.diff(self.times_s) * self.rate_hz * every) / every)
        if not np.isfinite(steps).all() or (steps == np.diff(self.numbers)).all():
            return self.numbers
        return np.asarray(self.numbers[0] + np.cumsum([0.0, *steps]))

    @property
    def known_or_usual_hz(self) -> float:
        """Images per second; those of a usual video where nobody says it."""
        return self.rate_hz if np.isfinite(self.rate_hz) else USUAL_HZ

    @property
    def video_hz(self) -> float:
        """Frames of the video per second."""
        apart = np.diff(self.frame_numbers)
        return self.rate_hz * (float(np.median(apart)) if len(apart) else 1.0)


def require_rate(source: Path, fps_hz: float | None, *, has_times: bool) -> None:
    """Refuse images without times or a rate, with both, or with a rate that no camera has.

    Raises:
        BadRecipe: the message names the source and the remedy.
    """
    if has_times and fps_hz is not None:
        raise BadRecipe(f"{source}: a video has its own times. Leave --fps-hz out")
    if not has_times and fps_hz is None:
        raise BadRecipe(f"{source}: a folder of images has no frame rate. Give it with --fps-hz")
    if fps_hz is not None and not LOWEST_FPS_HZ <= fps_hz <= HIGHEST_FPS_HZ:
        most = f"{LOWEST_FPS_HZ:g} to {HIGHEST_FPS_HZ:g}"
        raise BadRecipe(f"--fps-hz {fps_hz:g}: images per second are from {most}")


class Filmed(NamedTuple):
    """Frames, and the lens that took them."""

    frames: FrameSet
    lens: Lens
