"""Arrays out of files that others wrote: numbers of an expected shape, or what is there instead."""

from typing import Any

import numpy as np

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
