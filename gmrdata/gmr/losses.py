"""The training loss: the paper's eq. 5 with eqs. 9-14.

The paper writes every term as a sum, over T motions and 6890 vertices.  Taken literally, with
weights 1, 1, 1, 0.01, the vertex term outweighs the others by 10^3 to 10^4; so `mean` is the
default reduction and `sum` is an option.
"""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.config import LossConfig
from gmrdata.gmr.vertex_loss import Bodies, vertex_l1_m
from gmrdata.values.shapes import Bool, Float


@dataclass(frozen=True, eq=False)
class Motions:
    """Motions of a batch: dR and dT [m]."""

    delta_rotmats: Float[Tensor, "batch motions 3 3"]
    delta_m: Float[Tensor, "batch motions 3"]

    def to(self, device: torch.device | str) -> Self:
        return type(self)(self.delta_rotmats.to(device), self.delta_m.to(device))

    def __getitem__(self, windows: slice) -> Self:
        return type(self)(self.delta_rotmats[windows], self.delta_m[windows])


@dataclass(frozen=True)
class Counts:
    """What the terms of a step are means over.

    Where processes share a step, these are the whole step's counts divided by their number: the
    mean over the processes, of losses and of gradients, then is the mean over the step.
    """

    motions: float  # between real frames
    pairs: float  # adjacent two of them
    windows: float


def counts_of(mask: Bool[Tensor, "batch motions"], processes: int = 1) -> Counts:
    """Counts of a whole step's mask, for each of some processes."""
    motions, pairs = max(1, int(mask.sum())), max(1, int(_pairs(mask).sum()))
    return Counts(motions / processes, pairs / processes, len(mask) / processes)


def gmr_loss(
    predicted: Motions,
    true: Motions,
    mask: Bool[Tensor, "batch motions"],
    bodies: Bodies | None,
    config: LossConfig,
    counts: Counts | None = None,
) -> dict[str, Tensor]:
    """Eq. 5: `loss`, and its terms before they are weighted, by the names of their weights.

    `mask` is False in padding.  `bodies` are the people in the first frame of each motion; None
    where `config.vertex` is 0.  Means are over `counts`, if not over what `mask` has.
    """
    counts = counts or counts_of(mask)
    orientation = _orientation(predicted.delta_rotmats, true.delta_rotmats, config.orientation_loss)
    translation = (predicted.delta_m - true.delta_m).square().sum(-1)
    if config.error == "length":
        orientation, translation = _length(orientation), _length(translation)
    # Eq. 14 per pair of adjacent motions: (B, T-1, 3, 3) -> (B, T-2).
    changes = predicted.delta_rotmats[:, 1:] - predicted.delta_rotmats[:, :-1]
    smoothness = changes.square().sum((-1, -2))
    mean = config.reduction == "mean"
    motions = counts.motions if mean else counts.windows
    terms = {
        "orientation": _total(orientation, mask) / motions,
        "translation": _total(translation, mask) / motions,
        "vertex": orientation.new_zeros(()),
        "smoothness": _total(smoothness, _pairs(mask)) / (counts.pairs if mean else motions),
    }
    if bodies is not None:
        per_vertex_m = vertex_l1_m(
            predicted.delta_rotmats - true.delta_rotmats, predicted.delta_m - true.delta_m, bodies
        )
        scale = 1 if mean else bodies.n_mesh_vertices
        terms["vertex"] = _total(per_vertex_m, mask) * scale / motions
    loss = config.orientation * terms["orientation"] + config.translation * terms["translation"]
    loss = loss + config.smoothness * terms["smoothness"] + config.vertex * terms["vertex"]
    return {"loss": loss} | terms


LEAST = 1e-6  # square of what is no error: 1 mm, 0.06 degrees; the root's slope there is finite


def _length(squared: Tensor) -> Tensor:
    return (squared + LEAST).sqrt()


def _orientation(predicted: Tensor, true: Tensor, kind: str) -> Tensor:
    """Eqs. 9-11 per motion: (..., 3, 3) twice -> (...)."""
    if kind == "chordal":
        return (predicted - true).square().sum((-1, -2))
    if kind == "angular":
        return rotations.log_map(predicted @ true.transpose(-1, -2)).square().sum(-1)
    return (rotations.log_map(predicted) - rotations.log_map(true)).square().sum(-1)


def _pairs(mask: Tensor) -> Tensor:
    """Where a motion and the next both count: (B, T-1) -> (B, T-2)."""
    return mask[:, 1:] & mask[:, :-1]


def _total(values: Tensor, mask: Tensor) -> Tensor:
    """Sum over a batch (B, n) without its padding."""
    return torch.where(mask, values, 0.0).sum()
