"""Whether training waits for its windows, with as many frames as AMASS has at 10 fps.

Makes a pack of 1.4 million frames of random walks (about 650 MB in the temporary folder; `--small`:
a hundredth), trains a network of 4 x 512 on it, and prints the share of the time that the loop
waits for the next batch; the same without the thread that makes batches ahead; and the memory that
the process took.  Writes out/bench/gmr_loader.json.
"""

import resource
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from record import OUT_DIR

from gmrdata.gmr.config import ModelConfig, WindowConfig
from gmrdata.gmr.flat_runs import PackRecord, TrainingRun, in_files
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.steps import prefetched
from gmrdata.gmr.windows import Batch, TrainingSet, make_batch
from gmrdata.stage.progress import console, track
from gmrdata.values.files import write_json

pytestmark = pytest.mark.bench
PACK = PackRecord(input="quaternion", fps_hz=10.0)
N_FRAMES, RUN_FRAMES, BATCH, STEPS = 1_400_000, 500, 32, 10
MOST_WAITING = 0.05
OUT = OUT_DIR / "gmr_loader.json"
Batches = Callable[[Callable[[int], Batch], Iterable[int]], Iterator[tuple[int, Batch]]]


def random_walks(n_runs: int) -> Iterator[TrainingRun]:
    """Runs in which each joint's quaternion and the root go on at random."""
    rng = np.random.default_rng(0)
    for _ in track(range(n_runs), "packing", total=n_runs):
        steps = 0.05 * rng.normal(size=(RUN_FRAMES, 23, 4))
        quaternions = np.cumsum(steps, axis=0) + np.array([1.0, 0.0, 0.0, 0.0])
        quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
        angles = np.cumsum(0.1 * rng.normal(size=RUN_FRAMES))
        cos, sin, no = np.cos(angles), np.sin(angles), np.zeros(RUN_FRAMES)
        roots = np.stack([cos, -sin, no, sin, cos, no, no, no, no + 1], axis=1)
        pelvis_m = np.cumsum(0.1 * rng.normal(size=(RUN_FRAMES, 3)), axis=0)
        poses = quaternions.reshape(RUN_FRAMES, 92)
        yield TrainingRun(poses, roots.reshape(-1, 3, 3), pelvis_m, np.zeros(10))


def one_by_one(make: Callable[[int], Batch], steps: Iterable[int]) -> Iterator[tuple[int, Batch]]:
    """Batches made when they are asked for."""
    for step in steps:
        yield step, make(step)


def waiting_share(training_set: TrainingSet, batches: Batches, first: int) -> tuple[float, float]:
    """Share of the time that the loop waits, and seconds per step."""
    config = WindowConfig()
    torch.manual_seed(0)
    model = Gmr(ModelConfig(layers=4, hidden=512))
    optimizer = torch.optim.Adam(model.parameters())
    waited_s, start_s = 0.0, 0.0
    steps = batches(
        lambda step: make_batch(training_set, config, BATCH, 0, step),
        range(first, first + STEPS + 1),
    )
    asked_s = time.perf_counter()
    for step, batch in steps:
        came_s = time.perf_counter()
        if step == first:  # the first batch can't have been made ahead
            start_s = came_s
        else:
            waited_s += came_s - asked_s
        optimizer.zero_grad()
        delta_rotmats, delta_m = model(batch.poses, batch.lengths)
        errors = (
            (delta_rotmats[:, :-1] - batch.motions.delta_rotmats).square().mean(),
            (delta_m[:, :-1] - batch.motions.delta_m).square().mean(),
        )
        torch.stack(errors).sum().backward()
        optimizer.step()
        asked_s = time.perf_counter()
    whole_s = asked_s - start_s
    return waited_s / whole_s, whole_s / (STEPS + 1)


def test_the_loop_does_not_wait(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    small = request.config.getoption("--small")
    n_runs = N_FRAMES // RUN_FRAMES // (100 if small else 1)
    torch.set_num_threads(1)
    start_s = time.perf_counter()
    frames = in_files(random_walks(n_runs), tmp_path / "pack", PACK)
    packing_s = time.perf_counter() - start_s
    training_set = TrainingSet(frames, "quaternion")
    ahead, ahead_s = waiting_share(training_set, prefetched, 0)
    bare, bare_s = waiting_share(training_set, one_by_one, 1000)
    peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    record = {
        "frames": len(frames.poses),
        "pack_mb": round(sum(p.stat().st_size for p in (tmp_path / "pack").iterdir()) / 1e6),
        "packing_s": round(packing_s, 1),
        "model": "4 x 512, batch 32 x 64, 1 thread",
        "waiting_share": round(ahead, 4),
        "step_s": round(ahead_s, 3),
        "waiting_share_without_thread": round(bare, 4),
        "step_s_without_thread": round(bare_s, 3),
        "peak_memory_mb": round(peak_bytes / 1e6),
    }
    console.print(record)
    write_json(OUT, record)
    if not small:
        assert ahead < MOST_WAITING
