"""What docs/metrics.md says of each protocol, and what tables and plots make of odd scores."""

import json
from pathlib import Path
from typing import Any

import pytest

from gmrdata.pages.scores import scores_page
from gmrdata.score.protocols import ORIGINAL, PROTOCOLS
from gmrdata.score.records import Scores
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json_lines
from tests.score.score_records import clip_score, metrics, scores

PAGE = (Path(__file__).parents[2] / "docs" / "metrics.md").read_text()
ROWS = {
    "PA-MPJPE": ("pa_mpjpe_mm",),
    "MPJPE": ("mpjpe_mm",),
    "PVE (EMDB calls it MVE)": ("pve_mm",),
    "PA-PVE": ("pa_pve_mm",),
    "MPJAE, PA-MPJAE": ("mpjae_deg", "pa_mpjae_deg"),
    "Accel error, of the difference m/s²": ("accel_error_m_per_s2",),
    "Accel error, of the difference mm/frame²": ("accel_error_mm_per_frame2",),
    "Accel, the prediction's own": ("accel_mm_per_frame2",),
    "Accel length error": ("accel_length_error_mm_per_frame2",),
    "W-MPJPE, WA-MPJPE": ("w_mpjpe_mm", "wa_mpjpe_mm"),
    "RTE": ("rte_percent",),
    "ROE": ("roe_deg",),
    "ERVE": ("erve_mm_per_frame",),
    "jitter": ("jitter_10m_per_s3",),
    "foot sliding": ("foot_sliding_mm",),
    "ATE, ATE-S": ("ate_m", "ate_s_m"),
}


def table(heading: str) -> list[list[str]]:
    """Cells of the first table under a heading, its headings first."""
    lines = PAGE.partition(f"## {heading}")[2].partition("\n## ")[0].splitlines()
    rows = [line.strip("|").split("|") for line in lines if line.startswith("|")]
    end = next((i for i, row in enumerate(rows[2:], 2) if set(row[0].strip()) <= {"-"}), len(rows))
    return [[cell.strip() for cell in row] for row in (rows[0], *rows[2 : min(end, len(rows))])]


@pytest.mark.parametrize("name", [name for name in PROTOCOLS if PROTOCOLS[name].metrics])
def test_the_table_has_the_protocols_metrics(name: str) -> None:
    headings, *rows = table("Protocols and their metrics")
    column, said = headings.index(name), set()
    for row in rows:
        metrics = ROWS.get(row[0]) or ROWS.get(f"{row[0]} {row[1]}")
        if len(row) == len(headings) and metrics and row[column]:
            said |= set(metrics)
    assert said == set(PROTOCOLS[name].metrics)  # type: ignore[index]


def test_each_deviation_has_its_option_and_protocols() -> None:
    _, *rows = table("Deviations, and the option that switches each")
    said = {row[0].strip("`"): set(row[1].split(", ")) for row in rows if "--" not in row[0]}
    known: dict[str, set[str]] = {}
    for name, deviations in ORIGINAL.items():
        for one in deviations:
            known.setdefault(one, set()).add(name)
    assert said == known


def _changed(path: Path, **changes: Any) -> Path:
    scores([clip_score("a", metrics(1.0, 2.0, 3.0))]).write(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


@pytest.mark.parametrize("key", ["predicted", "zero"])
def test_ragged_curves(key: str, tmp_path: Path) -> None:
    path = _changed(tmp_path / "scores.json")
    content = json.loads(path.read_text())
    content["over_time"][key]["vertex_mm"].append(1.0)
    path.write_text(json.dumps(content))
    with pytest.raises(BadRecord, match=f"scores.json: `over_time` .*{key}` has 3 values for 2"):
        Scores.read(path)


@pytest.mark.parametrize("name", ["\ud800", "a\udfffb"])
def test_half_characters(name: str, tmp_path: Path) -> None:
    path = _changed(tmp_path / "scores.json", name=name)
    with pytest.raises(BadRecord, match=r"scores\.json: .* half of a surrogate pair"):
        Scores.read(path)


@pytest.mark.parametrize("name", ["$", "a $\\frac$ b", "$x^$", "_hidden", "é <b>"])
def test_names_are_shown_as_they_are(name: str, tmp_path: Path) -> None:
    page = scores_page(Scores.read(_changed(tmp_path / "scores.json", name=name)))
    shown = name.replace("<b>", "&lt;b&gt;")
    assert page.count(shown) >= 2  # in the heading and in the plot's legend


def test_lines_of_json(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"step": 1, "loss": 2.0}\n{"step": 2}\n')
    assert read_json_lines(path) == [{"step": 1, "loss": 2.0}, {"step": 2}]
    for junk in ("junk", "[1]", "\x00", '{"a": "\\ud800"}', "[" * 100_000):
        path.write_text('{"step": 1}\n' + junk)
        with pytest.raises(BadRecord, match=r"metrics\.jsonl:2: not a line of JSON"):
            read_json_lines(path)
