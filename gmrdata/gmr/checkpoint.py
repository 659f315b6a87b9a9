"""A checkpoint of GMR: what a kept step's folder holds (`gmrdata.gmr.checkpoint`).

`model.safetensors`, `optimizer.safetensors` and `state.json`.  A run that averages its weights has
`average.safetensors` too, and `averaged` in its state says so: that is then the network, and
`model` what training goes on from.  Where there are held-out scores, `best.safetensors` has the
network that scored best up to that step: the best so far is part of the state that a killed run
goes on from, and comes and goes with it.

Weights and the optimiser's state as safetensors files, held against the network they are for.

The folder of a kept step, whole or absent, and a pointer to the latest.

`<run>/checkpoints/step_00001000/` holds files of weights and `state.json`; the file `latest` beside
it holds the folder's name.
"""

import math
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from gmrdata.gmr.config import ModelConfig, Which
from gmrdata.gmr.model import Gmr
from gmrdata.values.errors import BadCheckpoint, BadRecord, MissingInput
from gmrdata.values.files import read_json, write_json, write_text

WEIGHTS_FILE = "model.safetensors"
"""What training goes on from."""
OPTIMIZER_FILE = "optimizer.safetensors"
"""The optimiser's state, beside it."""


def fill_network(path: Path, model: nn.Module) -> None:
    """Fill a network with a file's weights.

    Raises:
        BadCheckpoint: the file is truncated or missing, or of another model.
    """
    tensors = read_tensors(path)
    _check_names(path, tensors, {name: t.shape for name, t in model.state_dict().items()})
    model.load_state_dict(tensors)


def fill_optimizer(path: Path, model: nn.Module, optimizer: torch.optim.Optimizer) -> None:
    """Fill an optimiser that was just made over `model.parameters()`.

    Raises:
        BadCheckpoint: the file is truncated or missing, or of another model.
    """
    tensors = read_tensors(path)
    shapes = {}
    for name, parameter in model.named_parameters():
        shapes[f"{name}.step"] = torch.Size(())
        shapes |= {f"{name}.{key}": parameter.shape for key in ("exp_avg", "exp_avg_sq")}
    _check_names(path, tensors, shapes)
    state = {
        i: {key: tensors[f"{name}.{key}"] for key in ("step", "exp_avg", "exp_avg_sq")}
        for i, (name, _) in enumerate(model.named_parameters())
    }
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})


def optimizer_tensors(model: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """State of an Adam over `model.parameters()`, by the names of these."""
    state = optimizer.state_dict()["state"]
    return writable(
        {
            f"{name}.{key}": value
            for i, (name, _) in enumerate(model.named_parameters())
            for key, value in state[i].items()
        }
    )


def writable(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Copies on the CPU that share no memory: a GRU on a GPU keeps its weights in one buffer."""
    return {name: tensor.detach().cpu().clone().contiguous() for name, tensor in tensors.items()}


def read_tensors(path: Path) -> dict[str, Tensor]:
    """All tensors of a file.

    Raises:
        BadCheckpoint: it is truncated, missing, or not safetensors.
    """
    try:
        tensors: dict[str, Tensor] = load_file(path)
    except (SafetensorError, OSError) as error:
        raise BadCheckpoint(
            f"{path}: truncated, missing or not safetensors ({error}). Train again"
        ) from None
    return tensors


def _check_names(path: Path, tensors: dict[str, Tensor], shapes: dict[str, torch.Size]) -> None:
    found = {name: tensor.shape for name, tensor in tensors.items()}
    if found == shapes:
        return
    differing = sorted(
        name for name in found.keys() | shapes.keys() if found.get(name) != shapes.get(name)
    )
    raise BadCheckpoint(
        f"{path}: of another model; differing tensors: {', '.join(differing[:5])}"
        f"{' ...' if len(differing) > 5 else ''}. Use the run's own settings, or train again"
    )


STATE_FILE = "state.json"


def checkpoint_dir(run_dir: Path, step: int) -> Path:
    """Where the checkpoint of a step lies."""
    return run_dir / "checkpoints" / f"step_{step:08d}"


def latest_checkpoint(run_dir: Path) -> Path | None:
    """The checkpoint that the pointer names, or None where there is none yet.

    Raises:
        BadCheckpoint: the pointer names a folder that is not there.
    """
    pointer = run_dir / "checkpoints" / "latest"
    if not pointer.is_file():
        return None
    folder = pointer.parent / pointer.read_text(encoding="utf-8").strip()
    if folder == pointer.parent or not folder.is_dir():
        raise BadCheckpoint(f"{pointer}: names {folder.name!r}, which is not there. Train again")
    return folder


def write_step(
    run_dir: Path, step: int, tensors: Mapping[str, dict[str, Tensor]], state: dict[str, Any]
) -> Path:
    """Write a step's files, point `latest` to them, and drop older ones.

    A process that is killed at any moment leaves the former folder or this one.

    Args:
        run_dir: The run's folder.
        step: Steps done.
        tensors: Tensors on the CPU that share no memory, by name, for each file.
        state: JSON values for `state.json`, to which the step is added.
    """
    folder = checkpoint_dir(run_dir, step)
    temporary = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    for name, values in tensors.items():
        save_file(values, temporary / name)
    write_json(temporary / STATE_FILE, state | {"step": step})
    for file in temporary.iterdir():
        _fsync(file)
    shutil.rmtree(folder, ignore_errors=True)
    temporary.rename(folder)
    _fsync(folder.parent)
    write_text(folder.with_name("latest"), folder.name + "\n")
    for other in folder.parent.glob("*step_*"):
        if other != folder:
            shutil.rmtree(other)
    return folder


def read_step_state(folder: Path, file_format: str) -> dict[str, Any]:
    """A kept step's `state.json`.

    Raises:
        BadCheckpoint: it is missing, not JSON, or of another format.
    """
    path = folder / STATE_FILE
    try:
        state = read_json(path)
    except (MissingInput, BadRecord) as error:
        raise BadCheckpoint(f"{path}: unreadable ({error}). Train again") from None
    if not isinstance(state, dict) or state.get("format") != file_format or "step" not in state:
        raise BadCheckpoint(
            f"{path}: not a checkpoint of {file_format}. Give a run made by gmrdata"
        )
    return state


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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
