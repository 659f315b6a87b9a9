"""What a table's trainings would take, without any of them."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.gmr.config import TrainConfig
from gmrdata.tables.plan import Plan

if TYPE_CHECKING:
    from torch import Tensor

    from gmrdata.gmr.model import Gmr

HEADINGS = ("training", "parameters", "steps", "state", "minutes")
PROBED_STEPS = 2


def planned_runs(
    plan: Plan, out_dir: Path, workers: int
) -> tuple[list[tuple[str, ...]], list[str]]:
    """The trainings of a table as rows, and the sum of what is left.

    The estimate is of the network's forward and backward pass on this machine, timed for two steps
    after a first one; the loss and the data come on top.

    Args:
        plan: The table's.
        out_dir: Where runs that are made lie.
        workers: How many trainings run at a time.

    Returns:
        Rows under `HEADINGS`, and lines to print below them.
    """
    probed: dict[str, tuple[int, float | None]] = {}
    rows: list[tuple[str, ...]] = []
    left_minutes, n_left, unknown = 0.0, 0, False
    for one in plan.trainings:
        config = one.config
        if isinstance(config, JointConfig):
            parameters, step_s = "-", None
        else:
            key = f"{config.model!r} {config.batch_size} {config.windows.frames} {config.device}"
            if key not in probed:
                probed[key] = _probe(config)
            parameters, step_s = f"{probed[key][0]:,}", probed[key][1]
        is_made = (out_dir / "runs" / one.id).is_dir()
        minutes = None if step_s is None else config.steps * step_s / 60
        if not is_made:
            n_left += 1
            unknown |= minutes is None
            left_minutes += minutes or 0.0
        shown = "?" if minutes is None else f"{minutes:.1f}"
        rows.append((one.id, parameters, str(config.steps), _state(out_dir, one.id), shown))
    total = f"at least {left_minutes / max(1, min(workers, n_left)):.0f} minutes"
    if unknown:
        total = "no estimate for those with ?: their device is not here, or their input is unknown"
    lines = [f"{n_left} of {len(plan.trainings)} trainings to make with {workers} workers: {total}"]
    lines.append(f"{sum(map(len, plan.scorings.values()))} scores")
    return rows, lines


def _state(out_dir: Path, id: str) -> str:
    run_dir = out_dir / "runs" / id
    if run_dir.is_dir():
        return "made"
    return "begun" if run_dir.with_name(run_dir.name + ".partial").is_dir() else "to make"


def _probe(config: TrainConfig) -> tuple[int, float | None]:
    """Number of parameters, and seconds of a step on one CPU thread; None for another device."""
    import torch

    from gmrdata.gmr.model import Gmr, input_size

    model = Gmr(config.model)
    n_parameters = sum(values.numel() for values in model.parameters())
    if config.device != "cpu":
        return n_parameters, None
    threads = torch.get_num_threads()
    torch.set_num_threads(config.threads)
    try:
        poses = torch.zeros(config.batch_size, config.windows.frames, input_size(config.model))
        # The first step loads what the others find loaded, so it is not counted.
        times_s = [_step_s(model, poses) for _ in range(1 + PROBED_STEPS)]
        return n_parameters, min(times_s[1:])
    finally:
        torch.set_num_threads(threads)


def _step_s(model: "Gmr", poses: "Tensor") -> float:
    """Seconds of one forward and backward pass."""
    start_s = time.monotonic()
    rotmats, metres = model(poses)
    (rotmats.sum() + metres.sum()).backward()
    return time.monotonic() - start_s
