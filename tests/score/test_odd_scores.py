"""Scores of others: ragged curves, halves of characters, and names that plots read as formulas."""

import json
from pathlib import Path
from typing import Any

import pytest

from gmrdata.pages.scores import scores_page
from gmrdata.score.records import Scores
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json_lines
from tests.score.score_records import clip_score, metrics, scores


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
