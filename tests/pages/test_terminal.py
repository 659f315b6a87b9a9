"""The terminal shows the page's figures within 80 columns."""

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from gmrdata.pages.report import summary_table
from gmrdata.pages.report_data import (
    ClipFigures,
    ReportData,
    Summary,
    figure_texts,
    summary,
    verdicts,
)


def printed(figures: Summary, width: int = 80) -> str:
    stream = StringIO()
    Console(file=stream, width=width, color_system=None).print(summary_table(figures))
    return stream.getvalue()


def test_summary_holds_the_figures_and_survives_json(report: ReportData, tmp_path: Path) -> None:
    summary(report).write(tmp_path / "summary.json")
    assert Summary.read(tmp_path / "summary.json") == summary(report)
    figures = json.loads((tmp_path / "summary.json").read_text())
    assert figures["clips"][0] == {
        "id": "walk_circular",
        "camera_motion": "circular",
        "ome_deg": 0.1234,
        "tme_mm": 4.567,
        "camera_rotation_deg": 0.0567,
        "scale_error_percent": -1.234,
        "frames": 12,
        "frames_with_camera": 12,
    }
    assert figures["clips"][2]["scale_error_percent"] is None
    assert figures["gmr"]["truth"] == {
        "ome_deg": 3.21, "tme_mm": 43.2, "vme_mm": 54.3,
        "zero_motion": {"ome_deg": 7.65, "tme_mm": 120.1, "vme_mm": 130.2},
    }  # fmt: skip
    assert figures["seconds"] == {"render": 61.25, "reconstruct": 40.5, "train": 12.0}


def test_rows_show_every_figure(report: ReportData) -> None:
    lines = printed(summary(report)).splitlines()
    row = next(line for line in lines if "walk_circular" in line)
    assert row.split() == ["walk_circular", "12/12", "0.123", "4.57", "0.057", "−1.23"]
    assert any("walk_panning" in line and "not observable (pan)" in line for line in lines)
    row = next(line for line in lines if line.strip().startswith("truth"))
    assert row.split() == ["truth", "3.21", "(7.65)", "43.2", "(120.1)", "54.3", "(130.2)"]
    assert "114 s in all: render 61 s · reconstruct 40 s · train 12 s" in lines[-1]


def test_long_names_and_bad_figures_fit_into_80_columns(report: ReportData) -> None:
    found = summary(report)
    long = {
        "id": "a_clip_with_a_name_that_goes_on_and_on_and_on",
        "ome_deg": 123.456,
        "tme_mm": 98765.4,
        "camera_rotation_deg": 179.9,
        "frames": 1000,
        "frames_with_camera": 999,
    }
    clips = (*found.clips[:2], found.clips[2].model_copy(update=long))
    gmr = {"a manifest with a long name " * 4: found.gmr["truth"]}
    text = printed(found.model_copy(update={"clips": clips, "gmr": gmr}))
    assert max(map(len, text.splitlines())) <= 80
    for figure in ("999/1000", "123.456", "98765.40", "179.900", "not observable (pan)", "(130.2)"):
        assert figure in text


def test_names_are_not_markup(report: ReportData) -> None:
    clips = (replace(report.clips[0], id="[red]x[/red]"),)
    assert "[red]x[/red]" in printed(summary(replace(report, clips=clips)))


def test_parts_that_are_missing_are_left_out(report: ReportData) -> None:
    text = printed(summary(replace(report, scores={}, run=replace(report.run, seconds={}))))
    assert "GMR" not in text
    assert "in all" not in text


GOOD = ClipFigures(
    ome_deg=0.1, tme_mm=1.0, camera_rotation_deg=0.1, scale_error_percent=0.0,
    frames=48, frames_with_camera=48,
)  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "missed"),
    [
        ({}, set()),
        ({"ome_deg": 0.5, "tme_mm": 15.0, "scale_error_percent": 5.0}, set()),
        ({"scale_error_percent": -5.001}, {"scale_error_percent"}),
        ({"ome_deg": float("nan")}, {"ome_deg"}),
        ({"frames_with_camera": 47}, {"frames_with_camera"}),
        ({"tme_mm": 15.001}, {"tme_mm"}),
    ],
)
def test_thresholds(changed: dict[str, float], missed: set[str]) -> None:
    met = verdicts(GOOD.model_copy(update=changed))
    assert {key for key, good in met.items() if not good} == missed


def test_a_scale_that_does_not_enter_has_no_verdict() -> None:
    unknown = {"camera_rotation_deg": None, "scale_error_percent": None}
    figures = GOOD.model_copy(update=unknown)
    assert "scale_error_percent" not in verdicts(figures)
    texts = figure_texts(figures)
    assert texts["scale_error_percent"] == "not observable (pan)"
    assert texts["camera_rotation_deg"] == "–"
