"""Records: what is written is read again, and what is missing, unknown or wrong is named."""

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from gmrdata.values import limits
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import npz_format, read_json, write_json, write_npz
from gmrdata.values.records import ArrayShapes, Record, compared, read_arrays

ROWS: ArrayShapes = {"rows": ("i", ("N",))}


class Measured(Record):
    """A record as stages leave them."""

    format: Literal["gmrdata-measured/1"] = "gmrdata-measured/1"
    share: float
    focal_factor: float | None


RECORD = Measured(share=0.5, focal_factor=None)


def edited(path: Path, **changes: Any) -> Path:
    RECORD.write(path)
    values = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({key: value for key, value in values.items() if value != "gone"}))
    return path


def test_a_record_comes_back(tmp_path):
    RECORD.write(tmp_path / "a.json")
    assert Measured.read(tmp_path / "a.json") == RECORD


def test_a_record_that_says_the_same_is_left_alone(tmp_path):
    path = tmp_path / "a.json"
    RECORD.write(path)
    before = path.stat()
    RECORD.write(path)
    assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    Measured(share=0.6, focal_factor=None).write(path)
    assert Measured.read(path).share == 0.6


@pytest.mark.parametrize(
    ("change", "said"),
    [
        *(({key: "gone"}, f"has no .*`{key}`") for key in ("format", "share", "focal_factor")),
        ({"shares": 1.0}, "has an unknown key `shares`"),
        *(({"share": wrong}, "`share` is wrong") for wrong in ("much", None, np.nan, np.inf)),
    ],
)
def test_a_key_that_lacks_or_is_unknown_or_wrong_is_named(tmp_path, change, said):
    with pytest.raises(BadRecord, match=rf"a\.json: {said}"):
        Measured.read(edited(tmp_path / "a.json", **change))


@pytest.mark.parametrize("text", ["[]", "3", '{"format": "gmrdata-other/1"}'])
def test_another_format_is_refused(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(BadRecord, match="gmrdata-measured/1"):
        Measured.read(path)


@pytest.mark.parametrize(
    ("text", "read"),
    [("H\udcfcft", r"H\xfcft"), ("\U0001f4fc", "\U0001f4fc"), (r"\udcfc", r"\udcfc")],
)
def test_a_name_that_is_no_text_stays_readable(tmp_path, text, read):
    write_json(tmp_path / "a.json", {"file": text})
    assert read_json(tmp_path / "a.json") == {"file": read}


@pytest.mark.parametrize(
    ("value", "limit", "spec", "text"),
    [
        (0.5, 0.9, ".0%", "50% of 90%"),
        (0.896, 0.9, ".0%", "89.6% of 90.0%"),
        (0.122, 0.124, ".0%", "12.2% of 12.4%"),
        (1.5, 1, ".2f", "1.50 of 1"),
        (1.0004, 1, ".2f", "1.0004 of 1"),
        (1, 1, ".2f", "1.00 of 1"),
        (float("nan"), 1, ".3g", "nan of 1"),
    ],
)
def test_a_value_and_its_limit_are_told_apart(value, limit, spec, text):
    assert compared("{} of {}", value, limit, spec) == text


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingInput, match=r"a\.json"):
        Measured.read(tmp_path / "a.json")


def test_arrays_come_back_without_their_tag(tmp_path):
    write_npz(tmp_path / "a.npz", {"format": "gmrdata-rows/1", "rows": np.arange(3)})
    arrays = read_arrays(tmp_path / "a.npz", "gmrdata-rows/1", ROWS)
    assert list(arrays) == ["rows"] and arrays["rows"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"rows": 1}, "has no `format`"),
        ({"format": "gmrdata-rows/0", "rows": 1}, "not 'gmrdata-rows/1'"),
        ({"format": "gmrdata-rows/1"}, "has no array 'rows'"),
        ({"format": "gmrdata-rows/1", "rows": 1, "more": 2}, "unknown array 'more'"),
    ],
)
def test_arrays_that_are_not_the_record(tmp_path, arrays, said):
    write_npz(tmp_path / "a.npz", arrays)
    with pytest.raises(BadRecord, match=said):
        read_arrays(tmp_path / "a.npz", "gmrdata-rows/1", ROWS)


def test_what_an_archive_says_of_itself_fills_no_memory(tmp_path, monkeypatch):
    """A `format` of 3 MB, zipped, was unpacked to 3 GB before anything was known of the file."""
    for n in (1, 1 << 20):
        write_npz(tmp_path / f"{n}.npz", {"format": np.full(n, "a")}, compressed=True)
    monkeypatch.setattr(limits, "FREE_BYTES", 1000)
    assert npz_format(tmp_path / "1.npz") == "['a']"
    assert npz_format(tmp_path / f"{1 << 20}.npz") is None
