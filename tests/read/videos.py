"""Small videos of every kind, made with PyAV's own encoders."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from gmrdata.read.frames import video_record
from gmrdata.read.video import VideoConfig, extract_video
from gmrdata.values.frame_set import VideoRecord


def extracted(video: Path, **config: object) -> tuple[list[Path], VideoRecord]:
    """The images and the record of a video, in a folder beside it."""
    frames = extract_video(video, video.with_suffix(""), VideoConfig.model_validate(config))
    record = video_record(frames)
    assert record is not None
    return sorted(frames.glob("*.jpg")), record


def picture(number: int, size_px: tuple[int, int] = (64, 48)) -> np.ndarray:
    """(H, W, 3) uint8 RGB: dark, its upper left quarter red, brighter with the number."""
    image = np.full((size_px[1], size_px[0], 3), 4 * number, dtype=np.uint8)
    image[: size_px[1] // 2, : size_px[0] // 2] = (220, 30, 30)
    return image


def textured(number: int) -> np.ndarray:
    """(120, 160, 3) uint8 RGB that moves to the right."""
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    return np.ascontiguousarray(np.roll(cv2.GaussianBlur(noise, (0, 0), 2), 2 * number, axis=1))


def make_video(
    path: Path,
    images: Sequence[np.ndarray] | None = None,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    *,
    rate_hz: int | Fraction = 25,
    ticks: Sequence[int] | None = None,
    rotation_deg: float | None = None,
    pixel_aspect: Fraction | None = None,
    muxer: dict[str, str] | None = None,
    options: dict[str, str] | None = None,
) -> Path:
    """Write RGB images; `ticks` are their times in units of one over the rate."""
    images = [picture(i) for i in range(8)] if images is None else images
    with av.open(str(path), "w", container_options=muxer or {}) as container:
        stream: Any = container.add_stream(codec, rate=rate_hz, options=options or {})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixel_format
        if pixel_aspect is not None:
            stream.codec_context.sample_aspect_ratio = pixel_aspect
        if rotation_deg is not None:
            stream.set_display_rotation(rotation_deg)
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            if ticks is not None:
                frame.pts, frame.time_base = ticks[number], 1 / Fraction(rate_hz)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def remuxed(video: Path, out: Path, keep: Callable[[int, Any], bool]) -> Path:
    """The same stream with some packets alone, by their place and themselves; `keep` may change
    their times."""
    with av.open(str(video)) as old, av.open(str(out), "w") as new:
        stream = new.add_stream_from_template(old.streams.video[0])
        for place, packet in enumerate(old.demux(video=0)):
            if packet.size and keep(place, packet):
                packet.stream = stream
                new.mux(packet)
    return out


def with_hole(path: Path, at: int, n_bytes: int) -> Path:
    """Overwrite a part of a file with zeros."""
    content = bytearray(path.read_bytes())
    content[at : at + n_bytes] = bytes(n_bytes)
    path.write_bytes(content)
    return path
