"""Numbers in motion files: fast conversion of large blocks, exact messages for what is wrong.

Arrays out of files that others wrote: numbers of an expected shape, or what is there instead.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.values.errors import BadMotionFile, MissingInput

LARGEST_IN_TEXT = 1e7
"""Larger magnitudes are no positions or angles of a person in any unit."""


def read_text(path: Path) -> str:
    """A motion file as text with plain line ends.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: the file is empty or binary.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadMotionFile(f"{path}: cannot be read ({error.strerror})") from None
    if not data.strip():
        raise BadMotionFile(f"{path}: the file is empty; fetch it again")
    if b"\0" in data:
        raise BadMotionFile(f"{path}: a binary file, not a text of motion data; fetch it again")
    text = data.decode("utf-8-sig", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_floats(words: list[str], path: Path, line_number: int) -> list[float]:
    """The numbers of one line.

    Raises:
        BadMotionFile: a word is no finite number of sensible size.
    """
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            raise BadMotionFile(
                f"{path}:{line_number}: {word[:40]!r} is not a number; fetch the file again"
            ) from None
        if not abs(value) <= LARGEST_IN_TEXT:
            raise BadMotionFile(
                f"{path}:{line_number}: {word[:40]} is not a usable number; "
                "cut the bad frames out of the file or fetch it again"
            )
        values.append(value)
    return values


def parse_block(text: str) -> np.ndarray | None:
    """All numbers of a text as a flat array, or None where one of its words is no usable number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.fromstring(text, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    usable = bool(np.all(np.abs(values) <= LARGEST_IN_TEXT))
    return values if usable else None


def parse_table(
    lines: list[str], n_columns: int, n_rows: int, path: Path, first_line: int
) -> np.ndarray:
    """A block with one row of numbers per line; empty lines are skipped.

    Args:
        lines: The block's lines.
        n_columns: Numbers in each row.
        n_rows: Rows that the header promises.
        path: The file, for messages.
        first_line: Line number of `lines[0]` in the file, from 1.

    Returns:
        (n_rows, n_columns).

    Raises:
        BadMotionFile: a row is too short or long, holds something else than usable numbers, or the
            number of rows is not the promised one.
    """
    values = parse_block("\n".join(lines))
    if values is not None and values.size == n_rows * n_columns:
        return values.reshape(n_rows, n_columns)
    found = 0
    for line_number, line in enumerate(lines, first_line):
        words = line.split()
        if not words:
            continue
        found += 1
        if len(words) != n_columns:
            raise BadMotionFile(
                f"{path}:{line_number}: {len(words)} numbers where the channels need {n_columns}; "
                "the file is truncated or edited, fetch it again"
            )
        parse_floats(words, path, line_number)
    raise BadMotionFile(
        f"{path}: the header promises {n_rows} frames and the file has {found}; "
        "fetch it again, or correct the number after 'Frames:'"
    )


LARGEST_NUMBER = 1e6
"""No angle [rad], position [m] or shape coefficient of a person is larger."""


def numbers(value: Any, shape: tuple[int | None, ...]) -> np.ndarray:
    """Numbers of JSON lists or of a pickled array as float64; NaN and infinities are kept.

    Args:
        value: Nested lists of numbers, or an array of them.
        shape: What it has to be, None for any size.

    Raises:
        ValueError: it is something else; the text says what, to be put behind the place's name.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            raise ValueError
        array = array.astype(np.float64)
    except (ValueError, TypeError, OverflowError):
        raise ValueError(f"is {kind_of(value)}, expected an array of numbers") from None
    fits = array.ndim == len(shape) and all(
        size in (None, found) for size, found in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"has shape {array.shape}, expected ({wanted})")
    return array


def usable_rows(*arrays: np.ndarray) -> np.ndarray:
    """(N,) bool: all numbers of the row are finite in each (N, ...) array, and none is absurd."""
    usable = [
        (np.abs(array) < LARGEST_NUMBER).reshape(len(array), -1).all(axis=1) for array in arrays
    ]
    return np.logical_and.reduce(usable)


def kind_of(value: Any) -> str:
    """What a value is, for a message."""
    if isinstance(value, np.ndarray):
        return f"an array of dtype {value.dtype} and shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a {type(value).__name__} of {len(value)}"
    return f"a {type(value).__name__}"
