"""Odd and hostile videos beside those of test_video.py: each is read rightly or refused by name."""

import os
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from gmrdata.read.video import VideoConfig, expected_frames, extract_video
from gmrdata.values.errors import BadFrames, GmrdataError, MissingInput
from gmrdata.values.frame_set import VideoRecord
from tests.read.videos import extracted, make_video, picture, remuxed, textured


def read(video: Path, **config: object) -> tuple[list[np.ndarray], VideoRecord]:
    """The pictures (H, W, 3) BGR and the record of a video."""
    paths, record = extracted(video, **config)
    return [cv2.imread(str(path), cv2.IMREAD_COLOR) for path in paths], record


def test_a_picture_of_one_pixel(tmp_path):
    ones = [np.full((1, 1, 3), 30 * i, np.uint8) for i in range(3)]
    images, record = read(make_video(tmp_path / "a.mkv", ones, "ffv1", "bgr0"))
    assert record.size_px == (1, 1) and [int(im[0, 0, 0]) for im in images] == [0, 30, 60]


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("gray.mkv", "ffv1", "gray"),
        ("alpha.mov", "png", "rgba"),
        ("full.mp4", "libx264", "yuv444p"),
        ("deep.mkv", "ffv1", "yuv420p16le"),
    ],
)
def test_other_pixel_formats(tmp_path, name, codec, pixel_format):
    given = [cv2.GaussianBlur(textured(i), (0, 0), 3) for i in range(3)]
    images, record = read(make_video(tmp_path / name, given, codec, pixel_format))
    assert record.pixel_format == pixel_format and len(images) == 3
    gray = [cv2.cvtColor(im, cv2.COLOR_RGB2GRAY).astype(int) for im in given]
    for seen, true in zip(images, gray, strict=True):
        assert np.abs(cv2.cvtColor(seen, cv2.COLOR_BGR2GRAY) - true).mean() < 4


def test_high_dynamic_range_is_read_at_ten_bits(tmp_path):
    """Its tones are not mapped: features need none of that, and nothing is clipped."""
    tags = {"color_primaries": "bt2020", "color_trc": "smpte2084", "colorspace": "bt2020nc"}
    video = make_video(tmp_path / "a.mkv", None, "libx264", "yuv420p10le", options=tags)
    images, record = read(video)
    assert record.pixel_format == "yuv420p10le" and len(images) == 8
    assert images[0][30, 50].max() < images[7][30, 50].max() < 60


def test_a_count_of_frames_that_is_far_too_large(tmp_path):
    video = make_video(tmp_path / "a.mp4")
    content = bytearray(video.read_bytes())
    at = content.index(b"stsz") + 12  # version, size, then the count (ISO 14496-12, 8.7.3)
    assert int.from_bytes(content[at : at + 4], "big") == 8
    content[at : at + 4] = (2**31 - 1).to_bytes(4, "big")
    video.write_bytes(content)
    with pytest.raises(BadFrames, match=r"a\.mp4: "):
        read(video)


def test_a_size_that_changes_in_the_middle(tmp_path):
    sizes_px = 4 * [(64, 48)] + 4 * [(96, 64)]
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for number, size_px in enumerate(sizes_px):
            packet = av.Packet(cv2.imencode(".jpg", picture(number, size_px))[1].tobytes())
            packet.pts = packet.dts = number
            packet.time_base, packet.stream = Fraction(1, 25), stream
            packet.is_keyframe = True
            container.mux(packet)
    for take in (False, True):
        with pytest.raises(BadFrames, match="frame 4 is 96x64 px, the frames before it 64x48 px"):
            read(tmp_path / "a.mkv", take_what_decodes=take)
    assert len(read(tmp_path / "a.mkv", to_s=0.13)[0]) == 4


def test_two_streams_one_behind_the_other(tmp_path):
    small, large = make_video(tmp_path / "a.ts"), make_video(tmp_path / "b.ts")
    both = tmp_path / "both.ts"
    both.write_bytes(small.read_bytes() + large.read_bytes())
    with pytest.raises(BadFrames, match=r"both\.ts: "):
        read(both)


def test_a_stream_without_its_first_key_frame(tmp_path):
    whole = make_video(tmp_path / "a.mp4", [textured(i) for i in range(24)], options={"g": "8"})
    headless = remuxed(whole, tmp_path / "b.mp4", lambda place, _: place > 0)
    with pytest.raises(BadFrames, match=r"23 frames by .* but 1\d can be"):
        read(headless)
    images, record = read(headless, take_what_decodes=True)
    assert record.n_lost > 0 and len(images) == record.n_decoded >= 16
    rest = remuxed(whole, tmp_path / "c.mp4", lambda place, packet: not packet.is_keyframe)
    with pytest.raises(BadFrames, match=r"c\.mp4"):
        read(rest)


