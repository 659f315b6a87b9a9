"""Image folders: which files are the frames, in which order, and whether they can be used.

An image is turned as its EXIF orientation says, everywhere: masks, cameras and pages see what a
person sees.
"""

import re
import struct
import warnings
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.values.errors import BadFrames, MissingInput
from gmrdata.values.files import require_text, visible, write_bytes
from gmrdata.values.frame_set import VIDEO_FILE, FrameSet, VideoRecord
from gmrdata.values.limits import MOST_DIGITS, MOST_PIXELS

if TYPE_CHECKING:
    from PIL.Image import Exif
    from PIL.ImageFile import ImageFile

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
OF_NO_FRAME = re.compile(r"[0-9]+x[0-9]+|@[0-9]+x|[0-9]+(px|p|fps|hz)(?![a-z])", re.IGNORECASE)
"""Of a name like `frame0012_180x240.jpg`, `0012@2x.png` or `0012_1080p.png`."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
ORIENTATION = 0x112  # EXIF 2.32, 4.6.4 A
# Pillow warns of EXIF that is cut off, which is common and no fault of the picture.
warnings.filterwarnings("ignore", module=r"PIL\.TiffImagePlugin")


def image_number(path: Path) -> int:
    """Number of a frame: the last run of digits in the file's stem (`image_00012.jpg` -> 12), but
    for a size, `frame0012_180x240.jpg`."""
    number = number_in_name(path.name)
    if number is None:
        what = f"no number in the name, or one of more than {MOST_DIGITS} digits"
        raise BadFrames(f"{path}: {what}; name frames like 00012.jpg")
    return number


def number_in_name(name: str) -> int | None:
    """The last run of digits in a file name without its suffix, which is part of no size or rate
    if there is another; None without, or if too long."""
    stem = PurePosixPath(name).stem
    runs = re.findall(r"[0-9]+", OF_NO_FRAME.sub(" ", stem)) or re.findall(r"[0-9]+", stem)
    digits = runs[-1].lstrip("0") if runs else ""
    return int(digits or 0) if runs and len(digits) <= MOST_DIGITS else None


def read_frames(folder: Path, left_out: Collection[int] = ()) -> FrameSet:
    """A folder's .jpg and .png files, checked: two or more of one size, numbered without gaps but
    for `left_out`, which are not taken.

    Raises:
        MissingInput: there is no such folder.
        BadFrames: an image is missing, of another size, or none.
        BadRecord: the video's record beside them can't be read.
    """
    paths = list_images(folder, left_out)
    numbers = np.array([image_number(path) for path in paths], dtype=np.int64)
    alone = FrameSet(
        folder=folder,
        paths=tuple(paths),
        numbers=numbers,
        size_px=check_images(paths),
        frame_numbers=np.arange(len(paths)),
        n_frames=len(paths),
        times_s=np.full(len(paths), np.nan),
        rate_hz=np.nan,
        left_out={n: path for n, path in _numbered(folder) if n in left_out} if left_out else {},
    )
    video = video_record(folder)
    return alone if video is None else of_video(alone, video)


def video_record(frames_dir: Path) -> VideoRecord | None:
    """What is known of the video that frames come from; None of frames from elsewhere."""
    path = frames_dir / VIDEO_FILE
    return VideoRecord.read(path) if path.is_file() else None


def of_video(frames: FrameSet, video: VideoRecord) -> FrameSet:
    """Images as frames of the video that they come from."""
    frame_of = video.frame_of
    foreign = [number for number in frames.numbers.tolist() if number not in frame_of]
    if foreign:
        what = f"image {foreign[0]} is no frame of the video that {VIDEO_FILE} is of"
        raise BadFrames(f"{frames.folder}: {what}; keep other images in a folder of their own")
    return replace(
        frames,
        frame_numbers=np.array([frame_of[number] for number in frames.numbers.tolist()]),
        n_frames=None if video.is_part else video.n_decoded,
        times_s=video.times_of(frames.numbers),
        rate_hz=video.rate_hz,
        video=video,
    )


def list_images(folder: Path, left_out: Collection[int] = ()) -> list[Path]:
    """A folder's .jpg and .png files by number: two or more, without gaps but for `left_out`."""
    numbered = [(number, path) for number, path in _numbered(folder) if number not in left_out]
    for _, path in numbered:
        require_text(path, BadFrames)
    if len(numbered) < 2:
        but = f" but {len(left_out)} left out" if left_out else ""
        what = f"{len(numbered)} image(s){but}; at least 2 frames (.jpg or .png) needed"
        raise BadFrames(f"{folder}: {what}")
    _require_one_each(folder, numbered, left_out)
    return [path for _, path in numbered]


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    """A folder's .jpg and .png files beside their numbers, in order."""
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder of images")
    paths = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file()]
    return sorted((image_number(path), path) for path in visible(paths))


