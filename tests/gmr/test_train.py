"""Training from manifests, as a stage: killed, resumed, done once, and in two processes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from gmrdata.cli import main
from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.loop import own_part
from gmrdata.gmr.predict import load_gmr
from gmrdata.gmr.runs import scored_files, split_manifests
from gmrdata.gmr.steps import Processes
from gmrdata.gmr.train import train
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.manifest.current import Quality
from gmrdata.manifest.read import read_manifest
from gmrdata.paper import plan
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import Run
from gmrdata.values.errors import (
    BadCheckpoint,
    BadManifest,
    BadMotionFile,
    StaleOutput,
    TrainingDiverged,
)
from gmrdata.values.files import host_word, read_json, read_npz, sha256_of_file, write_npz
from tests.clip_manifests import write_clips
from tests.fixtures.command_line import fails_cleanly
from tests.folders import bytes_of
from tests.gmr.test_loop import lines_of

PROGRAM = """
import sys
from pathlib import Path
from gmrdata.gmr.train import TrainConfig, train
manifest, held_out, body, config, run_dir = sys.argv[1:]
train(
    [Path(manifest)],
    Path(run_dir),
    TrainConfig.model_validate_json(config),
    body_path=Path(body),
    held_out_paths=[Path(held_out)],
)
"""


@pytest.fixture
def manifest_path(make_clips, small_body, tmp_path) -> Path:
    return write_clips(tmp_path / "data", small_body, make_clips(2, 1))


@pytest.fixture
def held_out_path(make_clips, small_body, tmp_path) -> Path:
    return write_clips(tmp_path / "held_out", small_body, make_clips(1, 2))


def test_a_run_folder(manifest_path, body_path, small_config, tmp_path):
    run_dir = tmp_path / "run"
    paths = [manifest_path]
    assert train(paths, run_dir, small_config, body_path=body_path) == run_dir
    assert sorted(p.name for p in run_dir.iterdir()) == [
        "checkpoints",
        "metrics.jsonl",
        "stage.json",
    ]
    record = read_json(run_dir / "stage.json")
    assert record["config"] == small_config.model_dump(mode="json")
    assert record["config"]["seed"] == 7
    assert record["inputs"] == {
        "manifest_0": sha256_of_file(manifest_path),
        "body": sha256_of_file(body_path),
    }
    assert record["facts"]["processes"] == 1
    assert record["packages"].keys() >= {"torch", "roma", "numpy", "safetensors"}
    assert record["gmrdata"] and record["python"] and record["facts"]["machine"]
    gmr = load_gmr(run_dir)
    assert (gmr.step, gmr.fps_hz, gmr.model.config) == (12, 10.0, small_config.model)
    written = (run_dir / "stage.json").stat().st_mtime_ns
    train(paths, run_dir, small_config, body_path=body_path)
    assert (run_dir / "stage.json").stat().st_mtime_ns == written
    other = small_config.model_copy(update={"seed": 9})
    with pytest.raises(StaleOutput, match=r"config\.seed"):
        train(paths, run_dir, other, body_path=body_path)
    train(paths, run_dir, other, body_path=body_path, run=Run(redo=True))
    assert (run_dir / "stage.json").stat().st_mtime_ns != written


def test_rejected_clips_are_not_trained_on(
    make_clips, small_body, body_path, small_config, tmp_path
):
    rejected = Quality(verdict="rejected", reasons=("drift",))
    clips = make_clips(1, 3)
    path = write_clips(tmp_path / "bad", small_body, clips, {clips[0].id: rejected})
    with pytest.raises(BadManifest, match="no usable clips"):
        train([path], tmp_path / "run", small_config, body_path=body_path)


def test_clips_that_are_trained_on_do_not_choose_the_weights(
    manifest_path, body_path, small_config, tmp_path, capsys
):
    """One manifest for both was scored whole, and the best weights were those of what they knew."""
    held_out = {"body_path": body_path, "held_out_paths": [manifest_path]}
    run_dir = train([manifest_path], tmp_path / "run", small_config, **held_out)
    n_clips = len(read_manifest(manifest_path).clips)
    said = f"not scored: {n_clips} of {n_clips} held-out clips are trained on"
    assert said in capsys.readouterr().err
    assert not list(run_dir.rglob("best.safetensors"))


@pytest.mark.parametrize("fault", ["weight", "rate"])
def test_a_training_that_could_not_begin_leaves_nothing(
    fault, manifest_path, make_clips, small_body, body_path, small_config, tmp_path
):
    """Its frames were kept as a training that was begun, which asked for --redo once it was mended:
    where a manifest has no window, and where a clip can't be read."""
    clips = [one.take(slice(2)) for one in make_clips(1, 3)]
    short = write_clips(tmp_path / "short", small_body, clips)
    data = small_config.data.model_copy(update={"weights": (1.0, 1.0)})
    wrong = {"data": data} if fault == "weight" else {"windows": WindowConfig(fps_hz=50.0)}
    with pytest.raises((BadManifest, BadMotionFile)):
        config = small_config.model_copy(update=wrong)
        train([manifest_path, short], tmp_path / "run", config, body_path=body_path)
    assert not (tmp_path / "run.partial").exists()
    run_dir = train([manifest_path], tmp_path / "run", small_config, body_path=body_path)
    assert {path.name for path in run_dir.iterdir()} == {
        "checkpoints",
        "metrics.jsonl",
        "stage.json",
    }


