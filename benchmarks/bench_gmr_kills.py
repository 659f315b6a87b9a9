"""Kill a training five times at random moments, and compare its weights with an undisturbed one's.

The training takes about half an hour, and the whole about twice that; `--small` trains for half a
minute.  Prints when it was killed and writes out/bench/gmr_kills.json.  The seed of the moments is
new each time and recorded; set GMRDATA_SEED to repeat one.
"""

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record import OUT_DIR

from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig
from gmrdata.read.body_file import save_body
from gmrdata.stage.progress import console
from gmrdata.stage.store import stage_seconds
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.files import write_json
from tests.clip_manifests import write_clips
from tests.folders import bytes_of
from tests.gmr.test_train import PROGRAM
from tests.motions import walking_clips

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "gmr_kills.json"
N_KILLS = 5
START_S = 6.0
"""A process needs about this long until it trains."""
TRIAL_STEPS = (40, 240)
"""Steps of two trials, whose difference tells how many fill the time."""
LEAST_STEPS = 300
"""On a machine that is too busy for the trials to tell."""


def config_of(steps: int, small: bool) -> TrainConfig:
    """Every option that has randomness or state is on."""
    return TrainConfig(
        model=ModelConfig(layers=2, hidden=16 if small else 128, dropout=0.1, output_scale=0.1),
        loss=LossConfig(n_vertices=16 if small else 500),
        learning_rate=1e-3,
        schedule="cosine",
        warmup_steps=20,
        gradient_norm=1.0,
        batch_size=8 if small else 32,
        steps=steps,
        seed=5,
        eval_every=max(1, steps // 20),
        checkpoint_every=max(1, steps // 30),
    )


def start(paths: list[Path], config: TrainConfig, run_dir: Path) -> subprocess.Popen[bytes]:
    arguments = [*map(str, paths), config.model_dump_json(), str(run_dir)]
    return subprocess.Popen([sys.executable, "-c", PROGRAM, *arguments], stderr=subprocess.DEVNULL)


def steps_in(wanted_s: float, paths: list[Path], out_dir: Path, small: bool) -> int:
    """Steps that take about so long.  Start, scores and checkpoints are few in a long training."""
    taken_s = []
    for steps in TRIAL_STEPS:
        once = {"eval_every": steps, "checkpoint_every": steps}
        trial = config_of(steps, small).model_copy(update=once)
        run_dir = out_dir / f"trial_{steps}"
        assert start(paths, trial, run_dir).wait() == 0
        taken_s.append(stage_seconds(run_dir))
    step_s = (taken_s[1] - taken_s[0]) / (TRIAL_STEPS[1] - TRIAL_STEPS[0])
    return max(LEAST_STEPS, int(wanted_s / step_s)) if step_s > 0 else LEAST_STEPS


def clips_of(body: BodyModel, seed: int, count: int) -> list[Clip]:
    ids = [f"walk_{seed}_{number}" for number in range(count)]
    return walking_clips(body, ids, seed, fps_hz=30.0, duration_s=12.0)


def test_five_kills_change_nothing(
    tmp_path: Path, small_body: BodyModel, request: pytest.FixtureRequest
) -> None:
    small = request.config.getoption("--small")
    wanted_s = 15.0 if small else 1800.0
    seed = int(os.environ.get("GMRDATA_SEED") or secrets.randbits(32))
    save_body(tmp_path / "body.npz", small_body)
    paths = [
        write_clips(tmp_path / "training", small_body, clips_of(small_body, 1, 8)),
        write_clips(tmp_path / "held_out", small_body, clips_of(small_body, 2, 2)),
        tmp_path / "body.npz",
    ]
    config = config_of(steps_in(wanted_s, paths, tmp_path, small), small)

    begin_s = time.monotonic()
    assert start(paths, config, tmp_path / "undisturbed").wait() == 0
    whole_s = time.monotonic() - begin_s
    rng = np.random.default_rng(seed)
    moments_s = np.sort(rng.uniform(0, 0.95 * (whole_s - START_S), N_KILLS))
    kills: list[dict[str, Any]] = []
    for after_s in START_S + np.diff(moments_s, prepend=0.0):
        process = start(paths, config, tmp_path / "killed")
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
        folder = latest_checkpoint(tmp_path / "killed.partial")
        kills.append({"after_s": round(after_s, 1), "went_on_from": folder and folder.name})
        console.print(kills[-1])
    assert start(paths, config, tmp_path / "killed").wait() == 0
    killed, undisturbed = bytes_of(tmp_path / "killed"), bytes_of(tmp_path / "undisturbed")
    record = {
        "seed": seed,
        "steps": config.steps,
        "undisturbed_s": round(whole_s, 1),
        "kills": kills,
        "files": sorted(undisturbed),
        "same_bytes": killed == undisturbed,
    }
    write_json(OUT, record)
    console.print(json.dumps(record, indent=2))
    assert killed == undisturbed
