"""The whole path on real motions, small: done twice, killed at random moments, and what it made
given to the other verbs.  One finished demo serves all tests."""

import json
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from gmrdata.cli.demo_recipe import DemoPaths
from gmrdata.manifest.check import check_manifest
from gmrdata.values.clip import load_clip
from gmrdata.values.files import read_json
from tests.cli.small_demos import TINY, demo_arguments, start_gmrdata
from tests.fixtures.command_line import fails_cleanly

pytestmark = pytest.mark.slow


def test_figures_meet_the_bars_for_small_pictures(finished):
    summary = json.loads(finished.summary.read_text())
    assert [clip["id"] for clip in summary["clips"]] == ["circular", "linear", "panning"]
    for clip in summary["clips"]:
        assert clip["frames_with_camera"] == clip["frames"] >= 15
        assert clip["ome_deg"] <= 0.5
        assert clip["tme_mm"] <= 15
        if clip["id"] != "panning":
            assert abs(clip["scale_error_percent"]) <= 8
    assert set(summary["gmr"]) == {"synthetic", "pseudo_gt"}
    assert set(summary["seconds"]) >= {"render", "cameras", "train"}


def test_manifests_are_good_and_the_report_is_there(finished):
    for manifest in (
        finished.training_manifest,
        finished.synthetic_manifest,
        finished.pseudo_gt_manifest,
    ):
        check_manifest(manifest)
        assert "workers" not in manifest.read_text()
    assert finished.report.stat().st_size > 100_000
    assert finished.overview.read_bytes()[:4] == b"\x89PNG"


def test_a_second_run_makes_nothing_anew(finished, recipe_path, cmu_dir, works):
    before = {path: path.stat().st_mtime_ns for path in finished.root.rglob("stage.json")}
    said = works(*demo_arguments(finished.root, recipe_path, cmu_dir))
    assert str(finished.report)[-20:] in said.stdout.replace("\n", "")
    assert {path: path.stat().st_mtime_ns for path in finished.root.rglob("stage.json")} == before
    assert len(before) > 15
    dry = works(*demo_arguments(finished.root, recipe_path, cmu_dir), "--dry-run").stdout
    assert (dry.count(" done "), dry.count("to do")) == (11, 0)


def test_another_recipe_is_refused_and_leaves_what_is_there(
    finished, recipe_path, cmu_dir, tmp_path, gmrdata
):
    before = finished.recipe.read_bytes()
    other = tmp_path / "other.yaml"
    other.write_text(recipe_path.read_text() + "seed: 5\n")
    answer = gmrdata(*demo_arguments(finished.root, other, cmu_dir))
    fails_cleanly(answer, "config.seed", "--redo")
    assert finished.recipe.read_bytes() == before
    asked = (*demo_arguments(finished.root, other, cmu_dir), "--dry-run")
    dry, again = gmrdata(*asked).stdout, gmrdata(*asked, "--redo").stdout
    assert (dry.count("config.seed"), dry.count("to do")) == (1, 9)
    assert (again.count("config.seed"), again.count("to do")) == (0, 10)