def test_clips_of_several_frame_rates_are_trained_on_at_one(
    make_clips, small_body, body_path, small_config, tmp_path
):
    """20, 25 and 120 Hz mix; a lower rate than the network's would need frames made up."""
    clips = [
        replace(make_clips(1, seed, fps_hz=fps_hz)[0], id=f"at_{fps_hz}")
        for seed, fps_hz in enumerate((20, 25, 120))
    ]
    path = write_clips(tmp_path / "mixed", small_body, clips)
    train([path], tmp_path / "run", small_config, body_path=body_path)
    assert load_gmr(tmp_path / "run").fps_hz == 10
    slow = write_clips(tmp_path / "slow", small_body, make_clips(1, 5, fps_hz=5.0))
    with pytest.raises(BadMotionFile, match="clip gait_5_0: 5 fps is lower than 10 fps"):
        train([path, slow], tmp_path / "other", small_config, body_path=body_path)
    assert not (tmp_path / "other").exists()


def test_clips_with_nan_or_other_joints_are_refused_by_name(
    manifest_path, body_path, small_config, tmp_path
):
    """Whatever made the files, after the manifest was written."""
    path = manifest_path.parent / "gait_1_1.npz"
    arrays = read_npz(path)
    poses = arrays["poses"].copy()
    poses[3, 7] = np.nan
    for broken, message in (
        (poses, "clip gait_1_1: frame 3 holds NaN"),
        (arrays["poses"][:, :66], r"gait_1_1\.npz: array 'poses' has shape \(80, 66\)"),
    ):
        write_npz(path, arrays | {"poses": broken})
        with pytest.raises(BadMotionFile, match=message):
            train([manifest_path], tmp_path / "run", small_config, body_path=body_path)
        assert not (tmp_path / "run").exists()


def test_another_models_checkpoint_in_the_unfinished_run_is_refused(
    manifest_path, body_path, small_config, tmp_path
):
    """The run's own folder stays as it is, so that what is in it is not lost."""
    diverging = small_config.model_copy(update={"learning_rate": 1e30, "gradient_norm": None})
    run_dir = tmp_path / "run"
    with pytest.raises(TrainingDiverged, match="Lower learning_rate"):
        train([manifest_path], run_dir, diverging, body_path=body_path)
    larger = small_config.model_copy(update={"model": ModelConfig(layers=1, hidden=13)})
    train([manifest_path], tmp_path / "larger", larger, body_path=body_path)
    partial = tmp_path / "run.partial"
    shutil.copytree(tmp_path / "larger" / "checkpoints", partial / "checkpoints")
    with pytest.raises(BadCheckpoint, match="of another model"):
        train([manifest_path], run_dir, diverging, body_path=body_path)
    assert latest_checkpoint(partial) is not None


@pytest.mark.slow
def test_kill_9_at_any_time_ends_with_the_same_bytes(
    manifest_path, held_out_path, body_path, small_config, tmp_path
):
    """A process is killed twice, at moments that nobody chose, and started again."""
    config = small_config.model_copy(
        update={"steps": 110, "checkpoint_every": 7, "schedule": "cosine"}
    )

    def run(run_dir: Path) -> None:
        train([manifest_path], run_dir, config, body_path=body_path, held_out_paths=[held_out_path])

    run(tmp_path / "whole")
    run_dir = tmp_path / "killed"
    paths = [str(path) for path in (manifest_path, held_out_path, body_path)]
    arguments = [*paths, config.model_dump_json(), str(run_dir)]
    steps_at_kill: list[int] = []
    for more_steps in (10, 45):
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *arguments],
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        before = steps_at_kill[-1] if steps_at_kill else 0
        while _step(run_dir) < before + more_steps:
            assert process.poll() is None, "ended before it could be killed"
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        steps_at_kill.append(_step(run_dir))
    assert not run_dir.exists()
    run(run_dir)
    whole, killed = bytes_of(tmp_path / "whole"), bytes_of(run_dir)
    assert killed == whole
    assert any(name.endswith("best.safetensors") for name in whole)


