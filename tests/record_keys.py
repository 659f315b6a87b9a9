"""Takes away each key of a record in turn, and puts texts for its numbers."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gmrdata.values.errors import BadRecord
from gmrdata.values.records import MAKE_AGAIN, Record


def assert_each_key_is_needed(
    record: Record, path: Path, free: tuple[str, ...] = (), *, named_alone: bool = False
) -> None:
    """Reading the file is an error that names file and key, whichever key of it is gone.

    Args:
        record: A record in which nothing is empty.
        path: Where to write it.
        free: Dotted paths of tables whose keys are names that may be there or not.
        named_alone: Whether errors may name a key without the way to it, as checks of tables do.
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
        said = str(raised.value)
        assert str(path) in said and MAKE_AGAIN in said, place
        assert (key if named_alone else f"`{place}`") in said, place
    assert_numbers_are_numbers(type(record), whole, path)


def assert_numbers_are_numbers(kind: type[Record], whole: Any, path: Path) -> None:
    """A text or `true` for a number is an error that names file and key; where it may be anything,
    it is read as what it is."""
    for place in _places(whole, ""):
        number = _at(whole, place)
        if isinstance(number, bool) or not isinstance(number, int | float):
            continue
        for other in (str(number), True):
            path.write_text(json.dumps(_with(whole, place, other)))
            try:
                assert _at(kind.read(path).model_dump(mode="json"), place) == other
            except BadRecord as error:
                key = place.rpartition(".")[2]
                assert str(path) in str(error) and f"{key}` is wrong" in str(error), place


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
    way, _, last = place.rpartition(".")
    del _at(copy, way)[last]
    return copy


def _with(whole: Any, place: str, value: Any) -> Any:
    copy = json.loads(json.dumps(whole))
    way, _, last = place.rpartition(".")
    _at(copy, way)[last] = value
    return copy


def _at(value: Any, place: str) -> Any:
    for key in place.split(".") if place else ():
        value = value[int(key)] if isinstance(value, list) else value[key]
    return value
