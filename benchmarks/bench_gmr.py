"""Measure GMR's training step: against the direct reading of eq. 13, and over the bare network.

`make bench-gmr` runs this file alone and takes about five minutes on a quiet core; `--small` only
tries every part.  Prints tables and writes out/bench/gmr.json.  Ratios are of steps done in turn in
one process, with the recipe's one thread; seconds are of that process and depend on the machine.

* `step_ratio_direct`: a step that poses the body for prediction and target under autograd, over
  ours, on the default body's full mesh.
* `step_ratio_bare`: our step over forward, backward and Adam of the same GRUs and linear layers
  with a squared distance for a loss, on a body of 6890 vertices; `step_ratio_bare_pose_shapes`: on
  one with pose blend shapes, as SMPL has them.
"""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from gmr.gpu import measure_gpu
from gmr.steps import (
    bare_step,
    difference_to_direct,
    direct_step,
    our_step,
    recipe,
    with_pose_shapes,
    workload,
)
from gmr.timing import paired
from record import OUT_DIR, Record, at_most, bar_of, machine
from render.tables import show

from gmrdata.values.body import BodyModel, vertex_rows, with_vertices

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "gmr.json"
SMPL_VERTICES = 6890
BARS = {
    "step_ratio_direct": (">=", 5.0),
    "step_ratio_bare": ("<=", 1.6),
    "step_ratio_bare_pose_shapes": ("<=", 1.6),
    "direct_loss_difference": ("<=", 1e-5),
    "direct_gradient_difference": ("<=", 1e-5),
}
GPU_BAR = 1.25
COLUMNS = [
    *("body", "against", "ours_s", "other_s"),
    *("ratio", "ratio_min", "ratio_max", "wall_ratio", "pairs"),
]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def test_the_training_step(anny: BodyModel, request: pytest.FixtureRequest) -> None:
    small = request.config.getoption("--small")
    sizes = (2, 32, 4, 16) if small else (2, 512, 32, 64)
    pairs = 2 if small else 7
    config = recipe(*sizes)
    whole = _subset(anny, 500) if small else anny
    part = _subset(anny, 300 if small else SMPL_VERTICES)

    work = workload(config, whole)
    difference = difference_to_direct(work)
    rows = [
        {"body": f"{len(whole.template_m)} vertices", "against": "direct reading"}
        | paired(direct_step(work), our_step(work), pairs, ("other", "ours"))
    ]
    for name, body in (("", part), (" with pose shapes", with_pose_shapes(part))):
        work = workload(config, body)
        rows.append(
            {"body": f"{len(body.template_m)} vertices{name}", "against": "bare network"}
            | paired(our_step(work), bare_step(work), pairs, ("ours", "other"))
        )
    show("A training step on the CPU", [{key: row[key] for key in COLUMNS} for row in rows])
    figures = {
        "step_ratio_direct": rows[0]["ratio"],
        "step_ratio_bare": rows[1]["ratio"],
        "step_ratio_bare_pose_shapes": rows[2]["ratio"],
        "direct_loss_difference": difference["loss"],
        "direct_gradient_difference": difference["gradient"],
    }
    bars = [bar_of(name, value, *BARS[name]) for name, value in figures.items()]
    gpu: list[dict[str, Any]] | str = "not measured: small" if small else "not measured: no GPU"
    if torch.cuda.is_available() and not small:
        gpu = measure_gpu(part)
        show("A training step on the GPU at 4 x 2048", gpu)
        bars += [at_most(f"gpu_ratio_{row['precision']}", row["ratio"], GPU_BAR) for row in gpu]
    scale = {"scale": "small" if small else "full", "sizes": sizes}
    record = Record(OUT, small, lambda: _settings() | scale)
    record.add(**figures, gpu=gpu, steps=rows)
    record.hold(bars)


def _subset(body: BodyModel, n_vertices: int) -> BodyModel:
    return with_vertices(body, vertex_rows(len(body.template_m), n_vertices))


def _settings() -> dict[str, Any]:
    return machine() | {
        "threads": torch.get_num_threads(),
        "cpu_capability": torch.backends.cpu.get_cpu_capability(),
        "torch": torch.__version__,
    }