def unfinished(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.partial")


def kill_while(process: subprocess.Popen[str], at_work: Callable[[], bool]) -> None:
    """Kill a process as soon as it is at a piece of work, which it must not miss."""
    while not at_work() and process.poll() is None:
        time.sleep(0.02)
    assert process.poll() is None, "it ended before it was killed"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL


def test_killed_at_random_moments_it_ends_with_the_same_manifests(cmu_dir, tmp_path, works):
    """Killed among the frames, in a stage of the world motion, and while it trains."""
    recipe = tmp_path / "tiny.yaml"
    recipe.write_text(yaml.safe_dump(TINY))
    works(*demo_arguments(tmp_path / "undisturbed", recipe, cmu_dir))

    paths, rng = DemoPaths(tmp_path / "killed"), np.random.default_rng(20211)
    clip, n_frames = paths.clip("panning"), rng.integers(1, 7)
    regenerated = rng.choice([clip.masks_dir, clip.sfm_dir])
    killed = demo_arguments(paths.root, recipe, cmu_dir)

    masks = unfinished(clip.render_dir) / "masks"
    kill_while(start_gmrdata(killed), lambda: len(list(masks.glob("*.png"))) >= n_frames)
    kill_while(start_gmrdata(killed), unfinished(regenerated).exists)
    kept_step = unfinished(paths.gmr_dir) / "checkpoints" / "latest"
    kill_while(start_gmrdata(killed), kept_step.exists)
    works(*killed)
    for name in ("training.yaml", "synthetic.yaml", "pseudo_gt.yaml"):
        undisturbed = (tmp_path / "undisturbed" / name).read_bytes()
        assert (paths.root / name).read_bytes() == undisturbed, name
    assert not list(paths.root.rglob("*.partial"))


def test_sfm_regenerates_one_sequence_as_the_demo_did(finished, works, tmp_path):
    answer = works(
        "sfm",
        finished.clip("panning").frames_dir,
        *("--camera-body", finished.clip("panning").seen),
        *("--masks", finished.clip("panning").masks_dir),
        *("--body", finished.body),
        *("--out", tmp_path / "out"),
    )
    out = tmp_path / "out"
    assert answer.stdout.split() == [str(out / "pseudo_gt"), str(out / "index.html")]
    made = load_clip(tmp_path / "out" / "pseudo_gt" / "person_0.npz")
    before = load_clip(finished.clip("panning").pseudo)
    np.testing.assert_array_equal(made.motion.root_rotmats, before.motion.root_rotmats)


def test_sfm_unites_the_silhouette_with_a_detector(finished, works, shared_path, tmp_path):
    model, out = shared_path("models/yolox_nano.onnx"), tmp_path / "out"
    works(
        "sfm",
        finished.clip("panning").frames_dir,
        *("--camera-body", finished.clip("panning").seen),
        *("--masks", "silhouette", "onnx", "--detector", model),
        *("--body", finished.body),
        *("--out", out),
    )
    shares = read_json(out / "masks" / "masks.json")
    assert shares["sources"] == ["silhouette", "onnx"]
    # The detector sees the rendered person too, and a box covers more than a silhouette.
    assert all(s["onnx"] > s["silhouette"] for s in shares["masked_share"].values())
    quality = read_json(out / "sfm" / "quality.json")
    assert quality["frames_with_camera"] == len(shares["masked_share"])
    assert quality["geometry"] == "rotation_only"


def test_sfm_names_the_frame_that_is_missing_or_broken(finished, gmrdata, tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    for path in sorted(finished.clip("panning").frames_dir.glob("*.jpg")):
        (frames / path.name).write_bytes(path.read_bytes())
    common = ("--camera-body", finished.clip("panning").seen, "--body", finished.body)
    (frames / "00007.jpg").write_bytes(b"")
    answer = gmrdata("sfm", frames, *common, "--out", tmp_path / "a")
    fails_cleanly(answer, "00007.jpg")
    (frames / "00007.jpg").unlink()
    answer = gmrdata("sfm", frames, *common, "--out", tmp_path / "b")
    fails_cleanly(answer, "7")
    assert not (tmp_path / "a" / "sfm").exists() and not (tmp_path / "b" / "masks").exists()


def test_train_and_evaluate(finished, gmrdata, works, tmp_path):
    recipe = tmp_path / "tiny.yaml"
    train = {"model": {"layers": 1, "hidden": 8}, "steps": 5, "batch_size": 2}
    train["loss"] = {"n_vertices": 20}
    recipe.write_text(yaml.safe_dump({"recipe": "gmr", "train": train}))
    run_dir = tmp_path / "run"
    answer = works(
        *("train", finished.training_manifest, "--out", run_dir),
        *("--recipe", recipe, "--body", finished.body),
    )
    scores_dir = tmp_path / "scores"
    answer = works(
        *("evaluate", run_dir, finished.pseudo_gt_manifest, "--out", scores_dir),
        *("--body", finished.body),
    )
    scores = read_json(scores_dir / "scores.json")
    assert [clip["id"] for clip in scores["clips"]] == ["circular", "linear", "panning"]
    ours = scores["overall"]["pooled_over_motions"]["predicted"]
    assert f"{ours['tme_mm']:.1f}" in answer.stdout
    other = ("evaluate", run_dir, finished.training_manifest, "--out", scores_dir)
    fails_cleanly(gmrdata(*other, "--body", finished.body), "inputs.manifest")


def test_a_recipe_trains_and_scores(finished, works, tmp_path):
    recipe = finished.root / "tiny_gmr.yaml"
    record = {
        "recipe": "gmr",
        "training": ["training.yaml"],
        "scored": ["synthetic.yaml"],
        "body": "body/body.npz",
        "train": {"model": {"layers": 1, "hidden": 8}, "loss": {"n_vertices": 20}, "steps": 3},
    }
    recipe.write_text(yaml.safe_dump(record))
    works("run", recipe, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "scores" / "synthetic" / "scores.json").is_file()


def test_the_report_can_be_written_again(finished, works, tmp_path):
    """In a folder whose name was taken for a sign of italics, so that its path was not said."""
    paths = DemoPaths(tmp_path / "[i]out")
    shutil.copytree(finished.root, paths.root)
    before = paths.report.read_bytes()
    paths.report.unlink()
    answer = works("report", paths.root)
    assert paths.report.read_bytes() == before
    assert "circular" in answer.stdout and f"{paths.report}, and in 3D" in answer.stdout