def check_images(paths: list[Path]) -> tuple[int, int]:
    """(width_px, height_px) as a person sees them, turned by EXIF; nothing is decoded."""
    if not paths:
        raise BadFrames("no images were given; at least 2 frames needed")
    sizes = [_image_size(path) for path in paths]
    expected = Counter(sizes).most_common(1)[0][0]
    for path, size in zip(paths, sizes, strict=True):
        if size != expected:
            what = f"{size[0]}x{size[1]} px, other frames are {expected[0]}x{expected[1]} px"
            raise BadFrames(f"{path}: {what}; all frames of a sequence must have one size")
    return expected


def decoded(path: Path, flags: int, fault: str) -> np.ndarray:
    """An image as cv2 reads it with some flags, upright; BadFrames with the fault if it can't.

    The size in its header is looked at first, since that is what memory is taken for.
    """
    import cv2

    content = path.read_bytes() if path.is_file() else b""
    # The cameras' own smaller frames are BMPs, so named; others may not call one a PNG.
    header = _header(content, is_bmp=path.suffix == ".bmp")
    if header is None:
        raise BadFrames(f"{path}: {fault}")
    _require_small(path, header.size)
    try:
        # OpenCV turns by some flags and not by others, and a PNG by its version.  It is not given
        # the path, since it crashes on names whose bytes are no UTF-8.
        pixels = np.frombuffer(content, np.uint8)
        image = cv2.imdecode(pixels, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None:
        raise BadFrames(f"{path}: {fault}")
    return _upright(np.asarray(image), _orientation(header, content))


def _require_small(path: Path, size_px: tuple[int, int]) -> None:
    """Refuse an image of a size that no camera has."""
    if size_px[0] * size_px[1] > MOST_PIXELS:
        what = f"{size_px[0]}x{size_px[1]} px, more than {MOST_PIXELS} in all"
        raise BadFrames(f"{path}: {what}; make the image smaller")


def read_gray(path: Path, size_px: tuple[int, int] | None = None) -> np.ndarray:
    """Read an image as (H, W) uint8; `size_px` is the (width, height) that it must have, if any."""
    import cv2

    return _of_size(path, cv2.IMREAD_GRAYSCALE, size_px)


def read_stored(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """Read an image of that (width, height) as it is stored, (H, W) or (H, W, 3 or 4) BGRA of
    8 or 16 bits, upright."""
    import cv2

    return _of_size(path, cv2.IMREAD_UNCHANGED, size_px)


def _of_size(path: Path, flags: int, size_px: tuple[int, int] | None) -> np.ndarray:
    image = decoded(path, flags, "missing or not an image; make this file again")
    if size_px is not None and image.shape[:2] != size_px[::-1]:
        sizes = "{1}x{0} px, its frame is {2}x{3} px".format(*image.shape[:2], *size_px)
        raise BadFrames(f"{path}: {sizes}; make this file again at that size")
    return image


def read_color(path: Path) -> np.ndarray:
    """Read an image as (H, W, 3) uint8 BGR, upright."""
    import cv2

    # Of 16 bits the upper 8 are kept; grey becomes three equal channels.
    fault = "missing or cannot be decoded; extract or copy this frame again"
    return decoded(path, cv2.IMREAD_COLOR, fault)


def write_gray(path: Path, image: np.ndarray) -> None:
    """Write (H, W) uint8 as PNG, as a whole or not at all."""
    write_bytes(path, gray_bytes(image))


def gray_bytes(image: np.ndarray) -> bytes:
    """(H, W) uint8 as a PNG holds it.  Rows are not filtered: masks, which are read often, would
    take seven times as long to read, for half the size."""
    import cv2

    plain = [cv2.IMWRITE_PNG_COMPRESSION, 3, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
    return image_bytes(".png", image, plain)


def write_image(path: Path, image: np.ndarray, params: Sequence[int] = ()) -> None:
    """Write an image as its path's suffix says, with cv2's `params`, as a whole or not at all."""
    write_bytes(path, image_bytes(path.suffix, image, params))


def image_bytes(suffix: str, image: np.ndarray, params: Sequence[int] = ()) -> bytes:
    """An image as a file of that kind holds it."""
    import cv2

    # cv2.imwrite crashes on names whose bytes are no UTF-8, and does not say that a disk is full.
    _, encoded = cv2.imencode(suffix, image, list(params))
    return encoded.tobytes()


def _require_one_each(
    folder: Path, numbered: list[tuple[int, Path]], left_out: Collection[int]
) -> None:
    for (before, one), (after, other) in pairwise(numbered):
        if before == after:
            what = f"two images have the number {after}, {one.name} and {other.name}"
            remedy = "name frames like 00012.jpg, and keep other pictures in another folder"
            raise BadFrames(f"{folder}: {what}; {remedy}")
        # A gap may be of a billion numbers, so those that may lack are counted, not listed.
        n_missing = after - before - 1 - sum(before < number < after for number in set(left_out))
        if n_missing:
            lacking = (n for n in range(before + 1, after) if n not in left_out)
            back = (n for n in range(after - 1, before, -1) if n not in left_out)
            first, last = next(lacking), next(back)
            named = f"{first}" if n_missing == 1 else f"{first} to {last}"
            what = f"frame {named} missing between {before} and {after}"
            remedy = "put it back, or renumber the frames without a gap"
            raise BadFrames(f"{folder}: {what}; {remedy}")


def _image_size(path: Path) -> tuple[int, int]:
    if not path.is_file():
        raise BadFrames(f"{path}: no such image")
    content = path.read_bytes()
    header = _header(content)
    if header is None or not _is_whole(header, content):
        fault = "truncated or not an image" if content else "empty file (0 bytes)"
        raise BadFrames(f"{path}: {fault}; extract or copy this frame again")
    _require_small(path, header.size)
    return header.size if _orientation(header, content) <= 4 else header.size[::-1]


def is_turned(path: Path) -> bool:
    """Whether a program that ignores EXIF would show an image otherwise than it is read here."""
    return exif_orientation(path.read_bytes()) != 1


def exif_orientation(content: bytes) -> int:
    """EXIF's orientation of a JPEG or PNG, 1 (upright) to 8; 1 where there is none that counts."""
    header = _header(content)
    return 1 if header is None else _orientation(header, content)


def _orientation(header: "ImageFile", content: bytes) -> int:
    value = _exif(header, content).get(ORIENTATION)
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def read_exif(path: Path) -> "Exif":
    """What a JPEG or PNG says in EXIF; nothing where it has none that can be read."""
    from PIL.Image import Exif

    content = path.read_bytes()
    header = _header(content)
    return Exif() if header is None else _exif(header, content)


def _header(content: bytes, *, is_bmp: bool = False) -> "ImageFile | None":
    """The header of a PNG or JPEG, or of a BMP where that is expected; None for what is none."""
    from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin

    # Not by Image.open, which knows more kinds and has a limit of its own on sizes.
    kind: type[ImageFile] = JpegImagePlugin.JpegImageFile
    if is_bmp:
        kind = BmpImagePlugin.BmpImageFile
    elif content.startswith(PNG_SIGNATURE):
        kind = PngImagePlugin.PngImageFile
    try:
        return kind(BytesIO(content))
    except (SyntaxError, ValueError, OSError, ArithmeticError):
        return None


def _exif(header: "ImageFile", content: bytes) -> "Exif":
    from PIL.Image import Exif

    is_png = content.startswith(PNG_SIGNATURE)
    exif, tiff = Exif(), _png_exif(content) if is_png else header.info.get("exif", b"")
    try:
        exif.load(tiff)
    except (SyntaxError, ValueError, OSError, LookupError, struct.error):
        return Exif()
    return exif


def _upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """An image as its EXIF orientation says: 5 to 8 swap rows and columns, the rest mirrors."""
    if orientation == 1:
        return image
    if orientation >= 5:
        image = image.swapaxes(0, 1)
    down = -1 if orientation in (3, 4, 7, 8) else 1
    right = -1 if orientation in (2, 3, 6, 7) else 1
    return np.ascontiguousarray(image[::down, ::right])


def _png_exif(content: bytes) -> bytes:
    """The TIFF structure in a PNG's eXIf chunk; empty without.  It may stand behind the pixels,
    where Pillow gets only by decoding them."""
    at = len(PNG_SIGNATURE)
    while at + 8 <= len(content):
        end = at + 8 + int.from_bytes(content[at : at + 4], "big")
        if content[at + 4 : at + 8] == b"eXIf":
            return content[at + 8 : end]
        at = end + 4
    return b""


def _is_whole(header: "ImageFile", content: bytes) -> bool:
    """Whether a PNG or JPEG has its end, behind which phones put a film or notes of their own."""
    # From behind, where it mostly is.
    if content.startswith(PNG_SIGNATURE):
        return content.rfind(b"IEND") >= 0
    # A small picture in the head has an end too; the header was read up to the first pixels.
    return content.rfind(b"\xff\xd9", header.fp.tell() if header.fp else 0) >= 0
