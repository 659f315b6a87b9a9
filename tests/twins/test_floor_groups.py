"""Rows put together, the record on disk, and the table."""

import json
from typing import Any

import pytest

from gmrdata.stage.store import run_stage
from gmrdata.twins.floor import _seconds, by_class, group
from gmrdata.twins.floor_record import (
    HEADINGS,
    Floor,
    FloorGroup,
    PersonErrors,
    SequenceErrors,
    floor_rows,
    notes,
)
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import read_json, write_json
from gmrdata.values.records import Config
from tests.record_keys import assert_each_key_is_needed

FACTORS = {
    "ome_deg": 1, "tme_mm": 10, "vme_mm": 20, "camera_rotation_deg": 1, "camera_path_mm": 1,
}  # fmt: skip


def errors_of(size: float | None) -> dict[str, Any]:
    """Each error by one size."""
    return {key: None if size is None else factor * size for key, factor in FACTORS.items()}


def person(size: float | None, n_motions: int, kept_frames: int) -> PersonErrors:
    counts = {"n_motions": n_motions, "kept_frames": kept_frames}
    return PersonErrors(id="p", scale_error_percent=None, **counts, **errors_of(size))


def row(
    name: str, people: list[PersonErrors], scale_error: float | None = None, **changes: Any
) -> SequenceErrors:
    sizes = [one.ome_deg for one in people if one.ome_deg is not None]
    figures: dict[str, Any] = {
        "id": name,
        "class_true": "linear",
        "class_measured": "linear",
        "accepted": True,
        "frames": 50,
        "kept_share": sum(one.kept_frames for one in people) / (50 * len(people)),
        "scale_error_percent": scale_error,
        "scale_within_2sigma": None if scale_error is None else abs(scale_error) < 1.5,
        "seconds": 25.0,
        "people": tuple(people),
        "reasons": (),
    }
    return SequenceErrors(**figures | errors_of(max(sizes, default=None)) | changes)


ROWS = [
    row("a", [person(1.0, 30, 50), person(4.0, 10, 25)], -2.0),
    row("b", [person(2.0, 40, 45)], 1.0, class_measured="circular", seconds=50.0),
    row("c", [person(0.5, 47, 50)], class_true="static", class_measured="static"),
    row(
        "d",
        [person(None, 0, 0)],
        class_true="small",
        class_measured="none",
        accepted=False,
        reasons=("too few points", "cuts"),
    ),
]


@pytest.fixture
def floor() -> Floor:
    return Floor(
        fps_hz=10.0,
        seed=3,
        recipe={"name": "x"},
        sequences=tuple(ROWS),
        classes=by_class(ROWS),
        overall=group(ROWS),
    )


def test_a_class_is_the_mean_over_everyones_motions(floor):
    linear = floor.classes["linear"]
    pooled = (1.0 * 30 + 4.0 * 10 + 2.0 * 40) / 80
    assert linear.ome_deg == pooled and linear.tme_mm == 10 * pooled
    assert linear.vme_mm == 20 * pooled and linear.n_motions == 80
    assert linear.camera_rotation_deg == linear.camera_path_mm == (4.0 + 2.0) / 2
    assert linear.abs_scale_error_percent == 1.5
    assert (linear.scale_within_2sigma, linear.scale_stated) == (1, 2)
    assert (linear.sequences, linear.accepted, linear.class_right) == (2, 2, 1)
    assert linear.kept_share == (50 + 25 + 45) / 150
    assert linear.seconds_per_frame == 0.75


def test_rejected_sequences_count_in_the_kept_share_alone(floor):
    assert list(floor.classes) == ["linear", "small", "static"]
    small = floor.classes["small"]
    assert (small.accepted, small.n_motions, small.kept_share) == (0, 0, 0.0)
    assert small.ome_deg is small.camera_path_mm is small.abs_scale_error_percent is None
    overall = floor.overall
    assert overall.ome_deg == pytest.approx((30 + 40 + 80 + 0.5 * 47) / 127, rel=1e-5)
    assert (overall.sequences, overall.accepted, overall.scale_stated) == (4, 3, 2)
    assert overall.kept_share == pytest.approx(170 / 250)


def test_the_file_holds_what_was_measured(floor, tmp_path):
    path = tmp_path / "floor.json"
    write_json(path, floor.model_dump(mode="json"))
    assert Floor.read(path) == floor
    record = json.loads(path.read_text())
    assert set(record) == {
        "format", "fps_hz", "seed", "recipe", "sequences", "classes", "overall",
    }  # fmt: skip
    assert set(record["overall"]) == set(record["classes"]["static"]) == {
        "sequences", "accepted", "class_right", "n_motions", "ome_deg", "tme_mm", "vme_mm",
        "camera_rotation_deg", "camera_path_mm", "abs_scale_error_percent", "scale_stated",
        "scale_within_2sigma", "kept_share", "seconds_per_frame",
    } == set(FloorGroup.model_fields)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "gmrdata-floor/9"}, "`format` is 'gmrdata-floor/9'"),
        ({"overall": {}}, "has no key `overall.ome_deg`"),
        ({"more": 1}, "has an unknown key `more`"),
    ],
)
def test_another_file_is_refused(floor, tmp_path, change, message):
    path = tmp_path / "floor.json"
    write_json(path, floor.model_dump(mode="json") | change)
    with pytest.raises(BadRecord, match=f"floor.json: {message}"):
        Floor.read(path)
    path.write_text("{")
    with pytest.raises(BadRecord, match=r"floor\.json"):
        Floor.read(path)
    with pytest.raises(MissingInput):
        Floor.read(tmp_path / "no.json")


def test_each_key_of_the_file_is_needed(floor, tmp_path):
    assert_each_key_is_needed(floor, tmp_path / "floor.json", ("recipe", "classes"))


def test_the_table(floor):
    rows = floor_rows(floor)
    assert {len(cells) for cells in rows} == {len(HEADINGS)}
    assert rows[0] == (
        "a", "linear", "linear", "yes", "4.000", "40.00", "80.00", "4.000", "4.0", "-2.00", "no",
        "75.0%", "0.50",
    )  # fmt: skip
    assert rows[3] == (
        "d", "small", "none", "no", "-", "-", "-", "-", "-", "-", "-", "0.0%", "0.50",
    )  # fmt: skip
    assert rows[4] == (
        "all linear", "linear", "1/2 right", "2/2", "1.875", "18.75", "37.50",
        "3.000", "3.0", "1.50", "1/2", "80.0%", "0.75",
    )  # fmt: skip
    assert [cells[0] for cells in rows[4:]] == ["all linear", "all small", "all static", "all"]
    assert notes(floor)[1:] == ["d: rejected: too few points; cuts"]


def test_the_seconds_are_of_all_stages(tmp_path):
    """Those of the background's lines were not counted."""
    for name in ("masks", "people", "sfm", "lines", "pseudo_gt"):
        run_stage(name, tmp_path / name, Config(), {}, lambda _: None)
        record = read_json(tmp_path / name / "stage.json")
        write_json(tmp_path / name / "stage.json", record | {"seconds": 2.0})
    assert _seconds(tmp_path) == 10.0
