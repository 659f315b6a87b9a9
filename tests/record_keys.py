"""Takes away each key of a record in turn."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gmrdata.values.errors import BadRecord
from gmrdata.values.records import Record


def assert_each_key_is_needed(record: Record, path: Path, free: tuple[str, ...] = ()) -> None:
    """Reading the file is an error that names file and key, whichever key of it is gone.

    Args:
        record: A record in which nothing is empty.
        path: Where to write it.
        free: Dotted paths of tables whose keys are names that may be there or not.
    """
    record.write(path)
    assert type(record).read(path) == record
    whole = json.loads(path.read_text())
    places = list(_places(whole, ""))
    assert len(places) > 1
    for place in places:
        at, _, key = place.rpartition(".")
        if at in free:
            continue
        path.write_text(json.dumps(_without(whole, place)))
        with pytest.raises(BadRecord) as raised:
            type(record).read(path)
        assert str(path) in str(raised.value) and key in str(raised.value), place


def _places(value: Any, at: str) -> Iterator[str]:
    """Dotted paths of all keys; of a list's items the first stands for the others."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{at}.{key}".lstrip(".")
            yield from _places(inner, f"{at}.{key}".lstrip("."))
    elif isinstance(value, list) and value:
        yield from _places(value[0], f"{at}.0")


def _without(whole: Any, place: str) -> Any:
    copy = json.loads(json.dumps(whole))
    *way, last = place.split(".")
    inner = copy
    for key in way:
        inner = inner[int(key)] if isinstance(inner, list) else inner[key]
    del inner[last]
    return copy