@pytest.mark.parametrize("name", ["b.mkv", "b.mp4", "b.ts"])
def test_pictures_that_a_cut_took_the_others_from_are_not_lost(tmp_path, name):
    """An open group of pictures begins with some that no player shows once it is the first."""
    how = {"bf": "3", "x264-params": "open-gop=1:scenecut=0:b-pyramid=none:keyint=24"}
    pictures = [textured(i) for i in range(72)]
    whole = make_video(tmp_path / f"a{Path(name).suffix}", pictures, options=how)
    with av.open(str(whole)) as file:
        packets = [packet for packet in file.demux(video=0) if packet.size]
    second = [place for place, packet in enumerate(packets) if packet.is_keyframe][1]
    shown = [p for p in packets[second:] if (p.pts or 0) >= (packets[second].pts or 0)]
    assert len(shown) == len(packets) - second - 3
    cut = remuxed(whole, tmp_path / name, lambda place, _: place >= second)
    images, record = read(cut)
    assert (len(images), record.n_expected, record.rate_hz) == (len(shown), len(shown), 25)
    assert expected_frames(cut, VideoConfig()).n_frames == len(shown)
    early = cut.rename(tmp_path / f"early{cut.suffix}")
    _, part = read(early, to_s=0.5)
    assert (part.n_expected, part.n_lost) == (13, 0)


def test_a_broadcast_begins_anywhere(tmp_path):
    whole = make_video(tmp_path / "a.ts", [textured(i) for i in range(60)], options={"g": "20"})
    rest = remuxed(whole, tmp_path / "b.ts", lambda place, _: place > 2)
    images, record = read(rest)
    expected = expected_frames(rest, VideoConfig())
    assert (len(images), record.n_expected, expected.n_frames) == (40, 40, 40)


def test_times_below_zero_and_a_late_start(tmp_path):
    for first in (-50, 9000):
        ticks = [first + i for i in range(8)]
        video = make_video(tmp_path / f"{abs(first)}.mkv", ticks=ticks)
        _, record = read(video)
        assert record.times_s == pytest.approx([0.04 * i for i in range(8)], abs=1e-3)


def test_a_still_of_an_hour_between_two_takes_keeps_its_times(tmp_path):
    video = make_video(tmp_path / "a.mkv", ticks=[0, 1, 2, 3, 90_000, 90_001, 90_002, 90_003])
    _, record = read(video)
    assert record.times_s[4] - record.times_s[3] == pytest.approx(3599.88, abs=0.01)
    assert record.rate_hz == pytest.approx(25, rel=0.03)


def test_a_song_with_a_cover_is_no_video(tmp_path):
    with av.open(str(tmp_path / "a.mp3"), "w") as container:
        sound: Any = container.add_stream("mp3", rate=16000)
        cover: Any = container.add_stream("png", rate=1)
        cover.width, cover.height, cover.pix_fmt = 64, 48, "rgb24"
        container.mux(cover.encode(av.VideoFrame.from_ndarray(picture(0), format="rgb24")))
        for start in range(0, 16000, 1152):
            silence = np.zeros((1, 1152), np.float32)
            frame = av.AudioFrame.from_ndarray(silence, "fltp", "mono")
            frame.sample_rate, frame.pts, frame.time_base = 16000, start, Fraction(1, 16000)
            container.mux(sound.encode(frame))
        container.mux(sound.encode())
        container.mux(cover.encode())
    with pytest.raises(BadFrames, match=r"a\.mp3: (has no video stream|no video)"):
        read(tmp_path / "a.mp3")


def test_a_moving_gif(tmp_path):
    pictures = [picture(3 * i) for i in range(6)]
    images, record = read(make_video(tmp_path / "a.gif", pictures, "gif", "rgb8"))
    assert len(images) == 6 and record.codec == "gif"


def test_rubbish_behind_a_video_does_not_matter_and_zeros_inside_do(tmp_path):
    video = make_video(tmp_path / "a.mp4", [textured(i) for i in range(8)])
    content = video.read_bytes()
    (tmp_path / "b.mp4").write_bytes(content + os.urandom(5000))
    assert len(read(tmp_path / "b.mp4")[0]) == 8
    start = content.index(b"mdat") + 4
    length = int.from_bytes(content[start - 8 : start - 4], "big") - 8
    zeros = content[:start] + bytes(length) + content[start + length :]
    (tmp_path / "c.mp4").write_bytes(zeros)
    with pytest.raises(BadFrames, match=r"c\.mp4"):
        read(tmp_path / "c.mp4")


def test_what_is_no_file_is_named(tmp_path):
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "gone.mp4").symlink_to(tmp_path / "nowhere.mp4")
    os.mkfifo(tmp_path / "pipe.mp4")
    for name in ("folder.mp4", "gone.mp4", "pipe.mp4"):
        with pytest.raises(MissingInput, match=re.escape(f"{name}: no such file")):
            extract_video(tmp_path / name, tmp_path / "frames")


def test_bytes_changed_anywhere_give_frames_or_a_clear_error(tmp_path):
    video = make_video(tmp_path / "a.mp4", [textured(i) for i in range(6)])
    content, rng = video.read_bytes(), np.random.default_rng(0)
    for number in range(25):
        changed = bytearray(content)
        for at in rng.integers(0, len(content), 1 + number % 8):
            changed[at] = int(rng.integers(256))
        broken = tmp_path / f"{number}.mp4"
        broken.write_bytes(changed)
        try:
            images, record = read(broken, take_what_decodes=bool(number % 2))
        except GmrdataError as error:
            assert str(broken) in str(error)
        else:
            assert 2 <= len(images) <= max(record.n_expected, 6)
