"""Runs compared on their common clips, with bootstrap intervals."""

import csv
import html
import itertools
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import bootstrap

from gmrdata.pages.scores import write_comparison_page
from gmrdata.score import METRICS
from gmrdata.score.compare import CompareConfig, Comparison, compare
from gmrdata.score.protocols import PROTOCOLS, protocol_as
from gmrdata.score.records import PaperMetrics, Protocol
from gmrdata.score.summary import (
    mean_intervals,
    paired_difference,
    ratio_interval,
    resampled_counts,
)
from gmrdata.score.table import FEW_CLIPS
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
    protocol_fps_hz: float = 30.0,
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
            protocol_fps_hz=protocol_fps_hz if protocol else None,
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


def test_differences_are_taken_clip_by_clip(tmp_path):
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


def test_its_files(tmp_path):
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
    assert "a smaller error, but for jitter and Accel" in text
    assert "left out of paper: only_a" in text and "left out of paper: only_a" in page
    assert page.count("<svg") == 1 and "ours against paper" not in page.split("<body>")[0]
    before = page.encode()
    write_comparison_page(compare(paths, tmp_path / "again"), paths)
    assert (tmp_path / "again" / "comparison.html").read_bytes() == before
    with pytest.raises(StaleOutput):
        compare(paths[:2], out)


def test_a_protocol_is_compared_where_all_have_it(tmp_path):
    wham, tram = of_protocol("wham", "rte_percent"), PROTOCOLS["tram"]
    values = {"x": 10.0, "yy": 20.0}
    paths = [
        write_scores(tmp_path / name, values, name, protocol=protocol)
        for name, protocol in (("a", wham), ("b", wham), ("c", tram))
    ]
    assert "rte_percent" in compared(paths[:2], tmp_path / "same")["metrics"]
    found = compared(paths, tmp_path / "other")
    assert found["protocol"] is None and "rte_percent" not in found["metrics"]
    said = "Protocols differ and are left out: a by wham, b by wham, c by tram. Score all by one."
    assert found["protocol_left_out"] == said
    switched = protocol_as("wham", ("gaps",))
    paths[2] = write_scores(tmp_path / "d", values, "d", protocol=switched)
    assert "d by wham --original gaps" in compared(paths, tmp_path / "gaps")["protocol_left_out"]


def test_a_run_with_a_protocol_is_compared_with_one_without(tmp_path):
    """It ended in a TypeError: without a protocol there is no rate of its frames."""
    wham, values = of_protocol("wham", "rte_percent"), {"x": 10.0, "yy": 20.0}
    with_it = write_scores(tmp_path / "a", values, "a", protocol=wham)
    without = write_scores(tmp_path / "b", values, "b")
    for paths, said in (
        ((with_it, without), "a by wham, b by none"),
        ((without, with_it), "b by none, a by wham"),
    ):
        found = compared(list(paths), tmp_path / said)
        assert found["protocol"] is None and set(found["metrics"]) == set(METRICS)
        whole = f"Protocols differ and are left out: {said}. Score all by one."
        assert found["protocol_left_out"] == whole


def test_a_protocol_is_compared_at_one_rate(tmp_path):
    """Every third row of one prediction had another RTE, and a p-value beside it."""
    wham, values = of_protocol("wham", "rte_percent"), {"x": 10.0, "yy": 20.0}
    paths = [
        write_scores(tmp_path / name, values, name, protocol=wham, protocol_fps_hz=fps_hz)
        for name, fps_hz in (("a", 30.0), ("b", 30.0), ("c", 10.0))
    ]
    assert compared(paths[:2], tmp_path / "same")["protocol_left_out"] is None
    found = compared(paths, tmp_path / "other")
    assert found["protocol"] is None and "rte_percent" not in found["metrics"]
    nothing = [
        write_scores(tmp_path / f"gmr_{fps_hz:g}", values, protocol=of_protocol("gmr"),
                     protocol_fps_hz=fps_hz) for fps_hz in (30.0, 10.0)
    ]  # fmt: skip
    assert compared(nothing, tmp_path / "gmr")["protocol_left_out"] is None, "it measures nothing"
    said = "clip x has 30 fps in a, 30 fps in b, 10 fps in c"
    assert said in found["protocol_left_out"]
    write_comparison_page(tmp_path / "other" / "comparison.json", paths)
    for name in ("comparison.md", "comparison.html"):
        assert said in (tmp_path / "other" / name).read_text()


def test_a_third_run_changes_nothing_between_two(tmp_path):
    """Intervals and p are drawn: of one pair of runs they were others where a third stood by."""
    rng = np.random.default_rng(4)
    paths = [
        write_scores(tmp_path / one, {f"clip_{n:02d}": rng.gamma(4.0) for n in range(15)}, one)
        for one in ("a", "b", "c")
    ]
    of_two, of_three = (compared(paths[:n], tmp_path / str(n))["metrics"] for n in (2, 3))
    assert of_two == {metric: rows[:2] for metric, rows in of_three.items()}
    assert 0 < of_two["tme_mm"][1]["p_value"] < 1


