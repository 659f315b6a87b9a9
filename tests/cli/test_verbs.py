"""The verbs that take what a demo has made."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from gmrdata.cli.demo_recipe import DemoPaths
from gmrdata.values.clip import load_clip
from gmrdata.values.files import read_json

pytestmark = pytest.mark.slow
Finished = tuple[DemoPaths, str]


def gmrdata(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_sfm_regenerates_one_sequence_as_the_demo_did(finished: Finished, tmp_path: Path) -> None:
    paths, _ = finished
    answer = gmrdata(
        "sfm",
        *("--frames", paths.clip("panning").frames_dir),
        *("--camera-body", paths.clip("panning").seen),
        *("--masks", paths.clip("panning").masks_dir),
        *("--body", paths.body),
        *("--out", tmp_path / "out"),
    )
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.strip() == str(tmp_path / "out" / "pseudo_gt")
    made = load_clip(tmp_path / "out" / "pseudo_gt" / "person_0.npz")
    before = load_clip(paths.clip("panning").pseudo)
    np.testing.assert_array_equal(made.motion.root_rotmats, before.motion.root_rotmats)


def test_sfm_unites_the_silhouette_with_a_detector(
    finished: Finished, shared_path: Callable[[str], Path], tmp_path: Path
) -> None:
    paths, _ = finished
    model, out = shared_path("models/yolox_nano.onnx"), tmp_path / "out"
    answer = gmrdata(
        "sfm",
        *("--frames", paths.clip("panning").frames_dir),
        *("--camera-body", paths.clip("panning").seen),
        *("--masks", "silhouette", "onnx", "--model", model),
        *("--body", paths.body),
        *("--out", out),
    )
    assert answer.returncode == 0, answer.stderr
    shares = read_json(out / "masks" / "masks.json")
    assert shares["sources"] == ["silhouette", "onnx"]
    # The detector sees the rendered person too, and a box covers more than a silhouette.
    assert all(s["onnx"] > s["silhouette"] for s in shares["masked_share"].values())
    quality = read_json(out / "sfm" / "quality.json")
    assert quality["frames_with_camera"] == len(shares["masked_share"])
    assert quality["geometry"] == "rotation_only"


def test_sfm_names_the_frame_that_is_missing_or_broken(finished: Finished, tmp_path: Path) -> None:
    paths, _ = finished
    frames = tmp_path / "frames"
    frames.mkdir()
    for path in sorted(paths.clip("panning").frames_dir.glob("*.jpg")):
        (frames / path.name).write_bytes(path.read_bytes())
    common = ("--camera-body", paths.clip("panning").seen, "--body", paths.body)
    (frames / "00007.jpg").write_bytes(b"")
    answer = gmrdata("sfm", "--frames", frames, *common, "--out", tmp_path / "a")
    assert (answer.returncode, "Traceback" in answer.stderr) == (1, False)
    assert "00007.jpg" in answer.stderr
    (frames / "00007.jpg").unlink()
    answer = gmrdata("sfm", "--frames", frames, *common, "--out", tmp_path / "b")
    assert (answer.returncode, "Traceback" in answer.stderr) == (1, False)
    assert "7" in answer.stderr
    assert not (tmp_path / "a" / "sfm").exists() and not (tmp_path / "b" / "masks").exists()


def test_train_and_evaluate(finished: Finished, tmp_path: Path) -> None:
    paths, _ = finished
    recipe = tmp_path / "tiny.yaml"
    train = {"model": {"layers": 1, "hidden": 8}, "steps": 5, "batch_size": 2}
    train["loss"] = {"n_vertices": 20}
    recipe.write_text(yaml.safe_dump({"recipe": "gmr", "train": train}))
    run_dir = tmp_path / "run"
    answer = gmrdata(
        *("train", paths.training_manifest, "--out", run_dir),
        *("--recipe", recipe, "--body", paths.body),
    )
    assert answer.returncode == 0, answer.stderr
    scores_dir = tmp_path / "scores"
    answer = gmrdata(
        *("evaluate", run_dir, paths.pseudo_gt_manifest, "--out", scores_dir),
        *("--body", paths.body),
    )
    assert answer.returncode == 0, answer.stderr
    scores = read_json(scores_dir / "scores.json")
    assert [clip["id"] for clip in scores["clips"]] == ["circular", "linear", "panning"]
    ours = scores["overall"]["pooled_over_motions"]["predicted"]
    assert f"{ours['tme_mm']:.1f}" in answer.stdout
    refused = gmrdata(
        *("evaluate", run_dir, paths.training_manifest, "--out", scores_dir),
        *("--body", paths.body),
    )
    assert refused.returncode == 1 and "inputs.manifest" in refused.stderr


def test_a_recipe_trains_and_scores(finished: Finished, tmp_path: Path) -> None:
    paths, _ = finished
    recipe = paths.root / "tiny_gmr.yaml"
    record = {
        "recipe": "gmr",
        "training": ["training.yaml"],
        "scored": ["synthetic.yaml"],
        "body": "body/body.npz",
        "train": {"model": {"layers": 1, "hidden": 8}, "loss": {"n_vertices": 20}, "steps": 3},
    }
    recipe.write_text(yaml.safe_dump(record))
    answer = gmrdata("run", recipe, "--out", tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "out" / "scores" / "synthetic" / "scores.json").is_file()


def test_the_report_can_be_written_again(finished: Finished) -> None:
    paths, _ = finished
    before = paths.report.read_bytes()
    paths.report.unlink()
    answer = gmrdata("report", paths.root)
    assert answer.returncode == 0, answer.stderr
    assert paths.report.read_bytes() == before
    assert "circular" in answer.stdout
