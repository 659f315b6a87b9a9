"""One training in two processes, started by torchrun, beside one process with all the windows."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig
from gmrdata.gmr.loop import own_part
from gmrdata.gmr.steps import Processes
from gmrdata.gmr.train import train
from gmrdata.gmr.windows import make_batch, make_training_set
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.files import read_json
from tests.clip_manifests import write_clips
from tests.gmr.test_loop import lines_of

PROGRAM = """
import json, sys
from pathlib import Path
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
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
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
    command += ["--nproc-per-node", "2", "--no-python", sys.executable, "-c", PROGRAM]
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


def test_parts_are_the_whole_batch(
    make_clips: Callable[..., list[Clip]], small_config: TrainConfig
) -> None:
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