def test_the_order_of_clips_changes_no_difference(tmp_path):
    rng = np.random.default_rng(4)
    values = [{f"clip_{n:02d}": rng.gamma(4.0) for n in range(15)} for _ in range(2)]
    turned = [dict(reversed(one.items())) for one in values]
    one, other = (
        compared(
            [write_scores(tmp_path / name / str(n), by_id) for n, by_id in enumerate(both)],
            tmp_path / f"{name}_out",
        )
        for name, both in (("as_is", values), ("turned", turned))
    )
    assert one == other


def test_a_protocol_is_compared_on_the_same_frames(tmp_path):
    """One prediction without the last frame had another WA-MPJPE, 1.7 mm off itself."""
    wham, values = of_protocol("wham", "wa_mpjpe_mm"), {"x": 10.0, "yy": 20.0}
    paths = [write_scores(tmp_path / one, values, one, protocol=wham) for one in ("a", "b")]
    assert compared(paths, tmp_path / "same")["protocol_left_out"] is None
    shorter = read_json(paths[1])
    shorter["clips"][1]["protocol"]["zero"]["wa_mpjpe_mm"] = 50.001
    write_json(paths[1], shorter)
    found = compared(paths, tmp_path / "other")
    assert found["protocol_left_out"] == (
        "Protocol wham is left out: clip yy has other frames in b than in a, or begins anew after "
        "gaps in one of them. Give all as files of one folder, with --missing drop."
    )
    assert found["protocol"] is None and set(found["metrics"]) == set(METRICS)


def test_what_single_runs_know_is_said(tmp_path, works):
    """That a run knew the camera, or its network the clips, stood in its own scores alone."""
    paths = [write_scores(tmp_path / name, {"x": 1.0, "yy": 2.0}, name) for name in ("a", "b")]
    known, known_by = read_json(paths[1]), "The network was trained on this manifest."
    clips = [known["clips"][0], known["clips"][1] | {"took_true_camera": True}]
    write_json(paths[1], known | {"clips": clips, "statements": [known_by]})
    words = works("compare", *paths, "--out", tmp_path / "out").stdout
    camera = "b: 1 predictions are in the camera's frame, without a camera."
    pages = (tmp_path / "out" / name for name in ("comparison.md", "comparison.html"))
    for said in (words, *(html.unescape(page.read_text()) for page in pages)):
        said = " ".join(said.split())
        assert f"b: {known_by}" in said and camera in said
    comparison = read_json(tmp_path / "out" / "comparison.json")
    assert [line[:3] for line in comparison["statements"]] == ["b: ", "b: "]


def test_runs_of_one_name_are_told_apart(tmp_path):
    values = {"x": 1.0, "yy": 2.0}
    paths = [write_scores(tmp_path / folder, values) for folder in ("a", "b", "c/b")]
    assert compared(paths[:2], tmp_path / "2")["runs"] == ["run (a)", "run (b)"]
    assert compared(paths, tmp_path / "3")["runs"] == ["run (a)", "2: run (b)", "3: run (b)"]
    named = compared(paths[:2], tmp_path / "named", names=("old", "new"))
    assert named["runs"] == ["old", "new"]
    with pytest.raises(BadRecord, match="2 names for 3 runs"):
        compared(paths, tmp_path / "bad", names=("old", "new"))


