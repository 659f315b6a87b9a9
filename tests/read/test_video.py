"""Videos as frames a person would see, and videos that aren't, or not wholly."""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from gmrdata.read import video as video_module
from gmrdata.read.frames import video_record, write_gray
from gmrdata.read.video import (
    VideoConfig,
    as_frames,
    expected_frames,
    extract_video,
    is_video,
    turned,
)
from gmrdata.values.errors import BadFrames, BadRecipe, MissingInput
from gmrdata.values.frame_set import VIDEO_FILE
from tests.read.videos import extracted, make_video, picture, remuxed, textured, with_hole
from tests.record_keys import assert_each_key_is_needed


def red_quarter(image: Path) -> tuple[int, int]:
    """Which quarter of a picture is red: (row, column) of 0 and 1."""
    pixels = cv2.imread(str(image), cv2.IMREAD_COLOR).astype(int)
    rows, columns = np.nonzero(pixels[..., 2] - pixels[..., 0] > 90)
    height, width = pixels.shape[:2]
    return int(rows.mean() > height / 2), int(columns.mean() > width / 2)


def test_every_frame_is_written_under_its_number(tmp_path):
    video = make_video(
        tmp_path / "a.mp4", [np.full((48, 64, 3), 20 * i, np.uint8) for i in range(7)]
    )
    assert is_video(video) and not is_video(tmp_path)
    images, record = extracted(video)
    assert [image.name for image in images] == [f"{i:05d}.jpg" for i in range(7)]
    for i, image in enumerate(images):
        assert abs(float(cv2.imread(str(image)).mean()) - 20 * i) < 4
    assert (record.n_expected, record.n_decoded, record.is_turned) == (7, 7, False)
    assert record.times_s == pytest.approx([0.04 * i for i in range(7)])
    assert record.rate_hz == pytest.approx(25)


