"""The training loss: the paper's eq. 5 with eqs. 9-14.

The paper writes every term as a sum, over T motions and 6890 vertices.  Taken literally, with
weights 1, 1, 1, 0.01, the vertex term outweighs the others by 10^3 to 10^4; so `mean` is the
default reduction and `sum` is an option.

Eq. 13 is the L1 distance of two meshes M([dA, L], beta, dT), value and gradient in one pass.  With
the local pose L given, only the root differs between prediction and truth, so the body is posed
once, outside autograd: (dR v + dT) - (dR* v + dT*) = (dR - dR*) v + (dT - dT*).  Vertices are made,
compared and forgotten block by block, while they are in the processor's cache; for the backward
pass nothing is kept but the gradient of each motion's 12 numbers, which is made with its value.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from gmrdata.gmr import rotations
from gmrdata.gmr.config import LossConfig
from gmrdata.values.body import BodyModel, names_of, vertex_rows
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.shapes import Bool, Float
from gmrdata.values.skinning_torch import joint_transforms

BLOCK_VERTICES = 1024  # on the CPU; a GPU takes all at once
CHUNK_BYTES = {"cpu": 2 << 20, "cuda": 512 << 20}  # share of a cache, or of a GPU, for a block


@dataclass(frozen=True, eq=False)
class VertexBlock:
    """Vertices that few joints move, with coordinates before vertices: all x, all y, all z."""

    joints: Tensor  # (J,) int64: those that move any of the v vertices
    weights: Tensor  # (J, v) share of each joint in each vertex
    template_m: Tensor  # (3 v,) rest vertices of the mean shape, seen from the pelvis [m]
    shape_dirs_m: Tensor  # (3 v, S) their offset for one unit of each shape coefficient [m]
    pose_dirs_m: Tensor | None  # (3 v, 207) their offset per entry of (local rotation - I) [m]


@dataclass(frozen=True, eq=False)
class LossBody:
    """A body, and blocks of the `n_vertices` vertices that the loss looks at."""

    body: BodyModel
    n_vertices: int
    blocks: tuple[VertexBlock, ...]


@dataclass(frozen=True, eq=False)
class Bodies:
    """The people of a batch, in the first frame of each motion."""

    bodies: tuple[LossBody, ...]  # of one mesh and as many coefficients
    shape: Tensor  # (B, S) coefficients
    local_rotmats: Tensor  # (B, T-1, 23, 3, 3) parent_from_joint
    numbers: Tensor | None = None  # (B,) int64 on the CPU: whose body is which; None for one body

    @property
    def n_mesh_vertices(self) -> int:
        """Vertices of the whole mesh."""
        return len(self.bodies[0].body.template_m)

    def of_body(self, number: int, windows: Tensor) -> "Bodies":
        """Those of some windows, whose people all have one body."""
        one = (self.bodies[number],)
        return Bodies(one, self.shape[windows], self.local_rotmats[windows])


def make_loss_bodies(
    bodies: Sequence[BodyModel],
    n_vertices: int | None,
    device: str,
    dtype: torch.dtype = torch.float32,
) -> tuple[LossBody, ...]:
    """`make_loss_body` of each; BadBodyFile where their meshes or shapes differ in size."""
    sizes = {(len(body.template_m), body.n_shape) for body in bodies}
    if len(sizes) > 1:
        what = "have meshes or shapes of different sizes. Give bodies of one kind"
        raise BadBodyFile(f"the bodies {names_of(bodies)} {what}")
    return tuple(make_loss_body(body, n_vertices, device, dtype) for body in bodies)


def make_loss_body(
    body: BodyModel, n_vertices: int | None, device: str, dtype: torch.dtype = torch.float32
) -> LossBody:
    """Sort vertices into blocks: some, evenly spread over the body's list, or for None all."""
    rows = vertex_rows(len(body.template_m), n_vertices)
    n_blocks = 1
    if device == "cpu":
        # Neighbours in this order share joints, and a product over few joints is short.
        strongest = np.argsort(-body.skin_weights[rows], axis=1, kind="stable")
        rows = rows[np.lexsort((strongest[:, 1], strongest[:, 0]))]
        n_blocks = -(-len(rows) // BLOCK_VERTICES)
    blocks = tuple(_block(body, part, device, dtype) for part in np.array_split(rows, n_blocks))
    return LossBody(body, len(rows), blocks)


def _block(body: BodyModel, rows: np.ndarray, device: str, dtype: torch.dtype) -> VertexBlock:
    def coordinates_first(array: np.ndarray) -> Tensor:
        tensor = torch.as_tensor(array.swapaxes(0, 1), dtype=dtype, device=device)
        return tensor.contiguous().flatten(0, 1)

    weights = body.skin_weights[rows]
    joints = np.flatnonzero(weights.any(axis=0))
    # The pelvis is linear in the shape, as the vertices are.
    template_m = body.template_m[rows] - body.joints_template_m[0]
    shape_dirs_m = body.shape_dirs_m[rows] - body.joint_shape_dirs_m[0]
    return VertexBlock(
        joints=torch.as_tensor(joints, device=device),
        weights=torch.as_tensor(weights.T[joints].copy(), dtype=dtype, device=device),
        template_m=coordinates_first(template_m),
        shape_dirs_m=coordinates_first(shape_dirs_m),
        pose_dirs_m=None if body.pose_dirs_m is None else coordinates_first(body.pose_dirs_m[rows]),
    )


def vertex_l1_m(
    difference: Float[Tensor, "batch motions 3 3"],
    difference_m: Float[Tensor, "batch motions 3"],
    bodies: Bodies,
) -> Float[Tensor, "batch motions"]:
    """Mean over vertices of eq. 13's L1 distance per motion [m], of dR - dR* and dT - dT* [m]."""
    if len(bodies.bodies) == 1 or bodies.numbers is None:
        sums_m: Tensor = _SummedL1.apply(difference, difference_m, bodies)
        return sums_m / bodies.bodies[0].n_vertices
    means_m = torch.zeros_like(difference_m[..., 0])
    for number in bodies.numbers.unique().tolist():
        windows = torch.nonzero(bodies.numbers == number)[:, 0].to(difference.device)
        people = bodies.of_body(number, windows)
        own_m = vertex_l1_m(difference[windows], difference_m[windows], people)
        means_m = means_m.index_add(0, windows, own_m)
    return means_m


class _SummedL1(torch.autograd.Function):
    """Sum over vertices of |D v + d|: of D (B, n, 3, 3) and d (B, n, 3), (B, n)."""

    @staticmethod
    def forward(ctx: Any, turns: Tensor, moves_m: Tensor, bodies: Bodies) -> Tensor:
        shape, local_rotmats = bodies.shape, bodies.local_rotmats
        transforms = joint_transforms(bodies.bodies[0].body, shape[:, None], local_rotmats)
        transforms = transforms.permute(0, 1, 3, 4, 2).contiguous()
        sums_m = turns.new_zeros(turns.shape[:2])
        by_turns, by_moves = torch.zeros_like(turns), torch.zeros_like(moves_m)
        for block in bodies.bodies[0].blocks:
            for rows in _chunks(turns, block):
                vertices_m = _vertices_m(block, shape[rows], local_rotmats[rows], transforms[rows])
                offsets_m = turns[rows] @ vertices_m + moves_m[rows, :, :, None]
                sums_m[rows] += offsets_m.abs().sum((-1, -2))
                signs = offsets_m.sign_()
                by_turns[rows] += signs @ vertices_m.mT
                by_moves[rows] += signs.sum(-1)
        ctx.save_for_backward(by_turns, by_moves)
        return sums_m

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_sums: Tensor) -> tuple[Tensor, Tensor, None]:
        by_turns, by_moves = ctx.saved_tensors
        return by_sums[..., None, None] * by_turns, by_sums[..., None] * by_moves, None


