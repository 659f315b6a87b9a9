"""The training loss: the paper's eq. 5 with eqs. 9-14.

The paper writes every term as a sum, over T motions and 6890 vertices.  Taken literally, with
weights 1, 1, 1, 0.01, the vertex term outweighs the others by 10^3 to 10^4; so `mean` is the
default reduction and `sum` is an option.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.config import LossConfig


@dataclass(frozen=True, eq=False)
class Motions:
    """Motions of a batch: dR (B, T-1, 3, 3) and dT (B, T-1, 3) [m]."""

    rotmats: Tensor
    metres: Tensor


@dataclass(frozen=True, eq=False)
class LossTerms:
    """The loss and its unweighted terms, each a scalar tensor."""

    total: Tensor
    orientation: Tensor
    translation: Tensor
    vertex: Tensor
    smoothness: Tensor


def gmr_loss(
    predicted: Motions,
    true: Motions,
    mask: Tensor,
    vertices_m: Tensor | None,
    n_body_vertices: int,
    config: LossConfig,
) -> LossTerms:
    """Eq. 5.

    Args:
        predicted: The network's motions, the last one already dropped.
        true: The true ones.
        mask: (B, T-1) bool: motions that count; padding is False.
        vertices_m: (B, T-1, N, 3) posed vertices of the first frame of each motion, root at
            identity and pelvis at the origin [m]; None where `config.vertex` is 0.
        n_body_vertices: Vertices of the whole body, of which N may be a subset.
        config: Weights and readings.
    """
    orientation = _orientation(predicted.rotmats, true.rotmats, config.orientation_loss)
    translation = (predicted.metres - true.metres).square().sum(-1)
    both = mask[:, 1:] & mask[:, :-1]
    terms = {
        "orientation": _reduce(orientation, mask, config),
        "translation": _reduce(translation, mask, config),
        "smoothness": _reduce(_smoothness(predicted.rotmats), both, config),
        "vertex": orientation.new_zeros(()),
    }
    if vertices_m is not None:
        per_vertex_m = vertex_l1_m(predicted, true, vertices_m)
        scale = n_body_vertices if config.reduction == "sum" else 1
        terms["vertex"] = _reduce(per_vertex_m * scale, mask, config)
    total = sum((getattr(config, name) * term for name, term in terms.items()), torch.zeros(()))
    return LossTerms(total=total, **terms)


def vertex_l1_m(predicted: Motions, true: Motions, vertices_m: Tensor) -> Tensor:
    """Mean over vertices of eq. 13's L1 distance, per motion: (B, T-1) [m].

    The mesh of eq. 13 is M([dA, L], beta, dT), and with the local pose L given only the root
    differs between prediction and truth.  So the body is posed once, outside autograd, and (dR v +
    dT) - (dR* v + dT*) = (dR - dR*) v + (dT - dT*).
    """
    difference = (predicted.rotmats - true.rotmats).transpose(-1, -2)
    offsets_m = vertices_m @ difference + (predicted.metres - true.metres)[..., None, :]
    return offsets_m.abs().sum(-1).mean(-1)


def _orientation(predicted: Tensor, true: Tensor, kind: str) -> Tensor:
    """Eqs. 9-11 per motion: (..., 3, 3) twice -> (...)."""
    if kind == "chordal":
        return (predicted - true).square().sum((-1, -2))
    if kind == "angular":
        return rotations.log_map(predicted @ true.transpose(-1, -2)).square().sum(-1)
    return (rotations.log_map(predicted) - rotations.log_map(true)).square().sum(-1)


def _smoothness(rotmats: Tensor) -> Tensor:
    """Eq. 14 per pair of adjacent motions: (B, T-1, 3, 3) -> (B, T-2)."""
    return (rotmats[:, 1:] - rotmats[:, :-1]).square().sum((-1, -2))


def _reduce(values: Tensor, mask: Tensor, config: LossConfig) -> Tensor:
    """Masked mean, or sum over time and mean over windows, of (B, n) values."""
    total = torch.where(mask, values, 0.0).sum()
    return total / (mask.sum().clamp_min(1) if config.reduction == "mean" else len(values))
