"""A video file as a folder of numbered frames, upright and with the time of each.

PyAV decodes, and OpenCV writes the JPEGs.  A frame is as a person sees it in a player: turned and
mirrored as the file says, without lines of two times, and as wide as its pixels make it.
"""

from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, model_validator

from gmrdata.read.frames import read_frames, write_image
from gmrdata.read.video_faults import change, say_repeats, thinned, why_no_video
from gmrdata.read.video_rate import rated
from gmrdata.stage.jobs import made_ahead
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames, BadRecipe
from gmrdata.values.files import require_file
from gmrdata.values.frame_set import VIDEO_FILE, FrameSet, VideoRecord
from gmrdata.values.limits import (
    HIGHEST_FPS_HZ,
    LOWEST_FPS_HZ,
    MOST_PIXELS,
    MOST_VIDEO_FRAMES,
    MOST_VIDEO_PIXELS,
)
from gmrdata.values.records import Config

if TYPE_CHECKING:
    import av
    from av.container import InputContainer
    from av.filter import Graph

CONTAINERS = (
    "mov,mp4,3gp,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,asf,mxf,ogg,dv,ivf,gif,yuv4mpegpipe"
)
"""FFmpeg's names of formats that are read: none of them is a list of other files."""
BROADCAST = ("mpegts", "mpeg", "mpegvideo")  # a recording of it begins anywhere
REMEDY = "convert it again (H.264 in .mp4)"
LONGEST_PIXEL = 4.0  # the most that a pixel may be longer than wide, or wider than long
MOST_REORDERED = 16  # frames that a decoder may hold back, as H.264 and HEVC have it
FINEST_S = 1e-5  # times are not compared more finely [s]
FEWEST_LOST_S = 0.5  # a file without a count of frames may say so much more than they last [s]


class VideoConfig(Config):
    """Which frames are taken, and how they are written."""

    jpeg_quality: int = Field(default=95, ge=1, le=100)
    from_s: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    """Frames before this time are left out, counted from the first frame's [s]."""
    to_s: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Frames after this time are left out; None for none [s]."""
    every: int = Field(default=1, ge=1)
    """Frames are taken whose number in the video is a multiple of this."""
    take_what_decodes: bool = False
    """Go on where frames are lost or damaged; the record says how many, and a verdict sees it."""

    @model_validator(mode="after")
    def _ordered(self) -> "VideoConfig":
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"no frames: to {self.to_s:g} s is not after from {self.from_s:g} s")
        return self


def is_video(path: Path) -> bool:
    """Whether a path is a file, whatever its suffix: what it is, its content says."""
    return path.is_file()


def has_times(source: Path) -> bool:
    """Whether images say when they were taken: those of a video file, or of a folder that
    `extract_video` made."""
    return is_video(source) or (source / VIDEO_FILE).is_file()


def expected_frames(path: Path, config: VideoConfig) -> FrameSet:
    """About which frames `extract_video` would take, without times, and paths but for the first: by
    the times in the file's index or of its packets, and its first picture.  Errors as there."""
    import av

    require_file(path)
    with _explained(path), opened(path) as container:
        stream, reading = _video_stream(path, container), _Reading()
        shown_s, within_s = _shown_s(container, stream), _same_time_s(stream)
        size_px = stream.codec_context.width, stream.codec_context.height
        with suppress(av.FFmpegError, StopIteration):
            container.seek(0)
            _, image = next(_pictures(path, container, stream, VideoConfig(), reading))
            size_px = image.shape[1], image.shape[0]
        shown_s = shown_s[reading.n_cut :] - shown_s[reading.n_cut : reading.n_cut + 1]
        to_s = (np.inf if config.to_s is None else config.to_s) + within_s
        taken = np.flatnonzero((shown_s >= config.from_s - within_s) & (shown_s <= to_s))
        numbers = (taken := taken[taken % config.every == 0]) // config.every
        _require_in_budget(path, len(taken), size_px)
        seen = _Reading(times_s=shown_s.tolist())
        _require_several(path, len(taken), seen)
        rate_hz, _ = _rated(path, stream, seen)
        return FrameSet(
            folder=path,
            paths=(_image_path(numbers[0]),),
            numbers=numbers,
            size_px=size_px,
            frame_numbers=taken,
            n_frames=None if (shown_s > to_s).any() else len(shown_s),
            times_s=np.full(len(taken), np.nan),
            rate_hz=rate_hz / config.every,
            video_path=path,
        )