def _step(run_dir: Path) -> int:
    """Step of the unfinished run's latest checkpoint."""
    folder = latest_checkpoint(run_dir.with_name(run_dir.name + ".partial"))
    return int(folder.name.removeprefix("step_")) if folder else 0


# No thread of the process group may be left at the end: freeing a tensor while Python ends, it
# would abort the process, in about one run of 15.
TWO_PROCESSES = """
import atexit, json, os, sys
from pathlib import Path
@atexit.register
def check_threads():
    left = [path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")]
    if any("gloo" in name for name in left):
        print("threads are left:", left, file=sys.stderr, flush=True)
        os._exit(3)
from gmrdata.gmr.train import TrainConfig, train
manifest, held_out, body, runs = sys.argv[1:]
for run_dir, config in json.loads(runs).items():
    config = TrainConfig.model_validate(config)
    paths = {"body_path": Path(body), "held_out_paths": [Path(held_out)]}
    train([Path(manifest)], Path(run_dir), config, **paths)
    train([Path(manifest)], Path(run_dir), config, **paths)  # there is nothing left to do
"""


@pytest.mark.slow
def test_two_processes_train_as_one_with_twice_the_windows(
    make_clips, small_body, small_config, tmp_path
):
    """Loss, terms, gradient and held-out scores to 1e-5, where windows have different lengths."""
    short = [clip for seed in (3, 4) for clip in make_clips(1, seed, duration_s=0.8)]
    manifest = write_clips(tmp_path / "data", small_body, [*make_clips(1, 1), *short])
    held_out = write_clips(tmp_path / "held_out", small_body, make_clips(1, 2))
    body = tmp_path / "body.npz"
    save_body(body, small_body)
    configs = {
        reduction: small_config.model_copy(
            update={
                "model": ModelConfig(layers=2, hidden=12, output_scale=0.1),
                "loss": LossConfig(n_vertices=16, reduction=reduction),
            }
        )
        for reduction in ("mean", "sum")
    }
    runs = {
        str(tmp_path / f"two_{name}"): config.model_dump(mode="json")
        for name, config in configs.items()
    }
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    command += ["--nproc-per-node", "2", "--no-python", sys.executable, "-c", TWO_PROCESSES]
    done = subprocess.run(
        [*command, str(manifest), str(held_out), str(body), json.dumps(runs)],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for name, config in configs.items():
        two, one = tmp_path / f"two_{name}", tmp_path / f"one_{name}"
        doubled = config.model_copy(update={"batch_size": 2 * config.batch_size})
        train([manifest], one, doubled, body_path=body, held_out_paths=[held_out])
        assert [line.keys() for line in lines_of(two)] == [line.keys() for line in lines_of(one)]
        for found, expected in zip(lines_of(two), lines_of(one), strict=True):
            assert found == pytest.approx(expected, rel=1e-5, abs=1e-9)
        weights = "checkpoints/step_00000012/model.safetensors"
        expected_weights = load_file(one / weights)
        for key, tensor in load_file(two / weights).items():
            torch.testing.assert_close(tensor, expected_weights[key], rtol=1e-4, atol=1e-5)
        assert read_json(two / "stage.json")["facts"]["processes"] == 2
        state = read_json(two / "checkpoints" / "step_00000012" / "state.json")
        assert state["processes"] == 2


def test_parts_are_the_whole_batch(make_clips, small_config):
    windows = small_config.windows
    batch = make_batch(
        make_training_set(make_clips(2, 1), ModelConfig(), windows), windows, 6, 0, 0
    )
    parts = [own_part(batch, Processes(rank, 3)) for rank in range(3)]
    for name in ("poses", "lengths", "mask", "local_rotmats", "shape"):
        assert torch.equal(torch.cat([getattr(part, name) for part in parts]), getattr(batch, name))
    for name in ("delta_rotmats", "delta_m"):
        together = torch.cat([getattr(part.motions, name) for part in parts])
        assert torch.equal(together, getattr(batch.motions, name))


@pytest.mark.parametrize(("longest_s", "frames"), [(1e-9, 2), (1e9, 64)])
def test_a_dry_run_times_a_few_seconds(
    manifest_path, tmp_path, capsys, monkeypatch, longest_s, frames
):
    """Three whole steps of the paper's four layers of 2048 took eight minutes."""
    monkeypatch.setattr(plan, "PROBED_S", longest_s)
    recipe, out = tmp_path / "small.yaml", tmp_path / "out"
    recipe.write_text("{recipe: gmr, train: {model: {hidden: 8, layers: 1}, batch_size: 4}}")
    main(["train", str(manifest_path), "--recipe", str(recipe), "--out", str(out), "--dry-run"])
    said = " ".join(capsys.readouterr().out.split())
    assert f"minutes (by passes over 4 windows of {frames} of 64 frames, timed here" in said


def test_a_dry_run_counts_no_clip_as_scored_that_is_trained_on(
    manifest_path, held_out_path, tmp_path, capsys
):
    """The training scores none of them."""
    recipe = tmp_path / "small.yaml"
    recipe.write_text("{recipe: gmr, train: {model: {hidden: 8, layers: 1}, batch_size: 4}}")
    asked = ["train", str(manifest_path), "--recipe", str(recipe), "--out", str(tmp_path / "out")]
    main([*asked, "--held-out", str(manifest_path), str(held_out_path), "--dry-run"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["trained", "on", "2", "160"] in rows and ["scored", "1", "80"] in rows


def test_a_dry_run_times_no_loading(monkeypatch):
    """The first pass loads for seconds what all others find loaded, and stood for every step."""
    passes = iter([30.0])
    monkeypatch.setattr(
        plan.timeit, "repeat", lambda *_, repeat, **__: [next(passes, 0.01)] * repeat
    )
    probe = plan.probe_training(TrainConfig(model=ModelConfig(hidden=8, layers=1), batch_size=4))
    assert probe.step_s == 0.01 and "of 64 of 64 frames" in probe.basis


def test_a_dry_run_says_of_a_folder_what_the_training_would(
    manifest_path, body_path, small_config, tmp_path, gmrdata, works
):
    """What other settings had made or begun was said to be there; the training refused it."""
    run_dir, recipe = tmp_path / "run", tmp_path / "small.yaml"
    train([manifest_path], run_dir, small_config, body_path=body_path)
    asked = ["train", manifest_path, "--recipe", recipe, "--out", run_dir, "--body", body_path]

    def write_recipe(config: TrainConfig) -> None:
        recipe.write_text(json.dumps({"recipe": "gmr", "train": config.model_dump(mode="json")}))

    def last_line(*more: str) -> str:
        return works(*asked, "--dry-run", *more).stdout.splitlines()[-1]

    write_recipe(small_config)
    assert last_line() == f"{run_dir}: made"
    longer = small_config.model_copy(update={"steps": 13})
    write_recipe(longer)
    stale = "made with other values of config.steps. Pass --redo"
    fails_cleanly(gmrdata(*asked, "--dry-run"), f"{run_dir}: {stale}")
    assert last_line("--redo") == f"{run_dir}: to make"
    write_recipe(small_config)
    (run_dir / "stage.json").unlink()
    begun = run_dir.rename(tmp_path / "run.partial")
    assert last_line() == f"{run_dir}: to make"  # by whom it was begun isn't known
    record = read_json(
        train([manifest_path], run_dir, small_config, body_path=body_path) / "stage.json"
    )
    run_dir.rename(begun)
    said = {key: record[key] for key in ("stage", "config", "inputs")}
    said |= {"format": "gmrdata-recipe/2", "host": host_word()}
    (begun / "recipe.json").write_text(json.dumps(said))
    assert last_line() == f"{run_dir}: begun"
    write_recipe(longer)
    fails_cleanly(gmrdata(*asked, "--dry-run"), f"{begun}: begun with other values of config.steps")
    assert last_line("--redo") == f"{run_dir}: to make"


def test_a_held_out_clip_is_scored_once(
    make_clips, small_body, body_path, small_config, tmp_path, works
):
    """Of a held-out person and in a held-out manifest, it counted twice among the scores."""
    clips = [
        replace(clip, id=id) for clip, id in zip(make_clips(2, 1), ("02_01", "05_01"), strict=True)
    ]
    valid = clips[1].valid.copy()
    valid[:30] = False
    clips[1] = replace(clips[1], valid=valid)
    path = write_clips(tmp_path / "data", small_body, clips, sources="CMU")
    data = small_config.data.model_copy(update={"held_out_subjects": (2,)})
    config, recipe = small_config.model_copy(update={"data": data}), tmp_path / "small.yaml"
    split = split_manifests([path], data)
    scored, said = scored_files([path], split)
    assert [file.entry.id for file in scored] == ["02_01"]
    assert said == "not scored: 1 of 2 held-out clips are trained on"
    recipe.write_text(json.dumps({"recipe": "gmr", "train": config.model_dump(mode="json")}))
    asked = ("train", path, "--recipe", recipe, "--held-out", path, "--body", body_path)
    lines = works(*asked, "--out", tmp_path / "run", "--dry-run").stdout.splitlines()
    rows = [line.split() for line in lines]
    assert ["trained", "on", "1", "50"] in rows and ["scored", "1", "80"] in rows
    assert said in lines
