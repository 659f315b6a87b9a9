"""A checkpoint of GMR: what a kept step's folder holds (`gmrdata.gmr.kept_steps`).

`model.safetensors`, `optimizer.safetensors` and `state.json`.  A run that averages its weights has
`average.safetensors` too, and `averaged` in its state says so: that is then the network, and
`model` what training goes on from.  Where there are held-out scores, `best.safetensors` has the
network that scored best up to that step: the best so far is part of the state that a killed run
goes on from, and comes and goes with it.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import ValidationError
from torch import Tensor

from gmrdata.errors import BadCheckpoint
from gmrdata.gmr.config import ModelConfig, Which
from gmrdata.gmr.kept_steps import STATE_FILE, read_step_state, write_step
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.tensor_files import (
    OPTIMIZER_FILE,
    WEIGHTS_FILE,
    fill_network,
    fill_optimizer,
    optimizer_tensors,
    read_tensors,
    writable,
)

FORMAT = "gmrdata-gmr/1"

Weights = Literal["trained", "average", "best"]
"""What a checkpoint keeps: what training goes on from, its average, and the best network."""

FILES: dict[Weights, str] = {
    "trained": WEIGHTS_FILE,
    "average": "average.safetensors",
    "best": "best.safetensors",
}
"""Files of weights."""


@dataclass(frozen=True, eq=False)
class Best:
    """The weights that scored best on held-out clips so far."""

    step: int
    """Steps done then."""
    score: str
    """Which score."""
    value: float
    """Its value."""
    weights: dict[str, Tensor]
    """By name, on the CPU."""


def best_of(best: Best | None, step: int, score: str, value: float, model: Gmr) -> Best | None:
    """The better of the best so far and the network's weights now; the older one if equal.

    A score that is not a number is no score.
    """
    if not math.isfinite(value) or (best is not None and best.value <= value):
        return best
    return Best(step, score, value, writable(model.state_dict()))


def save_checkpoint(
    run_dir: Path,
    step: int,
    model: Gmr,
    optimizer: torch.optim.Optimizer,
    extra: dict[str, Any],
    best: Best | None = None,
    *,
    average: Gmr | None = None,
) -> Path:
    """Write weights, optimiser and state of a step, point `latest` to them, and drop older ones.

    A process that is killed at any moment leaves the former checkpoint or this one.

    Args:
        run_dir: The run's folder.
        step: Steps done.
        model: The network.
        optimizer: Its optimiser, made over `model.parameters()`.
        extra: JSON values to keep in `state.json` beside step and model config.
        best: The best weights so far, if there are held-out scores.
        average: The average of its weights, where the run keeps one.
    """
    tensors = {
        FILES["trained"]: writable(model.state_dict()),
        OPTIMIZER_FILE: optimizer_tensors(model, optimizer),
    }
    state: dict[str, Any] = {"format": FORMAT, "model": model.config.model_dump(mode="json")}
    if average is not None:
        tensors[FILES["average"]] = writable(average.state_dict())
        state["averaged"] = True
    if best is not None:
        tensors[FILES["best"]] = best.weights
        state["best"] = {"step": best.step, "score": best.score, "value": best.value}
    return write_step(run_dir, step, tensors, state | extra)


def read_state(folder: Path) -> dict[str, Any]:
    """The checkpoint's `state.json`.

    Raises:
        BadCheckpoint: it is missing, not JSON, or of another format.
    """
    return read_step_state(folder, FORMAT)


def read_model(folder: Path, which: Which = "latest") -> Gmr:
    """The network of a checkpoint, with averaged weights where the run keeps such.

    Raises:
        BadCheckpoint: files are truncated, missing, or of another model; or the best weights are
            asked for and were not kept.
    """
    state = read_state(folder)
    try:
        config = ModelConfig.model_validate(state.get("model"))
    except ValidationError as error:
        raise BadCheckpoint(f"{folder / STATE_FILE}: no model settings: {error}") from None
    model = Gmr(config)
    if which == "best":
        if read_best(folder) is None:
            raise BadCheckpoint(
                f"{folder}: no best weights, since none were scored while training. Use the latest,"
                " or train with held-out manifests"
            )
        load_weights(folder, model, "best")
    else:
        load_weights(folder, model, "average" if state.get("averaged") else "trained")
    return model


def load_weights(folder: Path, model: Gmr, kind: Weights = "trained") -> None:
    """Fill a network with a checkpoint's weights.

    Raises:
        BadCheckpoint: the file is truncated or missing, or of another model.
    """
    fill_network(folder / FILES[kind], model)


def read_best(folder: Path) -> Best | None:
    """The best weights up to a checkpoint; None where nothing was scored.

    Raises:
        BadCheckpoint: a file is truncated or missing.
    """
    record = read_state(folder).get("best")
    if record is None:
        return None
    weights = read_tensors(folder / FILES["best"])
    try:
        return Best(int(record["step"]), str(record["score"]), float(record["value"]), weights)
    except (KeyError, TypeError, ValueError) as error:
        raise BadCheckpoint(
            f"{folder / STATE_FILE}: unreadable entry best ({error!r}). Train again"
        ) from None


def load_optimizer(folder: Path, model: Gmr, optimizer: torch.optim.Optimizer) -> None:
    """Fill an optimiser that was just made over `model.parameters()`.

    Raises:
        BadCheckpoint: the file is truncated or missing, or of another model.
    """
    fill_optimizer(folder / OPTIMIZER_FILE, model, optimizer)
