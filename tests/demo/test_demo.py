"""The whole path on real motions, small; done twice, and killed at random moments."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from gmrdata.demo.paths import DemoPaths
from gmrdata.manifest.check import check_manifest

pytestmark = pytest.mark.slow

RECIPE = {
    "recipe": "demo",
    "workers": 3,
    "film": {"duration_s": 2.4, "max_frames": 26, "width_px": 480, "height_px": 270},
    "clips": [
        {"id": "circular", "gait": "walk", "programme": {"kind": "circular"}},
        {"id": "linear", "gait": "walk", "programme": {"kind": "linear"}},
        {"id": "panning", "gait": "walk", "programme": {"kind": "panning"}},
    ],
    "training": {"gait_count": 4, "gait_duration_s": 7.0, "max_files": 3},
    "render": {"samples": 2},
    "gmr": {
        "model": {"layers": 1, "hidden": 32},
        "loss": {"n_vertices": 50},
        "batch_size": 4,
        "steps": 40,
        "checkpoint_every": 10,
    },
}
TRIALS = ("02_03", "08_02", "05_01")


def start(out: Path, recipe: Path, motions: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", "demo"]
    command += ["--out", str(out), "--recipe", str(recipe), "--motions", str(motions)]
    command += ["--trials", *TRIALS]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=900)
    assert process.returncode == 0, said
    return said


@pytest.fixture(scope="module")
def recipe_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recipe") / "small.yaml"
    path.write_text(yaml.safe_dump(RECIPE))
    return path


@pytest.fixture(scope="module")
def finished(
    tmp_path_factory: pytest.TempPathFactory, recipe_path: Path, cmu_dir: Path
) -> tuple[DemoPaths, str]:
    out = tmp_path_factory.mktemp("demo") / "out"
    said = finish(start(out, recipe_path, cmu_dir))
    return DemoPaths(out), said


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
    assert paths.report.stat().st_size > 100_000
    assert paths.overview.read_bytes()[:4] == b"\x89PNG"


def test_a_second_run_makes_nothing_anew(
    finished: tuple[DemoPaths, str], recipe_path: Path, cmu_dir: Path
) -> None:
    paths, _ = finished
    before = {path: path.stat().st_mtime_ns for path in paths.root.rglob("stage.json")}
    finish(start(paths.root, recipe_path, cmu_dir))
    assert {path: path.stat().st_mtime_ns for path in paths.root.rglob("stage.json")} == before
    assert len(before) > 15


def test_killed_at_random_moments_it_ends_with_the_same_manifests(
    finished: tuple[DemoPaths, str], recipe_path: Path, cmu_dir: Path, tmp_path: Path
) -> None:
    paths, _ = finished
    out = tmp_path / "killed"
    rng = np.random.default_rng()
    for _ in range(3):
        process = start(out, recipe_path, cmu_dir)
        time.sleep(rng.uniform(4, 30))
        process.send_signal(signal.SIGKILL)
        process.communicate()
    finish(start(out, recipe_path, cmu_dir))
    for name in ("training.yaml", "synthetic.yaml", "pseudo_gt.yaml"):
        assert (out / name).read_bytes() == (paths.root / name).read_bytes(), name
    assert not list(out.rglob("*.partial"))
