"""Runs compared on the clips that they have in common."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from gmrdata.cli import main
from gmrdata.pages.scores import write_comparison_page
from gmrdata.score.compare import CompareConfig, compare
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.score.records import PaperMetrics, Protocol
from gmrdata.stage.progress import answers
from gmrdata.values.errors import BadRecord, MissingInput, StaleOutput
from gmrdata.values.files import read_json, write_json
from tests.score.score_records import clip_score, metrics, of_protocol, scores


def figures(value: float) -> PaperMetrics[float]:
    return metrics(value / 10, value, 2 * value)


def write_scores(
    folder: Path,
    values: dict[str, float],
    name: str = "run",
    *,
    zero: float | None = None,
    protocol: Protocol | None = None,
    fps_hz: float = 10.0,
) -> Path:
    """Scores in which zero motion's depend on the clip alone."""
    measured = protocol.metrics if protocol else ()
    clips = [
        clip_score(
            id,
            figures(value),
            zero=figures(zero or float(len(id))),
            n_motions=10,
            world=dict.fromkeys(measured, value / 100) if protocol else None,
        )
        for id, value in values.items()
    ]
    path = folder / "scores.json"
    scores(clips, name=name, fps_hz=fps_hz, protocol=protocol).write(path)
    return path


def three(tmp_path: Path) -> list[Path]:
    return [
        write_scores(tmp_path / "a", {"x": 10.0, "yy": 20.0, "zzz": 30.0, "only_a": 99.0}, "paper"),
        write_scores(tmp_path / "b", {"zzz": 27.0, "x": 9.0, "yy": 18.0}, "ours"),
        write_scores(tmp_path / "c", {"x": 10.0, "yy": 21.0, "zzz": 29.0}, "third"),
    ]


def compared(paths: Sequence[Path], out: Path, **options: Any) -> dict[str, Any]:
    return dict(read_json(compare(paths, out, CompareConfig(**options))))


def test_differences_are_taken_clip_by_clip(tmp_path: Path) -> None:
    found = compared(three(tmp_path), tmp_path / "out")
    assert found["runs"] == ["paper", "ours", "third"]
    assert found["clips"] == ["x", "yy", "zzz"]
    assert found["left_out"] == {"paper": ["only_a"], "ours": [], "third": []}
    first, ours, third = found["metrics"]["tme_mm"]
    no_difference = dict.fromkeys(("difference", "interval95", "p_value"))
    assert first == {"run": "paper", "n_clips": 3, "mean_of_clips": 20.0} | no_difference
    assert (ours["mean_of_clips"], ours["difference"]) == (18.0, -2.0)
    # -1, -2 and -3 mm: all of one sign, which 2 of 8 flips are.
    assert ours["p_value"] == pytest.approx(0.25)
    assert -3 <= ours["interval95"][0] < ours["interval95"][1] <= -1
    assert third["difference"] == 0 and third["p_value"] == 1
    assert set(found["metrics"]) == {"ome_deg", "tme_mm", "vme_mm"}


def test_its_files(tmp_path: Path) -> None:
    paths, out = three(tmp_path), tmp_path / "out"
    compared(paths, out)
    write_comparison_page(out / "comparison.json", paths)
    with (out / "comparison.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 3 * 3
    assert rows[4]["metric"] == "tme_mm" and rows[4]["run"] == "ours"
    assert float(rows[4]["difference"]) == -2.0 and rows[3]["difference"] == ""
    page, text = (out / "comparison.html").read_text(), (out / "comparison.md").read_text()
    assert "| TME [mm] | ours | 18.0 | -2.0 |" in text
    assert "left out of paper: only_a" in text and "left out of paper: only_a" in page
    assert page.count("<svg") == 1 and "ours against paper" not in page.split("<body>")[0]
    before = page.encode()
    write_comparison_page(compare(paths, tmp_path / "again"), paths)
    assert (tmp_path / "again" / "comparison.html").read_bytes() == before
    with pytest.raises(StaleOutput):
        compare(paths[:2], out)


def test_a_protocol_is_compared_where_all_have_it(tmp_path: Path) -> None:
    wham, tram = of_protocol("wham", "rte_percent"), PROTOCOLS["tram"]
    values = {"x": 10.0, "yy": 20.0}
    paths = [
        write_scores(tmp_path / name, values, name, protocol=protocol)
        for name, protocol in (("a", wham), ("b", wham), ("c", tram))
    ]
    assert "rte_percent" in compared(paths[:2], tmp_path / "same")["metrics"]
    found = compared(paths, tmp_path / "other")
    assert found["protocol"] is None and "rte_percent" not in found["metrics"]


def test_runs_of_one_name_are_told_apart(tmp_path: Path) -> None:
    values = {"x": 1.0, "yy": 2.0}
    paths = [write_scores(tmp_path / folder, values) for folder in ("a", "b", "c/b")]
    assert compared(paths[:2], tmp_path / "2")["runs"] == ["run (a)", "run (b)"]
    assert compared(paths, tmp_path / "3")["runs"] == ["run (a)", "2: run (b)", "3: run (b)"]
    named = compared(paths[:2], tmp_path / "named", names=("old", "new"))
    assert named["runs"] == ["old", "new"]
    with pytest.raises(BadRecord, match="2 names for 3 runs"):
        compared(paths, tmp_path / "bad", names=("old", "new"))


def test_what_can_not_be_compared_is_refused(tmp_path: Path) -> None:
    values = {"x": 1.0, "yy": 2.0}
    first = write_scores(tmp_path / "a", values)
    older = tmp_path / "e" / "scores.json"
    write_json(older, read_json(first) | {"format": "gmrdata-scores/3"})
    refused = {
        "30 fps": write_scores(tmp_path / "b", values, fps_hz=30.0),
        "no clip is in all 2": write_scores(tmp_path / "c", {"other": 1.0}),
        "clip x was scored on other frames": write_scores(tmp_path / "d", {"x": 1.0}, zero=77.0),
        "`format` is 'gmrdata-scores/3', .* with --redo": older,
    }
    for message, path in refused.items():
        with pytest.raises(BadRecord, match=message):
            compare([first, path], tmp_path / "out")
    with pytest.raises(MissingInput, match="fewer than two"):
        compare([first], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_verb(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = three(tmp_path)
    monkeypatch.setattr(answers, "width", 200)  # a narrow table breaks its rows
    main(["compare", *map(str, paths), "--out", str(tmp_path / "out")])
    said = " ".join(capsys.readouterr().out.split())
    assert "TME [mm] ours 18.0 -2.0 -3.0 to -1.0 0.250 3" in said
    assert said.endswith("comparison.json")