@pytest.fixture
def same_priority() -> Iterator[None]:
    """SVT-AV1's encoder gives root's thread real-time priority, which would starve all others."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    os.sched_setscheduler(0, policy, parameters)


@pytest.mark.usefixtures("same_priority")
@pytest.mark.parametrize(
    ("name", "codec", "pixel_format", "codec_read"),
    [
        ("a.mp4", "libx264", "yuv420p", "h264"),
        ("a.mp4", "libx264", "yuv420p10le", "h264"),
        ("a.mov", "libx265", "yuv420p10le", "hevc"),
        ("a.mkv", "libsvtav1", "yuv420p", "libdav1d"),
        ("a.MOV", "prores_ks", "yuv422p10le", "prores"),
        ("a.3gp", "mpeg4", "yuv420p", "mpeg4"),
        ("a.ts", "libx264", "yuv420p", "h264"),
        ("a.mpg", "mpeg2video", "yuv420p", "mpeg2video"),
        ("a.webm", "libvpx-vp9", "yuv420p", "vp9"),
        ("a.avi", "mjpeg", "yuvj420p", "mjpeg"),
    ],
)
def test_codecs_and_containers(tmp_path, name, codec, pixel_format, codec_read):
    try:
        av.codec.Codec(codec, "w")
    except av.codec.codec.UnknownCodecError:
        pytest.skip(f"this build of PyAV has no {codec}")
    quiet = {"x265-params": "log-level=none"} if codec == "libx265" else {}
    images, record = extracted(
        make_video(tmp_path / name, None, codec, pixel_format, options=quiet)
    )
    assert (len(images), record.n_expected, record.codec) == (8, 8, codec_read)
    assert record.pixel_format == pixel_format
    assert record.rate_hz == 25
    for number in (0, 7):
        seen = cv2.imread(str(images[number]))[..., ::-1].astype(int)
        assert np.abs(seen - picture(number)).mean() < 12


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
@pytest.mark.parametrize("colorspace", [None, "bt709"])
def test_frames_are_those_of_opencv(tmp_path, name, colorspace):
    """Plain videos give the same bytes as with the reader of before, OpenCV 4's.

    It did not look at the tag, as OpenCV 5 does: its frames are those of the video without one.
    """
    shown = [textured(i) for i in range(6)]
    untagged = make_video(tmp_path / f"untagged_{name}", shown)
    tagged = {} if colorspace is None else {"colorspace": colorspace}
    images, _ = extracted(make_video(tmp_path / name, shown, options=tagged))
    capture = cv2.VideoCapture(str(untagged))
    assert len(images) == len(shown)
    for image in images:
        _, encoded = cv2.imencode(".jpg", capture.read()[1], [cv2.IMWRITE_JPEG_QUALITY, 95])
        assert image.read_bytes() == encoded.tobytes()


@pytest.mark.parametrize(
    ("rotation_deg", "quarter"), [(0, (0, 0)), (90, (1, 0)), (180, (1, 1)), (-90, (0, 1))]
)
def test_a_turned_video_is_upright(tmp_path, rotation_deg, quarter):
    """Angles of the file are counter-clockwise, as FFmpeg has them."""
    images, record = extracted(make_video(tmp_path / "a.mp4", rotation_deg=rotation_deg))
    assert red_quarter(images[0]) == quarter
    size_px = (64, 48) if rotation_deg % 180 == 0 else (48, 64)
    assert record.size_px == size_px and record.stored_size_px == (64, 48)
    assert record.is_turned == (rotation_deg != 0)
    assert cv2.imread(str(images[0])).shape[1::-1] == size_px


def test_a_video_at_another_angle_is_refused(tmp_path):
    with pytest.raises(BadFrames, match="no quarter turn"):
        extracted(make_video(tmp_path / "a.mp4", rotation_deg=45))


@pytest.mark.parametrize("matrix", [[[a, 0], [0, d]] for a in (1, -1) for d in (1, -1)])
@pytest.mark.parametrize("is_swapped", [False, True])
def test_turning_follows_the_matrix(matrix, is_swapped):
    """A corner (x, y) from the middle goes where the matrix maps it; mirrored ones too."""
    shown_from_stored = np.array(matrix)[:, :: -1 if is_swapped else 1]
    image = np.zeros((4, 6), np.uint8)
    image[0, 5] = 1  # right, up
    expected = shown_from_stored @ [1, -1]
    row, column = np.argwhere(turned(image, shown_from_stored))[0]
    assert (column > 0, row > 0) == (expected[0] > 0, expected[1] > 0)


def test_odd_sizes_and_long_pixels(tmp_path):
    images = [picture(i, (65, 49)) for i in range(3)]
    _, record = extracted(make_video(tmp_path / "a.mkv", images, "ffv1", "yuv444p"))
    assert record.size_px == (65, 49)
    wide = make_video(tmp_path / "b.mp4", pixel_aspect=Fraction(3, 2))
    images_px, record = extracted(wide)
    assert record.size_px == (96, 48) and record.stored_size_px == (64, 48)
    assert red_quarter(images_px[0]) == (0, 0)


def shown_when_decoded(place: int, packet: Any) -> bool:
    """As recorders of network cameras write."""
    packet.pts = packet.dts = 40 * place
    packet.time_base = Fraction(1, 1000)
    return True


@pytest.mark.parametrize("name", ["a.avi", "a.asf", "a.mkv", "a.mp4", "a.mpg"])
def test_pictures_keep_their_order_where_packets_have_another(name, tmp_path):
    """AVI and ASF have no times of showing, nor has what a recorder writes; MPEG-PS has a few."""
    shown = [np.full((64, 96, 3), 5 * number, np.uint8) for number in range(40)]
    options = {"bf": "3", "crf": "10", "x264-params": "b-adapt=0"}
    video = make_video(tmp_path / name, shown, options=options)
    if name == "a.mkv":
        video = remuxed(video, tmp_path / "recorded.mkv", shown_when_decoded)
    images, record = extracted(video)
    seen = [cv2.imread(str(image)).mean() for image in images]
    assert seen == pytest.approx([5 * number for number in range(40)], abs=2.5)
    assert record.times_s == pytest.approx([number / 25 for number in range(40)])


def test_interlaced_frames_lose_their_combs(tmp_path):
    """Rows of two times: even ones of a bar that stands here, odd ones of one that stands there."""
    images = []
    for number in range(6):
        image = np.zeros((96, 128, 3), np.uint8)
        image[0::2, 8 * number + 10 : 8 * number + 40] = 200
        image[1::2, 8 * number + 14 : 8 * number + 44] = 200
        images.append(image)
    flags = {"flags": "+ildct+ilme", "x264-params": "tff=1", "crf": "5"}
    video = make_video(tmp_path / "a.mp4", images, options=flags)
    written, record = extracted(video)
    assert (len(written), record.n_deinterlaced) == (6, 6)
    assert record.times_s == pytest.approx([0.04 * i for i in range(6)])
    seen = cv2.imread(str(written[3]), cv2.IMREAD_GRAYSCALE).astype(int)
    combed = images[3][..., 0].astype(int)
    assert np.abs(np.diff(seen, axis=0)).mean() < 0.25 * np.abs(np.diff(combed, axis=0)).mean()
    early, n_early = extracted(make_video(tmp_path / "b.mp4", images, options=flags), to_s=0.1)
    assert len(early) == n_early.n_expected == 3


def test_each_frame_keeps_its_own_time(tmp_path):
    ticks = [0, 1, 2, 5, 6, 9]
    images = [picture(i) for i in range(6)]
    _, record = extracted(make_video(tmp_path / "a.mp4", images, ticks=ticks))
    assert record.times_s == pytest.approx([tick / 25 for tick in ticks])
    assert record.times_of(np.array([3, 0, 7, -1])) == pytest.approx(
        [0.2, 0, np.nan, np.nan], nan_ok=True
    )


@pytest.mark.parametrize(
    ("config", "numbers", "names"),
    [
        ({"from_s": 0.1}, [3, 4, 5, 6, 7], ["00003", "00007"]),
        ({"to_s": 0.12}, [0, 1, 2, 3], ["00000", "00003"]),
        ({"every": 3}, [0, 3, 6], ["00000", "00002"]),
        ({"from_s": 0.08, "to_s": 0.2, "every": 2}, [2, 4], ["00001", "00002"]),
    ],
)
def test_a_part_of_a_video(tmp_path, config, numbers, names):
    images, record = extracted(make_video(tmp_path / "a.mp4"), **config)
    assert list(record.numbers) == numbers and record.n_lost == 0
    assert record.times_s == pytest.approx([number / 25 for number in numbers])
    assert [images[0].stem, images[-1].stem] == names and len(images) == len(numbers)


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.avi"])
def test_a_part_is_asked_for_by_times_of_the_record(name, tmp_path):
    """At 29.97 Hz neither 6 digits nor Matroska's milliseconds are a frame's own time."""
    rate_hz = Fraction(30000, 1001)
    shown = [picture(number % 8) for number in range(45)]
    options = {"codec": "mjpeg", "pixel_format": "yuvj420p"} if name == "a.avi" else {}
    video = make_video(tmp_path / name, shown, rate_hz=rate_hz, **options)
    _, record = extracted(video)
    for number in (34, 40):
        time_s = record.times_s[number]
        for config, end in (({"from_s": time_s}, 0), ({"to_s": time_s}, -1)):
            part = extract_video(video, tmp_path / f"{number}{end}", VideoConfig(**config))
            part_record = video_record(part)
            assert part_record is not None and part_record.numbers[end] == number


@pytest.mark.parametrize(
    ("of_frame", "every", "said"),
    [
        (lambda n: n, 1, ""),
        (
            lambda n: n // 4,
            1,
            "30 of 40 frames repeat the one before: it was made faster than filmed; --every 4, or a"
            " folder of one in 4, leaves them out",
        ),
        (lambda n: n // 4, 2, "10 of 20 frames repeat the one before: .*; --every 4"),
        (lambda n: n - n // 5, 1, "7 of 40 frames repeat the one before"),
        (lambda n: min(n, 20), 1, ""),
        (lambda n: min(n, 32), 1, ""),
        (lambda n: n if n < 10 else max(10, n - 15), 1, ""),  # who stands still goes on as before
        (lambda n: n if n < 10 else max(10, n - 8), 1, ""),
        (lambda n: n if n < 10 or n > 25 else 10, 1, "frames 10 to 25 show one picture, and"),
        (lambda n: n if n < 6 or n > 34 else 6, 2, "frames 6 to 34 show one picture, and .* hung"),
    ],
)
def test_frames_that_repeat_are_said(of_frame, every, said, tmp_path, capsys):
    """As converters make 120 of 30 frames a second, or 30 of 24; a picture may stand still, too."""
    path = make_video(tmp_path / "clip.mp4", [textured(of_frame(n)) for n in range(40)])
    extracted(path, every=every)
    answer = " ".join(capsys.readouterr().err.split())
    assert re.search(said, answer) and bool(said) == ("repeat" in answer or "hung" in answer)


@pytest.mark.parametrize(("to_s", "n_frames"), [(0.12, None), (9.0, 8), (None, 8)])
def test_frames_of_a_part_are_a_part_in_their_folder_too(tmp_path, to_s, n_frames):
    """There they were taken for the whole video, and poses of the whole one were refused."""
    video = make_video(tmp_path / "a.mp4")
    frames = as_frames(video, tmp_path / "frames", VideoConfig(to_s=to_s))
    assert frames.n_frames == n_frames == as_frames(frames.folder, tmp_path).n_frames


def test_a_part_of_nothing_is_refused(tmp_path):
    with pytest.raises(BadFrames, match="0 frames could be read.*the video has 8, up to 0.28 s"):
        extracted(make_video(tmp_path / "a.mp4"), from_s=3)
    with pytest.raises(BadFrames, match=r"the video has 3, up to 0\.08 s, and more behind\. Give"):
        extracted(make_video(tmp_path / "b.mp4"), from_s=0.08, to_s=0.09)
    with pytest.raises(ValueError, match="no frames: to 1 s is not after from 2 s"):
        VideoConfig(from_s=2, to_s=1)


def test_a_folder_is_taken_whole(tmp_path):
    for number in range(2):
        write_gray(tmp_path / f"{number}.png", np.zeros((4, 6), np.uint8))
    frames = as_frames(tmp_path, tmp_path / "frames", VideoConfig())
    assert (frames.folder, frames.video_path, frames.size_px) == (tmp_path, None, (6, 4))
    with pytest.raises(BadRecipe, match="--every.*for a video"):
        as_frames(tmp_path, tmp_path / "frames", VideoConfig(every=2))


def long_video(path: Path, **options: str) -> Path:
    """48 frames with a key frame every 12."""
    images = [textured(i) for i in range(48)]
    return make_video(path, images, options={"g": "12", "crf": "10"} | options)


def test_a_hole_in_the_middle_is_counted(tmp_path):
    """OpenCV's reader stopped there without a word."""
    video = long_video(tmp_path / "a.mp4", bf="2")
    with_hole(video, video.stat().st_size // 3, 3000)
    with pytest.raises(BadFrames, match=r"48 frames by .* but (\d+) can be.*--take-what-decodes"):
        extracted(video)
    images, record = extracted(video, take_what_decodes=True)
    assert record.n_expected == 48 and 20 < record.n_decoded == len(images) < 48
    assert record.times_s[-1] == pytest.approx(47 / 25)
    assert max(np.diff(record.times_s)) > 0.1 and min(np.diff(record.times_s)) > 0.03
    _, before = extracted(long_video(tmp_path / "b.mp4", bf="2"), to_s=0.3)
    assert before.n_lost == 0


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4"])
def test_a_file_that_was_cut_off(tmp_path, name):
    """Matroska has no count of frames but says how long it is."""
    images = [textured(i) for i in range(48)]
    faststart = {"movflags": "faststart"} if name == "a.mp4" else {}
    video = make_video(tmp_path / name, images, options={"g": "12", "crf": "10"}, muxer=faststart)
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(BadFrames, match="48 frames by the file's own count, but 2[0-9] can be"):
        extracted(video)
    _, record = extracted(video, take_what_decodes=True)
    assert record.n_expected == 48 and record.n_lost == 48 - record.n_decoded


@pytest.mark.parametrize("codecs", [("a.mkv", "libx264", "aac"), ("a.webm", "libvpx", "libopus")])
def test_a_file_with_sound_that_was_cut_off(tmp_path, codecs):
    """Sound may last longer than the pictures, but then it is there."""
    name, *_ = codecs
    video = with_sound(tmp_path / name, codecs[1:], sound_s=4.0)
    assert len(extracted(video)[0]) == 48
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    shutil.rmtree(video.with_suffix(""))
    with pytest.raises(BadFrames, match=r"\d\d frames by the file's own count, but [23]\d can be"):
        extracted(video)


def with_sound(path: Path, codecs: Sequence[str], sound_s: float) -> Path:
    """48 frames at 25 Hz and silence, one beside the other."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codecs[0], rate=25, options={"g": "12"})
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        sound: Any = container.add_stream(codecs[1], rate=48000)
        for start in range(0, round(sound_s * 48000), 960):  # half a frame's time
            if start % 1920 == 0 and start < 48 * 1920:
                image = av.VideoFrame.from_ndarray(textured(start // 1920), format="rgb24")
                container.mux(stream.encode(image))
            silence = av.AudioFrame.from_ndarray(np.zeros((1, 960), np.float32), "fltp", "mono")
            silence.sample_rate, silence.pts, silence.time_base = 48000, start, Fraction(1, 48000)
            container.mux(sound.encode(silence))
        container.mux(stream.encode())
        container.mux(sound.encode())
    return path


@pytest.mark.parametrize("n_b_frames", ["0", "2"])
def test_a_trimmed_file_is_whole(tmp_path, n_b_frames):
    """Its head counts the frames, too, of which its edit list needs none."""
    whole = long_video(tmp_path / "whole.mp4", bf=n_b_frames)
    extracted(whole)
    with av.open(str(whole)) as container:
        ticks = round(1 / 25 / container.streams.video[0].time_base)

    def earlier(_: int, packet: Any) -> bool:
        """An edit list then trims what comes before 0: `ffmpeg -ss ... -c copy`."""
        packet.pts, packet.dts = packet.pts - 17 * ticks, packet.dts - 17 * ticks
        return True

    trim = remuxed(whole, tmp_path / "trimmed.mp4", earlier)
    assert counted(trim, VideoConfig()) == (31, (160, 120))
    images, record = extracted(trim)
    assert (len(images), record.n_expected, record.n_lost) == (31, 31, 0)
    first, same = (cv2.imread(str(whole.with_suffix("") / f"{n:05d}.jpg")) for n in (17, 18))
    seen = cv2.imread(str(images[0])).astype(int)
    assert np.abs(seen - first).mean() < 0.25 * np.abs(seen - same).mean()


@pytest.mark.parametrize("codec", ["mpeg4", "mjpeg"])
def test_dropped_frames_of_an_avi_are_not_lost(codec, tmp_path):
    """Empty chunks stand for them, and are counted in its head; what was cut off is still lost."""
    ticks, images = [0, 1, 2, 5, 6, 9, 10, 11, 12, 20, 21, 22], [textured(i) for i in range(12)]
    pixels = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    video = make_video(tmp_path / "a.avi", images, codec, pixels, ticks=ticks)
    _, record = extracted(video)
    assert (record.n_expected, record.n_decoded) == (12, 12)
    assert record.times_s == pytest.approx([tick / 25 for tick in ticks])
    content = video.read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(content[: content.rindex(b"00dc", 0, content.index(b"idx1"))])
    with pytest.raises(BadFrames, match="frames by the file's own count, but 11 can be"):
        extracted(cut)


def test_a_transport_stream_with_lost_packets(tmp_path):
    video = long_video(tmp_path / "a.ts")
    content = video.read_bytes()
    at = len(content) // 188 // 3 * 188
    video.write_bytes(content[:at] + content[at + 50 * 188 :])
    with pytest.raises(BadFrames, match="can be decoded"):
        extracted(video)


@pytest.mark.parametrize("n_frames", [0, 1])
def test_fewer_than_two_frames_are_refused_and_leave_no_folder(tmp_path, n_frames):
    video = make_video(tmp_path / "a.mkv", [picture(i) for i in range(max(1, n_frames))])
    config = VideoConfig(from_s=0.0 if n_frames else 9.0)
    with pytest.raises(BadFrames, match=f"{n_frames} frames could be read"):
        extract_video(video, tmp_path / "frames", config)
    assert not (tmp_path / "frames").exists()


def test_what_is_no_video_is_named_with_what_to_do(tmp_path):
    with pytest.raises(MissingInput, match=r"no\.mp4"):
        extract_video(tmp_path / "no.mp4", tmp_path / "frames")
    playlist = f"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n{make_video(tmp_path / 'b.ts')}\n"
    whole = make_video(tmp_path / "whole.mp4").read_bytes()
    at_index, at_data = whole.index(b"moov") - 4, whole.index(b"mdat") - 4
    still_open = whole[:at_data] + bytes(4) + whole[at_data + 4 : at_index]
    contents = {
        "empty.mp4": (b"", "empty file"),
        "text.mp4": (b"not a video at all", "no video"),
        "playlist.mp4": (playlist.encode(), "no video"),
        "concat.mp4": (f"ffconcat version 1.0\nfile {tmp_path}/b.ts\n".encode(), "no video"),
        "image.png": (cv2.imencode(".png", picture(0))[1].tobytes(), "no video"),
        "head.mp4": (whole[:900], "was cut off before"),
        "half.mp4": (whole[: at_index - 99], "was cut off before its index (moov); get the whole"),
        "open.mp4": (still_open, "was cut off before its index (moov); get the whole"),
        "crashed.mp4": (whole[:at_index] + bytes(99), "no video (without an index, moov"),
        "index.mp4": (whole[: at_index + 200], "no video (cut off in its index, moov); get the"),
        "zeros.mp4": (bytes(9999), "begins with zeros"),
        "page.mp4": (b"\n<!DOCTYPE html><html>", "a web page"),
        "pointer.mp4": (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer"),
        "bare.h264": (b"\0\0\0\1\x67" + bytes(99), "a bare stream, which has no times; put it"),
    }
    for name, (content, said) in contents.items():
        (tmp_path / name).write_bytes(content)
        for read in (extracted, partial(counted, config=VideoConfig())):
            with pytest.raises(BadFrames, match=re.escape(f"{name}: {said}")):
                read(tmp_path / name)


def test_a_recording_that_says_no_length_is_counted(tmp_path):
    """As browsers write them."""
    video = make_video(tmp_path / "a.webm", codec="libvpx", muxer={"live": "1"})
    assert counted(video, VideoConfig()) == (8, (64, 48))
    part = VideoConfig(to_s=0.16, every=2)
    assert counted(video, part)[0] == len(_images(video, part)) == 3
    assert extracted(video)[1].rate_hz == 25


def counted(video: Path, config: VideoConfig) -> tuple[int, tuple[int, int]]:
    """How many images are expected, and their (width, height)."""
    frames = expected_frames(video, config)
    return len(frames.numbers), frames.size_px


def _images(video: Path, part: VideoConfig) -> list[Path]:
    """The images of a part of a video, in a folder that no other part has."""
    return sorted(
        extract_video(video, Path(tempfile.mkdtemp(dir=video.parent)) / "part", part).glob("*.jpg")
    )


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_variable_rate_is_counted_by_its_frames(suffix, tmp_path):
    """One second at 25 Hz, two at 5 Hz; a Matroska file had the first's rate for its length."""
    ticks = [*range(25), *range(25, 75, 5)]
    images = [picture(row) for row in range(len(ticks))]
    video = make_video(tmp_path / f"a{suffix}", images, ticks=ticks, options={"bf": "0"})
    later = VideoConfig(from_s=0.4, every=3)
    for part in (VideoConfig(), VideoConfig(from_s=0.8), VideoConfig(to_s=1.2), later):
        expected, out = expected_frames(video, part), Path(tempfile.mkdtemp(dir=tmp_path)) / "part"
        taken = as_frames(video, out, part)
        assert expected.frame_numbers.tolist() == taken.frame_numbers.tolist()
        assert expected.numbers.tolist() == taken.numbers.tolist()
        assert (expected.n_frames, expected.rate_hz) == (taken.n_frames, taken.rate_hz)
    said = r"0 frames could be read, but a motion needs at least 2; the video has 35, up to 2\.8 s"
    for read in (_images, expected_frames):
        with pytest.raises(BadFrames, match=said):
            read(video, VideoConfig(from_s=2.9))


def test_images_are_planned_as_they_will_stand(tmp_path):
    image = np.zeros((48, 64, 3), np.uint8)
    turned_mp4 = make_video(tmp_path / "turned.mp4", [image] * 3, rotation_deg=90)
    wide = make_video(tmp_path / "wide.mkv", [image] * 3, pixel_aspect=Fraction(4, 3))
    for video, size_px in ((turned_mp4, (48, 64)), (wide, (85, 48))):
        assert counted(video, VideoConfig()) == (3, size_px)
        assert extracted(video)[1].size_px == size_px


@pytest.mark.parametrize("place", ["mkv_frame_rate/obs60.mkv", "mkv_frame_rate/base.mkv"])
def test_milliseconds_of_a_real_recorder(shared_path, tmp_path, place):
    rate_hz = 60.0 if "60" in place else 30.0
    frames = as_frames(shared_path(f"odd/{place}"), tmp_path / "frames", VideoConfig(every=2))
    assert (frames.rate_hz, frames.video_hz) == (rate_hz / 2, rate_hz)
    assert frames.times_s[-1] == pytest.approx(88 / rate_hz, abs=1e-6)


def test_a_file_of_sound_has_no_video(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=16000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        sound.sample_rate = 16000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(BadFrames, match="has no video stream"):
        extracted(tmp_path / "a.mp4")


def test_a_wrong_suffix_does_not_matter(tmp_path):
    video = make_video(tmp_path / "a.mkv").rename(tmp_path / "a.jpeg.mp4")
    assert len(extracted(video)[0]) == 8


def test_absurd_rates_and_sizes(tmp_path, monkeypatch):
    fast = make_video(tmp_path / "fast.mp4", rate_hz=9000)
    with pytest.raises(BadFrames, match=r"90\d\d(\.\d+)? frames per second"):
        extracted(fast)
    slow = make_video(tmp_path / "slow.mp4", rate_hz=1, ticks=[90 * i for i in range(8)])
    with pytest.raises(BadFrames, match=r"0\.0111\d* frames per second"):
        extracted(slow)
    plain = make_video(tmp_path / "plain.mp4")
    for name, most, said in (
        ("MOST_PIXELS", 1000, "64x48 px, more than 1000"),
        ("MOST_VIDEO_FRAMES", 4, "more than 4 frames of 64x48 px.*--every"),
        ("MOST_VIDEO_PIXELS", 10_000, "more than 3 frames"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(video_module, name, most)
            with pytest.raises(BadFrames, match=said):
                extracted(plain)


def test_a_header_that_lies_about_the_size(tmp_path):
    """The pictures' own size counts, not the container's."""
    video = make_video(tmp_path / "a.mp4")
    entry = video.read_bytes().index(b"avc1", video.read_bytes().index(b"stsd"))
    content = bytearray(video.read_bytes())
    content[entry + 28 : entry + 32] = (7680).to_bytes(2, "big") + (4320).to_bytes(2, "big")
    track = content.index(b"tkhd")
    end = track - 4 + int.from_bytes(content[track - 4 : track], "big")
    content[end - 8 : end] = (7680 << 16).to_bytes(4, "big") + (4320 << 16).to_bytes(4, "big")
    video.write_bytes(content)
    images, record = extracted(video)
    assert record.size_px == (64, 48) and len(images) == 8


def test_the_record_needs_each_key(tmp_path):
    _, record = extracted(make_video(tmp_path / "a.mp4"))
    assert_each_key_is_needed(record, tmp_path / VIDEO_FILE)


def test_a_real_video(shared_path, tmp_path):
    config = VideoConfig(from_s=1.0, to_s=1.2)
    frames = extract_video(shared_path("video/dog.mp4"), tmp_path / "frames", config)
    images = sorted(frames.glob("*.jpg"))
    assert [p.stem for p in images] == [f"{i:05d}" for i in range(30, 36)]
    capture = cv2.VideoCapture(str(shared_path("video/dog.mp4")))
    pictures = [capture.read()[1] for _ in range(36)]
    _, encoded = cv2.imencode(".jpg", pictures[35], [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert images[-1].read_bytes() == encoded.tobytes()
