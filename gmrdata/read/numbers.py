"""Numbers out of files that others wrote: texts of motion data, and arrays of pickles and JSON."""

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import from_json

from gmrdata.values.body import N_JOINTS
from gmrdata.values.errors import BadMotionFile, BadSequence
from gmrdata.values.files import require_file
from gmrdata.values.limits import BYTES_PER_LINE, FREE_LINES, MOST_TEXT_BYTES
from gmrdata.values.transforms import are_rotations, rotmats_from_rotvecs

LARGEST_IN_TEXT = 1e7  # larger magnitudes are no positions or angles of a person in any unit
DIGITS = b"0123456789+-.eE"
_COMMAS = bytes.maketrans(b" \n", b",,")
_GLUED = re.compile(r"(?<=[\d.])-")
"""A minus without the space before it, as SlimeVR once wrote; that of an exponent follows its e."""
LARGEST_NUMBER = 1e6  # no angle [rad], position [m] or shape coefficient of a person is larger


def read_text(path: Path) -> str:
    """A motion file as text with plain line ends, of no more lines than its size has use for."""
    require_file(path)
    if path.stat().st_size > MOST_TEXT_BYTES:
        raise BadMotionFile(f"{path}: larger than {MOST_TEXT_BYTES} bytes; cut it into parts")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadMotionFile(f"{path}: cannot be read ({error.strerror})") from None
    if not data.strip():
        raise BadMotionFile(f"{path}: the file is empty; fetch it again")
    if data.startswith(b"version https://git-lfs"):
        raise BadMotionFile(f"{path}: a Git LFS pointer, not the file; run `git lfs pull` there")
    if b"\0" in data:
        raise BadMotionFile(f"{path}: a binary file, not a text of motion data; fetch it again")
    n_lines = data.count(b"\n") + data.count(b"\r")
    if n_lines > max(FREE_LINES, len(data) // BYTES_PER_LINE):
        raise BadMotionFile(f"{path}: {n_lines} lines, nearly all of them empty; fetch it again")
    # Names in another encoding, as Shift-JIS, stay different from each other.
    text = data.decode("utf-8-sig", errors="backslashreplace")
    return _plain_separators(text.replace("\r\n", "\n").replace("\r", "\n"))


def _plain_separators(text: str) -> str:
    """The text with points in its numbers, and spaces between them.

    A comma is a decimal one where no number has a point and none has two commas, and in a frame
    time; else it stands between numbers, as a semicolon does.
    """
    if ";" in text:
        text = re.sub(r"(?<=[\d.]);|;(?=[ \t]*[-+.\d]|[ \t]*$)", " ", text, flags=re.MULTILINE)
    if "," not in text:
        return text
    # A point in a name, as in Spine1.001, is none of a number's.
    if not re.search(r"(?<![\w.])[-+]?\d*\.\d|\d,[-+]?\d*,\d", text):
        return re.sub(r"(?<=\d),(?=\d)", ".", text)
    text = re.sub(r"(?im)^(\s*frame time:\s*\d*),(\d+\s*$)", r"\1.\2", text)  # is one number
    return re.sub(r"(?<=[\d.]),|,(?=[ \t]*[-+.\d])", " ", text)


def bad_line(path: Path, line_number: int, what: str) -> BadMotionFile:
    return BadMotionFile(f"{path}:{line_number}: {what}")


def parse_floats(words: list[str], path: Path, line_number: int) -> list[float]:
    values = []
    for word in words:
        try:
            if "_" in word or not word.isascii():  # Python's own forms, which no file's writer has
                raise ValueError
            values.append(float(word))
        except ValueError:
            what = f"{word[:40]!r} is not a number; fetch the file again"
            raise bad_line(path, line_number, what) from None
        if not abs(values[-1]) <= LARGEST_IN_TEXT:
            what = f"{word[:40]} is not a usable number; cut the bad frames out of the file"
            raise bad_line(path, line_number, f"{what} or fetch it again")
    return values


def plain_rows(lines: Sequence[str], n_columns: int, start: str = "") -> np.ndarray | None:
    """Lines of numbers, all with the same start, as (T, n); None where one needs a closer look.

    A parser of JSON reads numbers three times as fast as `float`.
    """
    text = "\n".join(["", *lines]).replace(f"\n{start}", "\n").encode()[1:]
    if text.translate(None, DIGITS) != b"\n".join([b" " * (n_columns - 1)] * len(lines)):
        return None
    text = text.replace(b" .", b" 0.").replace(b"-.", b"-0.")  # JSON wants a digit before the point
    try:
        values = np.array(from_json(b"[%b]" % text.translate(_COMMAS)), dtype=np.float64)
    except (ValueError, OverflowError):
        return None
    usable = np.all(np.abs(values) <= LARGEST_IN_TEXT)
    return values.reshape(-1, n_columns) if usable else None


def parse_block(text: str) -> np.ndarray | None:
    """All numbers of a text as a flat array, or None where one of its words is no usable number."""
    try:
        with warnings.catch_warnings(action="error"):
            values = np.fromstring(text, sep=" ")
    except (DeprecationWarning, ValueError):
        return None
    return values if np.all(np.abs(values) <= LARGEST_IN_TEXT) else None


def parse_table(
    lines: list[str], n_columns: int, n_rows: int, path: Path, first_line: int
) -> np.ndarray:
    """Lines of numbers as (n_rows, n_columns), empty ones skipped; `first_line` counts from 1."""
    filled_lines = [stripped for line in lines if (stripped := line.strip())]
    values = plain_rows(filled_lines, n_columns)
    if values is not None and len(values) == n_rows:
        return values
    if values is None and any(_GLUED.search(line) for line in filled_lines):
        return parse_table(
            [_GLUED.sub(" -", x) for x in lines], n_columns, n_rows, path, first_line
        )
    values = parse_block("\n".join(lines))
    if values is not None and values.size == n_rows * n_columns:
        return values.reshape(n_rows, n_columns)
    filled = [(n, line.split()) for n, line in enumerate(lines, first_line) if line.strip()]
    for line_number, words in filled:
        if len(words) != n_columns:
            what = f"{len(words)} numbers where the channels need {n_columns}; the file is"
            raise bad_line(path, line_number, f"{what} truncated or edited, fetch it again")
        parse_floats(words, path, line_number)
    what = f"the header promises {n_rows} frames and the file has {len(filled)}; fetch it again"
    raise BadMotionFile(f"{path}: {what}, or correct the number after 'Frames:'")


class WrongContent(ValueError):
    """A value is not what its format has there; the text names the place and what was found."""


@contextmanager
def checked(path: Path, remedy: str) -> Iterator[None]:
    """Let every `WrongContent` become a BadSequence that names the file and the remedy."""
    try:
        yield
    except WrongContent as error:
        raise BadSequence(f"{path}: {error}; {remedy}") from None


def check_file(path: Path, most_bytes: int, dataset: str) -> None:
    """Refuse a data set's file that is not there, or far larger than any of them."""
    require_file(path)
    size_bytes = path.stat().st_size
    if size_bytes > most_bytes:
        raise BadSequence(f"{path}: has {size_bytes} bytes, which no sequence of {dataset} has")


def value_of(content: Any, *keys: str) -> Any:
    """The value of the first of some keys that a dictionary has."""
    if not isinstance(content, dict):
        raise WrongContent(f"holds {kind_of(content)} where a dictionary with {keys[0]!r} belongs")
    for key in keys:
        if key in content:
            return content[key]
    raise WrongContent(f"has another layout, it lacks {' or '.join(map(repr, keys))}")


def array_of(value: Any, what: str, shape: tuple[int | None, ...], kinds: str) -> np.ndarray:
    """An array of numpy's `kinds` and of a shape, in which None stands for any size."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in kinds:
        raise WrongContent(f"{what} is {kind_of(value)}, expected an array of numbers")
    sizes = zip(shape, value.shape, strict=False)
    if value.ndim != len(shape) or any(wanted not in (None, size) for wanted, size in sizes):
        expected = ", ".join("any" if size is None else str(size) for size in shape)
        raise WrongContent(f"{what} has shape {value.shape}, expected ({expected})")
    return value


def any_array_of(value: Any, what: str) -> np.ndarray:
    """An array, or what nested lists are one of; lists nested deeper than numpy takes are none."""
    try:
        return np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        raise WrongContent(f"{what} is {kind_of(value)}, expected an array of numbers") from None


def floats_of(value: Any, what: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """Numbers of nested lists or of an array as float64; NaN and infinities are kept."""
    array = any_array_of(value, what)
    if array.dtype.kind not in "fiu":
        raise WrongContent(f"{what} is {kind_of(value)}, expected an array of numbers")
    return array_of(array.astype(np.float64), what, shape, "f")


def text_of(value: Any, what: str) -> str:
    """A string, as Python 2 and 3 and numpy write one."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "US" and value.size == 1:
        value = value.reshape(())[()]
    if isinstance(value, bytes):
        value = value.decode("latin1")
    if not isinstance(value, str):
        raise WrongContent(f"{what} is {kind_of(value)}, expected a string")
    return str(value)


def pinhole_of(value: Any, what: str) -> np.ndarray:
    """A calibration matrix K (3, 3) [px] without skew below its diagonal."""
    intrinsics_px = floats_of(value, what, (3, 3))
    below = (intrinsics_px[1, 0], *intrinsics_px[2])
    positive = (np.diag(intrinsics_px) > 0).all()
    if not (usable_rows(intrinsics_px[None]).all() and positive and below == (0, 0, 0, 1)):
        raise WrongContent(f"{what} is no calibration matrix: {intrinsics_px.tolist()}")
    return intrinsics_px


def kind_of(value: Any) -> str:
    """What a value is, for a message."""
    if isinstance(value, np.ndarray):
        return f"an array of dtype {value.dtype} and shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a {type(value).__name__} of {len(value)}"
    return f"a {type(value).__name__}"


def finite_numbers(value: Any, what: str, path: Path) -> np.ndarray:
    """An array of a motion file as finite float64."""
    try:
        values = np.asarray(value)
        if values.dtype.kind in "cmM":  # numpy would take what is real of complex ones, and dates
            raise TypeError
        with np.errstate(invalid="ignore"):  # a signalling NaN is refused below
            values = values.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise BadMotionFile(f"{path}: {what} does not hold numbers; get the file again") from None
    wrong = np.argwhere(~(np.abs(values) <= LARGEST_IN_TEXT))
    if len(wrong):
        at = f" at frame {wrong[0][0]}" if values.ndim > 1 else ""
        raise BadMotionFile(f"{path}: {what} is not finite{at}; cut such frames out of the file")
    return values


def require_radians(rotvecs: np.ndarray, what: str, path: Path) -> None:
    """Refuse axis-angle (T, 3 J) in degrees: nobody's joints mostly turn by more than a circle."""
    turns = np.linalg.norm(rotvecs.reshape(-1, 3), axis=1)
    if np.percentile(turns, 99) > 2 * np.pi:
        how = f"turns of up to {turns.max():.0f} in {what}: degrees, where the format has radians"
        raise BadMotionFile(f"{path}: {how}; write them with np.deg2rad")


def usable_rows(*arrays: np.ndarray) -> np.ndarray:
    """(N,) bool: all numbers of the row are finite in each (N, ...) array, and none is absurd."""
    usable = [(np.abs(a) < LARGEST_NUMBER).reshape(len(a), -1).all(axis=1) for a in arrays]
    return np.logical_and.reduce(usable)


def smpl_rotmats(poses_rad: np.ndarray) -> np.ndarray:
    """Axis-angle (N, 72) of SMPL's joints as (N, 24, 3, 3); NaN in rows that can't be used."""
    known = usable_rows(poses_rad)
    rotmats = np.full((len(poses_rad), N_JOINTS, 3, 3), np.nan)
    rotmats[known] = rotmats_from_rotvecs(poses_rad[known].reshape(-1, N_JOINTS, 3))
    return rotmats


def rigid_rows(transforms: np.ndarray) -> np.ndarray:
    """(N, 4, 4) -> (N,) bool: finite, a proper rotation and a translation."""
    finite = usable_rows(transforms)
    rotmats = np.where(finite[:, None, None], transforms[:, :3, :3], np.eye(3))
    return finite & are_rotations(rotmats) & (transforms[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
