"""Which rows of a motion file were recorded: not an added rest pose, not rows without data."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.errors import BadMotionFile

REST_FRAME_JUMP_DEG = 10.0
"""A first frame without any root rotation is an added rest pose if a joint then jumps this far."""


def recorded_rows(
    table: np.ndarray,
    rotation_columns: Sequence[Sequence[int]],
    cmu: bool,
    drop_rest_frame: bool | None,
    path: Path,
) -> tuple[slice, tuple[str, ...]]:
    """The recorded rows of a file's table of channels.

    cgspeed's CMU files begin with a T-pose.  A recorded root is never turned by exactly nothing; in
    a recording that does start at rest the next frame is close to it, after the added pose comes a
    jump. Some CMU trials (09_10) hold rows of nothing but zeros before or after the recording.

    Args:
        table: (T, C) channels; angles in degrees.
        rotation_columns: Per joint, root first, the columns of its angles.
        cmu: Whether the file is CMU's, so that rows of zeros are rows without data.
        drop_rest_frame: Whether row 0 is an added rest pose; None looks for itself.
        path: The file, for messages.

    Returns:
        The rows to keep, and notes on those that were dropped.

    Raises:
        BadMotionFile: there are rows without data in the middle, or fewer than 2 recorded rows.
    """
    empty = ~table.any(axis=1) if cmu else np.zeros(len(table), dtype=bool)
    if drop_rest_frame is None:
        drop_rest_frame = _starts_with_rest_frame(table, rotation_columns, empty)
    filled = np.flatnonzero(~empty[1:]) + 1 if drop_rest_frame else np.flatnonzero(~empty)
    if len(filled) < 2:
        raise BadMotionFile(
            f"{path}: {len(filled)} recorded frames are no motion; it takes at least 2"
        )
    start, stop = int(filled[0]), int(filled[-1]) + 1
    if empty[start:stop].any():
        gap = start + int(np.argmax(empty[start:stop]))
        raise BadMotionFile(f"{path}: frame {gap} holds no data, all is zero; split the file there")
    notes = ("added rest pose in frame 0 dropped",) if drop_rest_frame else ()
    n_empty = len(table) - (stop - start) - len(notes)
    return slice(start, stop), notes + ((f"{n_empty} empty frames dropped",) if n_empty else ())


def _starts_with_rest_frame(
    table: np.ndarray, rotation_columns: Sequence[Sequence[int]], empty: np.ndarray
) -> bool:
    """Whether row 0 is a pose that was put in front of a recording."""
    later = np.flatnonzero(~empty[1:]) + 1
    root = list(rotation_columns[0])
    if not len(later) or not root or table[0, root].any() or not table[later[0], root].any():
        return False
    angles_deg = table[:, [column for columns in rotation_columns for column in columns]]
    turn_deg = angles_deg[later[0]] - angles_deg[0]
    return bool(np.abs((turn_deg + 180.0) % 360.0 - 180.0).max() > REST_FRAME_JUMP_DEG)
