"""Weights and the optimiser's state as safetensors files, held against the network they are for."""

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from gmrdata.errors import BadCheckpoint

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
