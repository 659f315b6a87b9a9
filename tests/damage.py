"""Damaged files: whatever a change makes of one, it is read or refused by its name."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from gmrdata.values.errors import GmrdataError

T = TypeVar("T")


class Calls:
    """Pickles as a call of a function; with a state, as an object that is built."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.called = (function, arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        return self.called


def in_one_folder(max_examples: int) -> settings:
    """For tests whose examples all write the same file of `tmp_path`."""
    fine = [HealthCheck.function_scoped_fixture]
    return settings(max_examples=max_examples, deadline=None, suppress_health_check=fine)


def part_replaced(data: st.DataObject, raw: bytes) -> bytes:
    """Up to 20 other bytes in place of some part."""
    start = data.draw(st.integers(0, len(raw)))
    stop = data.draw(st.integers(start, len(raw)))
    return raw[:start] + data.draw(st.binary(max_size=20)) + raw[stop:]


def bytes_changed(data: st.DataObject, raw: bytes, most: int = 4) -> bytes:
    """Up to so many other bytes, anywhere."""
    changed = bytearray(raw)
    for _ in range(data.draw(st.integers(1, most))):
        changed[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    return bytes(changed)


def read_or_refused(path: Path, content: bytes, read: Callable[[Path], T]) -> T | None:
    """What is read of a file with that content; None where an error of ours names the file."""
    path.write_bytes(content)
    try:
        return read(path)
    except GmrdataError as error:
        assert path.name in str(error)
        return None