def _chunks(turns: Tensor, block: VertexBlock) -> list[slice]:
    """Windows to take at once: as many as fit the cache, and at least one."""
    n_windows, n_motions = turns.shape[:2]
    numbers = 3 if block.pose_dirs_m is None else 12
    window_bytes = n_motions * numbers * block.weights.shape[1] * turns.element_size()
    size = max(1, CHUNK_BYTES[turns.device.type] // window_bytes)
    return [slice(start, start + size) for start in range(0, n_windows, size)]


def _vertices_m(
    block: VertexBlock,
    shape: Float[Tensor, "batch coefficients"],
    local_rotmats: Float[Tensor, "batch motions 23 3 3"],
    transforms: Float[Tensor, "batch motions 3 4 24"],
) -> Float[Tensor, "batch motions 3 vertices"]:
    """Posed vertices, root at identity and pelvis at the origin [m]."""
    transforms = transforms.index_select(-1, block.joints)
    rest_m = block.template_m + shape @ block.shape_dirs_m.T
    if block.pose_dirs_m is None:
        # Rest vertices are the same in all frames: one product does skinning and transforms.
        points = torch.nn.functional.pad(rest_m.unflatten(-1, (3, -1)), (0, 0, 0, 1), value=1.0)
        shares_m = (points[:, :, None] * block.weights).flatten(1, 2)
        return (transforms.flatten(-2).flatten(1, 2) @ shares_m).unflatten(1, (-1, 3))
    bends = (local_rotmats - torch.eye(3).to(local_rotmats)).flatten(-3)
    rest_m = (rest_m[:, None] + bends @ block.pose_dirs_m.T).unflatten(-1, (3, -1))
    blended = transforms @ block.weights
    vertices_m = blended[..., 3, :]
    for axis in range(3):
        vertices_m = torch.addcmul(vertices_m, blended[..., axis, :], rest_m[..., None, axis, :])
    return vertices_m


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
