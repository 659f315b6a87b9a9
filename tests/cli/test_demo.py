"""The whole path on real motions, small; done twice, and killed at random moments."""

import json
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gmrdata.cli.demo_recipe import DemoPaths
from gmrdata.manifest.check import check_manifest

pytestmark = pytest.mark.slow

Start = Callable[[Path, Path, Path], subprocess.Popen[str]]
Finish = Callable[[subprocess.Popen[str]], str]


def test_figures_meet_the_bars_for_small_pictures(finished: tuple[DemoPaths, str]) -> None:
    paths, said = finished
    summary = json.loads(paths.summary.read_text())
    assert [clip["id"] for clip in summary["clips"]] == ["circular", "linear", "panning"]
    for clip in summary["clips"]:
        assert clip["frames_with_camera"] == clip["frames"] >= 15
        assert clip["ome_deg"] <= 0.5
        assert clip["tme_mm"] <= 15
        if clip["id"] != "panning":
            assert abs(clip["scale_error_percent"]) <= 8
    assert set(summary["gmr"]) == {"synthetic", "pseudo_gt"}
    assert set(summary["seconds"]) >= {"render", "cameras", "train"}
    assert str(paths.report)[-20:] in said.replace("\n", "")


def test_manifests_are_good_and_the_report_is_there(finished: tuple[DemoPaths, str]) -> None:
    paths, _ = finished
    for manifest in (paths.training_manifest, paths.synthetic_manifest, paths.pseudo_gt_manifest):
        check_manifest(manifest)
        assert "workers" not in manifest.read_text()
    assert paths.report.stat().st_size > 100_000
    assert paths.overview.read_bytes()[:4] == b"\x89PNG"


def test_a_second_run_makes_nothing_anew(
    finished: tuple[DemoPaths, str],
    recipe_path: Path,
    cmu_dir: Path,
    start_demo: Start,
    finish_demo: Finish,
) -> None:
    paths, _ = finished
    before = {path: path.stat().st_mtime_ns for path in paths.root.rglob("stage.json")}
    finish_demo(start_demo(paths.root, recipe_path, cmu_dir))
    assert {path: path.stat().st_mtime_ns for path in paths.root.rglob("stage.json")} == before
    assert len(before) > 15


def test_another_recipe_is_refused_and_leaves_what_is_there(
    finished: tuple[DemoPaths, str],
    recipe_path: Path,
    cmu_dir: Path,
    tmp_path: Path,
    start_demo: Start,
) -> None:
    paths, _ = finished
    before = paths.recipe.read_bytes()
    other = tmp_path / "other.yaml"
    other.write_text(recipe_path.read_text() + "seed: 5\n")
    process = start_demo(paths.root, other, cmu_dir)
    said, _ = process.communicate(timeout=300)
    assert (process.returncode, "Traceback" in said) == (1, False)
    assert "config.seed" in said and "--redo" in said
    assert paths.recipe.read_bytes() == before


def test_killed_at_random_moments_it_ends_with_the_same_manifests(
    finished: tuple[DemoPaths, str],
    recipe_path: Path,
    cmu_dir: Path,
    tmp_path: Path,
    start_demo: Start,
    finish_demo: Finish,
) -> None:
    paths, _ = finished
    out = tmp_path / "killed"
    rng = np.random.default_rng()
    for _ in range(3):
        process = start_demo(out, recipe_path, cmu_dir)
        time.sleep(rng.uniform(4, 30))
        process.send_signal(signal.SIGKILL)
        process.communicate()
    finish_demo(start_demo(out, recipe_path, cmu_dir))
    for name in ("training.yaml", "synthetic.yaml", "pseudo_gt.yaml"):
        assert (out / name).read_bytes() == (paths.root / name).read_bytes(), name
    assert not list(out.rglob("*.partial"))
