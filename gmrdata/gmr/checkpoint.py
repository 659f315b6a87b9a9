"""A checkpoint: the folder of a kept step, whole or absent, and a pointer to the latest.

`<run>/checkpoints/step_00001000/` holds `state.json`, `model.safetensors` and
`optimizer.safetensors`; the file `latest` beside it holds the folder's name.  A run that averages
its weights has `average.safetensors` too, which is then the network, and `model` what training goes
on from.  Where there are held-out scores, `best.safetensors` has the network that scored best up to
that step: it is part of the state that a killed run goes on from, and comes and goes with it.
"""

import math
import os
import re
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import torch
from pydantic import Field
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn

from gmrdata.gmr.config import ModelConfig, Which
from gmrdata.gmr.model import Gmr
from gmrdata.values.errors import BadCheckpoint, BadRecord, MissingInput
from gmrdata.values.files import read_json, write_json, write_text
from gmrdata.values.records import Config, Record

STATE_FILE = "state.json"
_FOLDER_NAME = re.compile(r"step_[0-9]{8,12}")
REMEDY = "Give a run made by gmrdata, or train again"
Weights = Literal["model", "average", "best"]  # what training goes on from, its average, the best
_MOMENTS = ("exp_avg", "exp_avg_sq")


class StepState(Record):
    """What every kept step says of itself: the steps done, and the body that it is trained on."""

    step: int = Field(ge=0)
    body: str


class BestScore(Config):
    """The lowest score on held-out clips so far: after which step, which score, and its value."""

    step: int
    score: str
    value: float


class GmrState(StepState):
    """`state.json` of a GMR."""

    format: Literal["gmrdata-gmr/7"] = "gmrdata-gmr/7"
    model: ModelConfig
    fps_hz: float = Field(gt=0)
    processes: int  # on which a step's windows depend
    averaged: bool  # whether there are averaged weights, which are then the network
    best: BestScore | None


_FORMER = tuple(f"gmrdata-gmr/{version}" for version in range(1, 7))
_FIRST_LEFT_OUT = {"processes": 1, "averaged": False, "best": None}  # where it did not apply
_ADDED_TO_MODEL: dict[int, dict[str, Any]] = {
    3: {"latent": None},
    4: {"looks_at": "all_joints", "regressed": "freely"},
    5: {"symmetric": False},
    6: {"joints_say": False},
    7: {"soles_hold": False},
}
"""By version, what networks before it had always."""
State = TypeVar("State", bound=StepState)


@dataclass(frozen=True, eq=False)
class Best:
    """The weights that scored best on held-out clips so far, by name, on the CPU."""

    score: BestScore
    weights: dict[str, Tensor]


def best_of(best: Best | None, step: int, score: str, value: float, model: Gmr) -> Best | None:
    """The better of the best so far and the network's weights now; NaN is no score."""
    if not math.isfinite(value) or (best is not None and best.score.value <= value):
        return best
    return Best(BestScore(step=step, score=score, value=value), writable(model.state_dict()))


def checkpoint_dir(run_dir: Path, step: int) -> Path:
    return run_dir / "checkpoints" / f"step_{step:08d}"


def latest_checkpoint(run_dir: Path) -> Path | None:
    """The checkpoint that the pointer names; None where there is none yet."""
    pointer = run_dir / "checkpoints" / "latest"
    seen = None
    while pointer.is_file() and (name := _pointed(pointer)) != seen:
        if (folder := pointer.parent / name).is_dir():
            return folder
        seen = name  # A training that goes on may have moved the pointer and dropped the folder.
    if seen is None:
        return None
    raise BadCheckpoint(f"{pointer}: names {seen!r}, which is not there. Train again")


def _pointed(pointer: Path) -> str:
    """The name in a pointer, which is never of another place."""
    name = pointer.read_bytes()[:100].decode("utf-8", "replace").strip()
    if not _FOLDER_NAME.fullmatch(name):
        raise BadCheckpoint(f"{pointer}: names {name[:40]!r}, which is not there. Train again")
    return name


def trained_checkpoint(run_dir: Path) -> Path:
    folder = latest_checkpoint(run_dir)
    if folder is None:
        raise MissingInput(f"{run_dir}: no trained model there. Give the folder of a finished run")
    return folder


def save_step(
    run_dir: Path,
    state: StepState,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    more: Mapping[str, dict[str, Tensor]] | None = None,
) -> Path:
    """Write a step's files, point `latest` to them, and drop older ones.

    A process that is killed at any moment leaves the former folder or this one.  `optimizer` is an
    Adam over `model.parameters()`; `more` has `writable` tensors of further files.
    """
    tensors: dict[str, dict[str, Tensor]] = {
        "model": writable(model.state_dict()),
        "optimizer": _optimizer_tensors(model, optimizer),
    }
    folder = checkpoint_dir(run_dir, state.step)
    temporary = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    for name, values in (tensors | dict(more or {})).items():
        # Its own writing to a file gives an error of its own for a full disk.
        (temporary / f"{name}.safetensors").write_bytes(save(values))
    write_json(temporary / STATE_FILE, state.model_dump(mode="json"))
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


def read_state(folder: Path) -> GmrState:
    """The `state.json` of a GMR's checkpoint, of former versions too."""
    return read_step_state(folder, GmrState)