def test_what_can_not_be_compared_is_refused(tmp_path):
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
    with pytest.raises(BadRecord, match="30 fps"):
        compare([first, refused["30 fps"].parent], tmp_path / "out")
    with pytest.raises(MissingInput, match=f"^{tmp_path / 'scores.json'}: no such file$"):
        compare([first, tmp_path], tmp_path / "out")
    with pytest.raises(MissingInput, match="fewer than two"):
        compare([first], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_verb(tmp_path, works, monkeypatch):
    monkeypatch.setattr(answers, "width", 200)  # a narrow table breaks its rows
    answer = works("compare", *three(tmp_path), "--out", tmp_path / "out")
    said = " ".join(answer.stdout.split())
    assert "TME [mm] ours 18.0 -2.0 -3.0 to -1.0 0.250 3" in said
    assert said.endswith("comparison.json")


def test_folders_of_scores_are_taken_for_the_scores_in_them(tmp_path, works):
    folders = []
    for path in three(tmp_path):
        folders.append(path.with_suffix(""))
        folders[-1].mkdir()
        path.rename(folders[-1] / "scores.json")
    works("compare", *folders, "--out", tmp_path / "out")
    assert len(Comparison.read(tmp_path / "out" / "comparison.json").runs) == 3
    assert (tmp_path / "out" / "comparison.html").is_file()


RESAMPLES = 500


def test_interval_of_a_mean_is_scipys():
    """The same generator draws the same clips, so the ends are the same numbers."""
    values = np.random.default_rng(3).gamma(2.0, 2.0, 12)
    oracle = bootstrap(
        (values,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=np.random.default_rng(0)
    ).confidence_interval
    counts = resampled_counts(12, RESAMPLES, np.random.default_rng(0))
    assert ratio_interval(values, np.ones(12), counts) == pytest.approx(tuple(oracle), rel=1e-9)
    columns = mean_intervals(np.stack([values, 2 * values], axis=1), counts)
    assert columns is not None
    np.testing.assert_allclose(columns, np.outer(tuple(oracle), [1, 2]), rtol=1e-9)


def test_interval_of_a_pooled_mean_is_scipys():
    """Clips of other lengths: a ratio of two sums, drawn together."""
    rng = np.random.default_rng(4)
    sums, weights = rng.gamma(5.0, 2.0, 9), rng.integers(1, 40, 9).astype(float)
    oracle = bootstrap(
        (sums, weights),
        lambda a, b, axis: a.sum(axis=axis) / b.sum(axis=axis),
        n_resamples=RESAMPLES,
        method="percentile",
        paired=True,
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    found = ratio_interval(sums, weights, resampled_counts(9, RESAMPLES, np.random.default_rng(0)))
    assert found == pytest.approx(tuple(oracle), rel=1e-9)
    found = ratio_interval(sums, weights, resampled_counts(9, 20_000, np.random.default_rng(1)))
    assert found == pytest.approx(tuple(oracle), rel=0.1)


@settings(max_examples=20)
@given(st.integers(2, 12), st.integers(0, 1000))
def test_each_resample_draws_as_many_clips_as_there_are(n_clips, seed):
    counts = resampled_counts(n_clips, 50, np.random.default_rng(seed))
    assert counts.shape == (50, n_clips) and (counts.sum(axis=1) == n_clips).all()


def test_one_clip_has_no_interval():
    counts = resampled_counts(1, 100, np.random.default_rng(0))
    assert ratio_interval(np.array([3.0]), np.ones(1), counts) is None
    counts = resampled_counts(3, 100, np.random.default_rng(0))
    assert ratio_interval(np.array([3.0, 0, 0]), np.array([2.0, 0, 0]), counts) is None
    assert mean_intervals(np.array([[1.0, 2.0]]), counts[:, :1]) is None


def test_intervals_of_few_clips_hold_the_mean_as_often_as_is_said():
    """They are called 95 %, so it is said that they are less."""
    rng = np.random.default_rng(0)
    counts = resampled_counts(5, 1000, rng)
    values = rng.gamma(4.0, 2.5, (1000, 5))
    intervals = np.array([ratio_interval(one, np.ones(5), counts) for one in values])
    held = (intervals[:, 0] <= 10) & (intervals[:, 1] >= 10)
    assert held.mean() == pytest.approx(0.8, abs=0.03)
    assert "those of 5 hold the true mean about 8 times in 10" in FEW_CLIPS


def test_clips_without_a_figure_do_not_count():
    counts = resampled_counts(3, 200, np.random.default_rng(0))
    low, high = ratio_interval(np.array([2.0, 6.0, 0.0]), np.array([1.0, 1.0, 0.0]), counts) or (
        0,
        0,
    )
    assert (low, high) == (2.0, 6.0)


def runs_compared(first: list[float], other: list[float], seed: int = 0):  # type: ignore[no-untyped-def]
    return paired_difference(
        np.array(first), np.array(other), 500, 9999, np.random.default_rng(seed)
    )


def test_four_clips_that_all_got_better():
    """Of the 16 ways to give the signs, two have a mean as far from 0."""
    found = runs_compared([4.0, 5.0, 6.0, 7.0], [3.0, 4.5, 5.0, 5.0])
    assert found.n_clips == 4
    assert found.difference == pytest.approx(-(1 + 0.5 + 1 + 2) / 4)
    assert found.p_value == pytest.approx(2 / 16)
    assert found.interval95 is not None
    assert -2 <= found.interval95[0] < found.interval95[1] <= -0.5


def test_p_is_the_share_of_all_sign_flips():
    rng = np.random.default_rng(2)
    first, other = rng.normal(5, 1, (2, 9))
    differences = other - first
    means = [np.mean(differences * signs) for signs in itertools.product((1, -1), repeat=9)]
    expected = np.mean(np.abs(means) >= abs(differences.mean()) - 1e-12)
    assert runs_compared(list(first), list(other)).p_value == pytest.approx(expected)


def test_many_clips_take_no_more_memory_than_some():
    """Permutations of 10,000 clips took 7 GB."""
    first, other = np.random.default_rng(3).normal(5, 1, (2, 4000))
    tracemalloc.start()
    try:
        found = paired_difference(first, other, 100, 1999, np.random.default_rng(0))
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.p_value == pytest.approx(0.4)
    assert peak_bytes < 100e6


def test_runs_that_are_the_same_do_not_differ():
    found = runs_compared([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert (found.difference, found.interval95, found.p_value) == (0.0, (0.0, 0.0), 1.0)


def test_one_clip_says_nothing():
    found = runs_compared([1.0], [3.0])
    assert (found.difference, found.interval95, found.p_value) == (2.0, None, None)


def test_the_same_seed_gives_the_same_numbers():
    rng = np.random.default_rng(5)
    first, other = (list(values) for values in rng.normal(5, 1, (2, 30)))
    assert runs_compared(first, other, 1) == runs_compared(first, other, 1)
