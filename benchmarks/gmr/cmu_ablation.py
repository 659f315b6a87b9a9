"""What each part of the chosen recipe earns: the recipe without it, trained as long."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gmr.cmu_runs import METRICS, Trained

from gmrdata.gmr.config import TrainConfig

PARTS: dict[str, dict[str, Any]] = {
    "without time reversal (flip)": {"windows": {"reverse_probability": 0.0}},
    "without mirroring": {"windows": {"mirror_probability": 0.0}},
    "without pose noise": {"windows": {"pose_noise_deg": 0.0}},
    "without dropout": {"model": {"dropout": 0.0}},
    "without weight averaging": {"average_decay": 0.0},
    "without a standing joint in the rotation": {"model": {"rotation": "regressed"}},
    "without a standing joint in the translation": {"model": {"translation": "regressed"}},
    "without velocity": {"model": {"extra_inputs": ("standing",)}},
    "without standing joints in the input": {"model": {"extra_inputs": ("velocity",)}},
    "without both inputs": {"model": {"extra_inputs": ()}},
}
"""Name of a change, and the settings that it replaces."""


def changed(config: TrainConfig, change: dict[str, Any]) -> TrainConfig:
    """A recipe with some settings replaced, checked anew."""
    values = config.model_dump()
    for key, value in change.items():
        values[key] = values[key] | value if isinstance(value, dict) else value
    return TrainConfig.model_validate(values)


def short(config: TrainConfig, steps: int, seed: int) -> TrainConfig:
    """The same recipe with fewer steps, scored at the end alone."""
    every = {"eval_every": steps, "checkpoint_every": steps}
    return changed(config, {"steps": steps, "seed": seed} | every)


def summary(name: str, runs: Sequence[Trained]) -> dict[str, Any]:
    """One row: means over the seeds, and how far the seeds lie apart."""
    row: dict[str, Any] = {"run": name, "seeds": len(runs), "steps": runs[0].steps}
    for metric in METRICS:
        values = [run.held_out[metric] for run in runs]
        row[metric] = round(float(np.mean(values)), 3)
        row[f"{metric[:3]}_apart"] = round(max(values) - min(values), 3)
    return row