def read_step_state(folder: Path, kind: type[State]) -> State:
    """A kept step's `state.json`."""
    path = folder / STATE_FILE
    try:
        value = read_json(path)
        if isinstance(value, dict) and value.get("format") in _FORMER:
            value = _brought_up(value)
        return kind.of_value(path, value)
    except (MissingInput, BadRecord) as error:
        raise BadCheckpoint(f"{error}. {REMEDY}") from None


def _brought_up(value: dict[str, Any]) -> dict[str, Any]:
    """A state of a former version as one of this.

    It lacks what later versions added, and nothing else.
    """
    version = _FORMER.index(value["format"]) + 1
    first = _FIRST_LEFT_OUT if version == 1 else {}
    model = brought_up_model(value.get("model"), version)
    return first | value | {"format": GmrState.tag(), "model": model}


def brought_up_model(model: Any, version: int = 0) -> Any:
    """A record's network of a former version as one of this; of any former one where the record
    doesn't say which."""
    if isinstance(model, dict):
        for added, keys in _ADDED_TO_MODEL.items():
            model = (keys if version < added else {}) | model
    return model


def read_model(folder: Path, which: Which = "latest") -> Gmr:
    """The network of a checkpoint, with averaged weights where the run keeps such."""
    state = read_state(folder)
    if which == "best" and state.best is None:
        raise BadCheckpoint(
            f"{folder}: no best weights, since none were scored while training. Use the latest,"
            " or train with held-out manifests"
        )
    latest: Weights = "average" if state.averaged else "model"
    kind: Weights = "best" if which == "best" else latest
    return read_network(folder, kind, state.model)


def read_network(folder: Path, name: str, config: ModelConfig) -> Gmr:
    """A network of a config, with the weights of a folder's file in float32; BadCheckpoint."""
    # The network is made once the file is known to have its weights: a record may ask for any size.
    with torch.device("meta"):
        shapes = _shapes(Gmr(config))
    tensors = _read_tensors(folder, name, shapes)
    with torch.random.fork_rng(devices=[]):  # whose first weights nobody keeps
        model = Gmr(config)
    model.load_state_dict(tensors)
    return model


def read_best(folder: Path) -> Best | None:
    """The best weights up to a checkpoint; None where nothing was scored."""
    score = read_state(folder).best
    return None if score is None else Best(score, _read_tensors(folder, "best"))


def load_weights(folder: Path, model: nn.Module, kind: Weights = "model") -> None:
    """Fill a network with a checkpoint's weights; BadCheckpoint where they are of another one."""
    model.load_state_dict(_read_tensors(folder, kind, _shapes(model)))


def _shapes(model: nn.Module) -> dict[str, torch.Size]:
    return {name: tensor.shape for name, tensor in model.state_dict().items()}


def load_optimizer(folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer) -> None:
    """Fill an optimiser that was just made over `model.parameters()`; errors as `load_weights`."""
    shapes, state = {}, {}
    for name, parameter in model.named_parameters():
        shapes[f"{name}.step"] = torch.Size(())
        shapes |= {f"{name}.{key}": parameter.shape for key in _MOMENTS}
    tensors = _read_tensors(folder, "optimizer", shapes)
    for i, (name, _) in enumerate(model.named_parameters()):
        state[i] = {key: tensors[f"{name}.{key}"] for key in ("step", *_MOMENTS)}
    optimizer.load_state_dict(optimizer.state_dict() | {"state": state})


def writable(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Copies on the CPU that share no memory: a GRU on a GPU keeps its weights in one buffer."""
    return {name: tensor.detach().cpu().clone().contiguous() for name, tensor in tensors.items()}


def _optimizer_tensors(model: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    state = optimizer.state_dict()["state"]
    names = enumerate(name for name, _ in model.named_parameters())
    return writable(
        {f"{name}.{key}": value for i, name in names for key, value in state[i].items()}
    )


def _read_tensors(
    folder: Path, name: str, shapes: dict[str, torch.Size] | None = None
) -> dict[str, Tensor]:
    """The tensors of a file, of the names and shapes that are given if any are."""
    path = folder / f"{name}.safetensors"
    try:
        tensors: dict[str, Tensor] = load_file(path)
    except (SafetensorError, OSError) as error:
        raise BadCheckpoint(
            f"{path}: truncated, missing or not safetensors ({error}). Train again"
        ) from None
    for key, tensor in tensors.items():
        if not tensor.is_floating_point():
            raise BadCheckpoint(f"{path}: {key} is of {tensor.dtype}, no weights. Train again")
        if not tensor.float().isfinite().all():
            raise BadCheckpoint(f"{path}: {key} holds NaN or infinite numbers. Train again")
    actual = {name: tensor.shape for name, tensor in tensors.items()}
    if shapes is None or actual == shapes:
        return tensors
    differing = sorted({name for name, _ in actual.items() ^ shapes.items()})
    raise BadCheckpoint(
        f"{path}: of another model; differing tensors: {', '.join(differing[:5])}"
        f"{' ...' if len(differing) > 5 else ''}. Use the run's own settings, or train again"
    )


def _fsync(path: Path) -> None:
    try:
        descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    except PermissionError:
        if sys.platform != "win32":
            raise
        return  # Windows opens no folder
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
