"""A video file as a folder of numbered frames."""

from pathlib import Path

from pydantic import Field

from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames, MissingInput
from gmrdata.values.files import atomic_path
from gmrdata.values.records import Config

VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v")


class VideoConfig(Config):
    """How frames are written."""

    jpeg_quality: int = Field(default=95, ge=1, le=100)


def is_video(path: Path) -> bool:
    """Whether a path is a file with a video's suffix."""
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES


def extract_video(
    path: Path, out_dir: Path, config: VideoConfig | None = None, *, run: Run = DEFAULT_RUN
) -> Path:
    """Stage: write a video's frames as `00000.jpg`, ...; the number is the frame's in the video."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    config = config or VideoConfig()

    def work(partial_dir: Path) -> None:
        import cv2

        quality = [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]
        video, n_written = cv2.VideoCapture(str(path)), 0
        while (image := video.read()[1]) is not None:
            with atomic_path(partial_dir / f"{n_written:05d}.jpg") as temporary:
                cv2.imwrite(str(temporary), image, quality)
            n_written += 1
        if n_written < 2:
            what = f"{n_written} frames could be read, but a motion needs at least 2"
            remedy = "Give a longer video, or one in a common format (H.264 in .mp4)"
            raise BadFrames(f"{path}: {what}. {remedy}")

    return run_stage("frames", out_dir, config, {"video": path}, work, run=run)