def _image_path(number: int) -> Path:
    return Path(f"{number:05d}.jpg")


def _shown_s(container: "InputContainer", stream: Any) -> np.ndarray:
    """(T,) rising: when each frame is shown, from the first one on [s]; nothing is decoded."""
    entries = getattr(stream, "index_entries", None) or ()
    if container.format.name.startswith("mov") and entries:
        # When they are decoded, which for so many is as far apart.
        ticks = [entry.timestamp for entry in entries if entry.size and not entry.is_discard]
        shown_s = np.sort(ticks) * float(stream.time_base)
    else:
        at_s = np.array([_packet_time_s(one) for one in container.demux(stream) if one.size], float)
        rows, known = np.arange(len(at_s)), np.flatnonzero(np.isfinite(at_s))
        shown_s = rows / float(stream.average_rate or stream.guessed_rate or 1)
        if len(known):
            shown_s = np.interp(rows, known, np.sort(at_s[known]))
    return np.unique(shown_s - shown_s[:1])


def as_frames(
    source: Path,
    out_dir: Path,
    config: VideoConfig | None = None,
    *,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> FrameSet:
    """The frames in a folder, or those of a video, for which `extract_video` makes `out_dir`.

    Raises:
        BadRecipe: frames of a folder are to be trimmed.
    """
    if is_video(source):
        folder = extract_video(source, out_dir, config, run=run)
        return replace(read_frames(folder, left_out), video_path=source)
    if config not in (None, VideoConfig()):
        what = "--from, --to, --every and --take-what-decodes are for a video file"
        raise BadRecipe(f"{source}: {what}; give the video, or a folder of those frames alone")
    return read_frames(source, left_out)


def extract_video(
    path: Path, out_dir: Path, config: VideoConfig | None = None, *, run: Run = DEFAULT_RUN
) -> Path:
    """Stage: write a video's frames as `00000.jpg`, ..., and `video.json`.

    An image's number is the frame's in the video; where only every n-th is taken, it is divided
    by n.

    Raises:
        MissingInput: there is no such file.
        BadFrames: no video, or one with frames that are lost, damaged, too many or too large, of
            more than one size, or at impossible times.
    """
    require_file(path)
    config = config or VideoConfig()

    def work(partial_dir: Path) -> None:
        with _explained(path):
            record = _extract(path, partial_dir, config)
        record.write(partial_dir / VIDEO_FILE)

    return run_stage("frames", out_dir, config, {"video": path}, work, run=run)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """What the decoder says of a file, as BadFrames."""
    import av

    try:
        yield
    except av.FFmpegError as error:
        said = f"no video ({error.strerror or type(error).__name__}); {REMEDY}"
        raise BadFrames(f"{path}: {why_no_video(path) or said}") from None


@dataclass(eq=False)
class _Reading:
    """What was met while a video was decoded."""

    packet_times_s: list[float | None] = field(default_factory=list)
    key_time_s: float | None = None  # of the first picture that needs no other
    cut_times_s: list[float] = field(default_factory=list)  # of pictures cut from what they need
    last_packet_s: float | None = None
    is_reordered: bool = False  # a packet is shown before one that stands before it
    n_discarded: int = 0  # frames that an edit list leaves out
    times_s: list[float] = field(default_factory=list)  # of all frames, from the first on
    n_deinterlaced: int = 0
    is_turned: bool = False
    first_time_s: float | None = None
    stopped_at_s: float | None = None  # from the first frame on; None if read to the end
    others_end_s: float = 0.0  # of sound and what else there is beside the pictures

    def note_other(self, packet: Any) -> None:
        if (start_s := _packet_time_s(packet)) is not None:
            end_s = start_s + float((packet.duration or 0) * packet.time_base)
            self.others_end_s = max(self.others_end_s, end_s)

    def note_time(self, packet_s: float) -> None:
        self.is_reordered |= self.last_packet_s is not None and packet_s < self.last_packet_s
        self.last_packet_s = packet_s

    @property
    def n_frames(self) -> int:
        return len(self.times_s)

    @property
    def n_cut(self) -> int:
        first_s = self.first_time_s or 0.0
        return sum(time_s < first_s - 1e-6 for time_s in self.cut_times_s)

    @property
    def last_time_s(self) -> float:
        return self.times_s[-1] if self.times_s else -1.0


def opened(path: Path) -> "InputContainer":
    """A video's container, that opens no other file; errors as PyAV has them."""
    import av

    # `file:` and the lists keep a file from having others opened.
    only = {"protocol_whitelist": "file", "format_whitelist": CONTAINERS}
    where = f"file:{path.absolute()}"
    # From PyAV 19 on, no text in a file's head is an error.
    lenient: dict[str, Any] = (
        {"metadata_errors": "ignore"} if int(av.__version__.split(".")[0]) < 19 else {}
    )
    return av.open(where, container_options=only, **lenient)


def _extract(path: Path, out_dir: Path, config: VideoConfig) -> VideoRecord:
    import cv2

    with opened(path) as container:
        stream = _video_stream(path, container)
        reading = _Reading()
        numbers: list[int] = []
        size_px, small, changes = (0, 0), None, list[float]()

        def write(picture: tuple[int, np.ndarray]) -> tuple[int, np.ndarray]:
            number, image = picture
            quality = [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]
            write_image(out_dir / _image_path(number // config.every), image, quality)
            return picture

        decoded = _pictures(path, container, stream, config, reading)
        for number, image in made_ahead(write, decoded):
            if numbers and size_px != image.shape[1::-1]:
                sizes = "{}x{} px, the frames before it {}x{} px".format(
                    *image.shape[1::-1], *size_px
                )
                raise BadFrames(f"{path}: frame {number} is {sizes}; cut the video there")
            size_px = (image.shape[1], image.shape[0])
            _require_in_budget(path, len(numbers) + 1, size_px)
            numbers.append(number)
            before, small = small, thinned(image)
            changes += [] if before is None else [change(before, small)]
        n_expected = _count_expected(container, stream, reading)
        _require_whole(path, n_expected, reading, config)
        _require_several(path, len(numbers), reading)
        rate_hz, times_s = _rated(path, stream, reading)
        say_repeats(path, np.array(changes), numbers)
        return VideoRecord(
            container=container.format.name,
            codec=stream.codec_context.name,
            pixel_format=str(stream.codec_context.pix_fmt),
            stored_size_px=(stream.codec_context.width, stream.codec_context.height),
            size_px=size_px,
            is_turned=reading.is_turned,
            n_deinterlaced=reading.n_deinterlaced,
            n_expected=n_expected,
            n_decoded=reading.n_frames,
            is_part=reading.stopped_at_s is not None,
            every=config.every,
            rate_hz=rate_hz / config.every,
            numbers=tuple(numbers),
            times_s=tuple(times_s[numbers].round(6).tolist()),
        )


def _video_stream(path: Path, container: "InputContainer") -> Any:
    from av.stream import Disposition

    moving = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
    if not moving:
        said = "has no video stream; give a file with a picture"
        raise BadFrames(f"{path}: {why_no_video(path) or said}")
    best = container.streams.best("video")
    stream = best if best in moving else moving[0]
    if stream.codec_context is None:
        raise BadFrames(f"{path}: its codec is not known; {REMEDY}")
    _require_in_budget(path, 1, (stream.codec_context.width, stream.codec_context.height))
    # A damaged frame is an error, not a guess at what it would have shown.
    stream.codec_context.options = {"err_detect": "explode"}
    return stream


def _pictures(
    path: Path, container: "InputContainer", stream: Any, config: VideoConfig, reading: _Reading
) -> Iterator[tuple[int, np.ndarray]]:
    """Number and picture (H, W, 3) BGR of each frame that is asked for."""
    stretch, within_s = _pixel_aspect(stream), _same_time_s(stream)
    timed = _timed(_decoded(container, stream, reading), stream)
    in_order = _in_order(timed, reading)
    for frame in _progressive(in_order, reading):
        number, time_s = reading.n_frames, _time_s(path, frame, stream, reading)
        if time_s <= reading.last_time_s:
            if config.take_what_decodes:
                continue
            what = f"frame {number} is shown at {time_s:g} s, after one at {reading.last_time_s:g}"
            raise BadFrames(f"{path}: {what} s; {REMEDY}")
        if config.to_s is not None and time_s > config.to_s + within_s:
            reading.stopped_at_s = time_s
            return
        reading.times_s.append(time_s)
        if time_s >= config.from_s - within_s and number % config.every == 0:
            _require_in_budget(path, 1, (frame.width, frame.height))
            yield number, _upright(path, frame, stretch, reading)


def _decoded(
    container: "InputContainer", stream: Any, reading: _Reading
) -> Iterator["av.VideoFrame"]:
    """The frames that decode, in the order in which they are shown."""
    import av

    # Of all streams, since sound may last longer than the pictures.
    packets: Iterator[Any] = container.demux()
    begins_anywhere = container.format.name in BROADCAST
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.FFmpegError):
            return  # what is cut off is missed in the count
        if packet.stream_index != stream.index:
            reading.note_other(packet)
            continue
        if packet.size:
            reading.n_discarded += packet.is_discard
            if not packet.is_discard:
                time_s = _packet_time_s(packet)
                reading.packet_times_s.append(time_s)
                if time_s is not None:
                    reading.note_time(time_s)
                    _look_for_cut(time_s, packet.is_keyframe, begins_anywhere, reading)
        try:
            frames = packet.decode()
        except av.FFmpegError:
            continue
        yield from (frame for frame in frames if not frame.is_corrupt)


def _packet_time_s(packet: Any) -> float | None:
    known = packet.pts is not None and packet.time_base is not None
    return float(packet.pts * packet.time_base) if known else None


def _look_for_cut(time_s: float, is_key: bool, begins_anywhere: bool, reading: _Reading) -> None:
    """Note a picture that no player shows, since a cut took away what it needs.

    It is shown before the first key frame but stands behind it (an open group of pictures), or
    before it in what was broadcast.
    """
    if reading.key_time_s is None and is_key:
        reading.key_time_s = time_s
    elif begins_anywhere if reading.key_time_s is None else time_s < reading.key_time_s:
        reading.cut_times_s.append(time_s)


def _timed(frames: Iterator["av.VideoFrame"], stream: Any) -> Iterator["av.VideoFrame"]:
    """The frames, each with a time if any has one: MPEG-PS gives it only to some."""
    rate_hz = stream.average_rate or stream.guessed_rate
    last: int | None = None
    untimed: list[av.VideoFrame] = []  # before the first with a time
    for frame in frames:
        step = round(1 / (rate_hz * frame.time_base)) if rate_hz and frame.time_base else 0
        if frame.pts is None and last is not None and step:
            frame.pts = last + step
        if frame.pts is None and last is None and len(untimed) < MOST_REORDERED:
            untimed.append(frame)
            continue
        if frame.pts is not None and step:
            for before, one in enumerate(reversed(untimed), start=1):
                one.pts = frame.pts - before * step
        last = last if frame.pts is None else frame.pts
        yield from untimed
        untimed = []
        yield frame
    yield from untimed


def _in_order(frames: Iterator["av.VideoFrame"], reading: _Reading) -> Iterator["av.VideoFrame"]:
    """The frames by time: behind a damaged one decoders give some too early.

    While no packet's time falls, the file has no times of showing (AVI, ASF, what recorders write),
    only those of decoding.  Decoders then give the pictures in order, but not the times.
    """
    held: list[av.VideoFrame] = []

    def earliest() -> "av.VideoFrame":
        place = min(range(len(held)), key=lambda i: held[i].pts or 0)
        if not reading.is_reordered:
            held[0].pts, held[place].pts = held[place].pts, held[0].pts
            place = 0
        return held.pop(place)

    for frame in frames:
        if frame.pts is None:
            yield frame
            continue
        held.append(frame)
        if len(held) > MOST_REORDERED:
            yield earliest()
    while held:
        yield earliest()


def _progressive(frames: Iterator["av.VideoFrame"], reading: _Reading) -> Iterator["av.VideoFrame"]:
    """The frames; from the first interlaced one on they go through a filter (bwdif)."""
    graph: Graph | None = None
    for frame in frames:
        reading.n_deinterlaced += frame.interlaced_frame
        if graph is None and frame.interlaced_frame:
            graph = _deinterlacer(frame)
        if graph is None:
            yield frame
            continue
        graph.push(frame)
        yield from _pulled(graph)
    if graph is not None:
        graph.push(None)
        yield from _pulled(graph)


def _deinterlacer(frame: "av.VideoFrame") -> "Graph":
    import av.filter

    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    filters = (
        source,
        graph.add("bwdif", "mode=send_frame:deint=interlaced"),
        graph.add("buffersink"),
    )
    graph.link_nodes(*filters).configure()
    return graph


def _pulled(graph: "Graph") -> Iterator["av.VideoFrame"]:
    import av

    while True:
        try:
            yield graph.vpull()
        except (BlockingIOError, av.EOFError):
            return


def _same_time_s(stream: Any) -> float:
    """How far a frame may be from a time that `video.json` says, which is without the container's
    rounding and has 6 digits [s]."""
    rate_hz = float(stream.average_rate or stream.guessed_rate or 0)
    # AVI counts in whole frames.
    most_s = 0.25 / rate_hz if rate_hz else FINEST_S
    return min(max(float(stream.time_base or 0), FINEST_S), most_s)


def _time_s(path: Path, frame: "av.VideoFrame", stream: Any, reading: _Reading) -> float:
    """A frame's time since the first [s]; of a file without times from its rate."""
    if frame.pts is None or frame.time_base is None:
        rate_hz = float(stream.average_rate or stream.guessed_rate or 0)
        if not rate_hz:
            raise BadFrames(f"{path}: has neither times nor a rate of its frames; {REMEDY}")
        shown_s = reading.n_frames / rate_hz
    else:
        shown_s = float(frame.pts * frame.time_base)
    if reading.first_time_s is None:
        reading.first_time_s = shown_s
    return shown_s - reading.first_time_s


def _pixel_aspect(stream: Any) -> float:
    """How much wider than long a pixel is; 1 where the file does not say, or says nonsense."""
    aspect = float(stream.sample_aspect_ratio or 1)
    return aspect if 1 / LONGEST_PIXEL <= aspect <= LONGEST_PIXEL else 1.0


def _upright(path: Path, frame: "av.VideoFrame", stretch: float, reading: _Reading) -> np.ndarray:
    """(H, W, 3) BGR as it is shown."""
    import cv2

    # The matrix of BT.601 for all, as OpenCV 4's own reader has it, which this one replaced.
    image: np.ndarray = frame.to_ndarray(
        format="bgr24", interpolation="BICUBIC", src_colorspace="ITU601", dst_colorspace="ITU601"
    )
    width = max(1, round(image.shape[1] * stretch))
    if width != image.shape[1]:
        image = np.asarray(cv2.resize(image, (width, image.shape[0])))
    matrix = _display_matrix(frame)
    if matrix is None or np.array_equal(matrix, [[1, 0], [0, 1]]):
        return image
    if sorted(np.abs(matrix).ravel().tolist()) != [0, 0, 1, 1] or not matrix.any(axis=0).all():
        raise BadFrames(f"{path}: is to be shown at an angle that is no quarter turn; {REMEDY}")
    reading.is_turned = True
    return turned(image, matrix)


def turned(image: np.ndarray, shown_from_stored: np.ndarray) -> np.ndarray:
    """An image by quarter turns and mirrors: (2, 2) of 0, 1 and -1 maps (x, y), y down."""
    if shown_from_stored[0, 0] == 0:
        image = image.swapaxes(0, 1)
    backward_x, backward_y = shown_from_stored.sum(axis=1) < 0
    return np.ascontiguousarray(image[:: -1 if backward_y else 1, :: -1 if backward_x else 1])


def _display_matrix(frame: "av.VideoFrame") -> np.ndarray | None:
    """(2, 2) shown_from_stored, rounded to units, of ISO 14496-12's matrix (a b u c d v x y w)."""
    from av.sidedata.sidedata import Type

    sides: Any = frame.side_data  # what iterating over it gives differs between releases
    side = sides.get(Type.DISPLAYMATRIX)
    if side is None:
        return None
    a, b, _, c, d = np.frombuffer(bytes(side), dtype=np.int32)[:5] / 65536.0
    given = np.array([[a, c], [b, d]])
    unit = given / max(np.abs(given).max(), 1e-9)
    near = np.abs(unit - unit.round()).max() < 0.01
    return unit.round().astype(int) if near else np.ones((2, 2), dtype=int)


def _require_in_budget(path: Path, n_frames: int, size_px: tuple[int, int]) -> None:
    """Refuse a video of more than a camera takes; of what is trimmed away nothing counts."""
    n_pixels = size_px[0] * size_px[1]
    if n_pixels > MOST_PIXELS:
        what = f"{size_px[0]}x{size_px[1]} px, more than {MOST_PIXELS} in all"
        raise BadFrames(f"{path}: {what}; make the video smaller")
    if n_frames > MOST_VIDEO_FRAMES or n_frames * n_pixels > MOST_VIDEO_PIXELS:
        what = f"more than {n_frames - 1} frames of {size_px[0]}x{size_px[1]} px"
        raise BadFrames(f"{path}: {what}; take a part of it (--from, --to, --every)")


def _count_expected(container: "InputContainer", stream: Any, reading: _Reading) -> int:
    """Frames that the file holds by its own count, as far as it was read."""
    times_s, first_s = reading.packet_times_s, reading.first_time_s or 0.0
    stopped_at_s = reading.stopped_at_s
    n_cut = reading.n_cut
    if stopped_at_s is not None:
        end_s = stopped_at_s + first_s - 1e-6
        before = sum(time_s is not None and time_s < end_s for time_s in times_s)
        return max(before - n_cut, reading.n_frames)
    n_counted = max(len(times_s), _stated_frames(container, stream, reading.n_discarded))
    expected = max(n_counted - n_cut, reading.n_frames)
    is_mixed = container.format.name in BROADCAST and len(container.streams) > 1
    if stream.frames or is_mixed or not container.duration:
        return int(expected)
    length_s = container.duration / 1e6
    if "matroska" in container.format.name:
        # Its length counts from 0, also where the first frame comes later.
        length_s -= max(0.0, first_s)
    elif n_cut:
        length_s -= first_s - min(reading.cut_times_s)
    return max(int(expected), _count_by_length(length_s, reading, first_s))


def _stated_frames(container: "InputContainer", stream: Any, n_discarded: int) -> int:
    """Frames that the file says it shows, without those that an edit list leaves out; 0 if it
    does not say.  `n_discarded` is as far as it was read, for a PyAV without the index."""
    entries = [entry for entry in getattr(stream, "index_entries", None) or () if entry.size]
    if entries and container.format.name.startswith("mov"):
        # The head counts all that are stored; the index has what its edit list needs.
        return sum(not entry.is_discard for entry in entries)
    if entries and container.format.name == "avi":
        # A dropped frame is an empty chunk: the head and the index's times count it.  The index of
        # a file that was cut off ends early, so it can't stand for the head.
        n_empty = entries[-1].timestamp + 1 - len(entries)
        return stream.frames - n_empty if 0 <= n_empty < stream.frames else stream.frames
    return int(stream.frames - n_discarded)


def _count_by_length(length_s: float, reading: _Reading, first_s: float) -> int:
    """The same of a format without a count: a file that was cut off still says how long it is."""
    rate_hz = (reading.n_frames - 1) / max(reading.last_time_s, 1e-9)
    lacking_s = length_s - max(reading.last_time_s, reading.others_end_s - first_s)
    n_lacking = round(lacking_s * rate_hz) - 1 if lacking_s > FEWEST_LOST_S else 0
    return reading.n_frames + max(0, n_lacking)


def _require_whole(path: Path, n_expected: int, reading: _Reading, config: VideoConfig) -> None:
    if n_expected > reading.n_frames and not config.take_what_decodes:
        what = f"{n_expected} frames by the file's own count, but {reading.n_frames} can be decoded"
        remedy = "get the whole file again, or use what there is (--take-what-decodes)"
        raise BadFrames(f"{path}: {what}; {remedy}")


def _require_several(path: Path, n_images: int, reading: _Reading) -> None:
    if n_images < 2:
        what = f"{n_images} frames could be read, but a motion needs at least 2"
        more = "" if reading.stopped_at_s is None else ", and more behind"
        if reading.n_frames > n_images or more:
            what += f"; the video has {reading.n_frames}, up to {reading.last_time_s:g} s{more}"
        raise BadFrames(f"{path}: {what}. Give a longer video, or other times of it")


def _rated(path: Path, stream: Any, reading: _Reading) -> tuple[float, np.ndarray]:
    """The frames' rate and times; BadFrames for a rate that no camera has."""
    said = (stream.average_rate, stream.base_rate, stream.guessed_rate)
    stated_hz = [float(rate) for rate in said if rate]
    rate_hz, times_s = rated(np.array(reading.times_s), float(stream.time_base or 0), stated_hz)
    if not LOWEST_FPS_HZ <= rate_hz <= HIGHEST_FPS_HZ:
        what = f"{rate_hz:g} frames per second, not {LOWEST_FPS_HZ:g} to {HIGHEST_FPS_HZ:g}"
        raise BadFrames(f"{path}: {what}; {REMEDY}")
    return rate_hz, times_s
