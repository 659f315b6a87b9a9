"""Videos that are written: what a decoder finds in them, equal bytes, and bad frames."""

from fractions import Fraction

import av
import numpy as np
import pytest

from gmrdata.values.errors import BadFrames
from gmrdata.write.video import write_video, write_video_of
from tests.filming import write_pictures


def pictures(n: int, height_px: int = 48, width_px: int = 64) -> list[np.ndarray]:
    """A grey gradient with a red patch that moves to the right."""
    gradient = np.linspace(40, 200, width_px).astype(np.uint8)
    frames = []
    for i in range(n):
        frame = np.tile(gradient[None, :, None], (height_px, 1, 3))
        frame[8:24, 4 * i : 4 * i + 16] = (220, 30, 30)
        frames.append(frame)
    return frames


@pytest.mark.parametrize(
    ("fps_hz", "rate"), [(10.0, Fraction(10)), (30000 / 1001, Fraction(30000, 1001))]
)
def test_a_decoder_finds_the_frames(tmp_path, fps_hz, rate):
    frames = pictures(7)
    assert write_video(iter(frames), tmp_path / "a.mp4", fps_hz) == 7
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.pix_fmt == "yuv420p"
        assert stream.average_rate == rate
        found = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(found) == 7
    for frame, expected in zip(found, frames, strict=True):
        assert np.abs(frame.astype(float) - expected).mean() < 4


@pytest.mark.parametrize("quick", [False, True])
def test_equal_frames_give_equal_bytes(tmp_path, quick):
    for name in ("a.mp4", "b.mp4"):
        write_video(pictures(12), tmp_path / name, 10.0, quick=quick)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_odd_sizes_grow_by_a_pixel(tmp_path):
    write_video(pictures(3, 47, 63), tmp_path / "a.mp4", 10.0)
    with av.open(str(tmp_path / "a.mp4")) as container:
        context = container.streams.video[0].codec_context
        assert (context.width, context.height) == (64, 48)


def test_images_in_files(tmp_path):
    paths = write_pictures(tmp_path / "frames", [frame[..., ::-1] for frame in pictures(3)])
    assert write_video_of(paths, tmp_path / "files.mp4", 10.0) == 3
    write_video(pictures(3), tmp_path / "arrays.mp4", 10.0)
    assert (tmp_path / "files.mp4").read_bytes() == (tmp_path / "arrays.mp4").read_bytes()
    paths[1].write_bytes(b"")
    with pytest.raises(BadFrames, match=r"00001\.png"):
        write_video_of(paths, tmp_path / "broken.mp4", 10.0)
    assert not (tmp_path / "broken.mp4").exists()


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([], "no frames"),
        ([np.zeros((48, 64), np.uint8)], "not uint8"),
        ([np.zeros((48, 64, 3), np.float32)], "not uint8"),
        ([np.zeros((48, 64, 3), np.uint8), np.zeros((48, 66, 3), np.uint8)], "ones before"),
    ],
)
def test_frames_that_make_no_video(tmp_path, frames, reason):
    with pytest.raises(BadFrames, match=reason):
        write_video(frames, tmp_path / "a.mp4", 10.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fps_hz", [0.0, -5.0, 1e-4, float("nan"), float("inf")])
def test_rates_that_make_no_video(tmp_path, fps_hz):
    """A picture in three hours, finer than a video's rate, was shown at 24 a second."""
    with pytest.raises(BadFrames, match="frames per second"):
        write_video(pictures(2), tmp_path / "a.mp4", fps_hz)
