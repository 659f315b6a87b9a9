"""Rotation representations of the network's input and output, as thin conversions over roma.

Quaternions are w first.  6D is the first two columns of the matrix, one after the other (Zhou et
al. 2019).  roma is imported where it is used, since that takes seconds.
"""

import torch
from torch import Tensor

from gmrdata.gmr.config import Representation
from gmrdata.values.shapes import Float, Int

Sequences = Float[Tensor, "batch frames numbers"]
Features = Float[Tensor, "batch frames features"]
Lengths = Int[Tensor, " batch"] | None  # how many frames of each sequence are real; None: all
Answer = tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]
"""dR, and dT [m], from each frame to the next; the last leads out of the sequence."""

SIZE: dict[Representation, int] = {"quaternion": 4, "axis-angle": 3, "6d": 6}  # per rotation
IDENTITY: dict[Representation, tuple[float, ...]] = {
    "quaternion": (1.0, 0.0, 0.0, 0.0),
    "axis-angle": (0.0, 0.0, 0.0),
    "6d": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0),
}


def from_rotmats(
    rotmats: Float[Tensor, "*batch 3 3"], representation: Representation
) -> Float[Tensor, "*batch numbers"]:
    """Rotations as 3, 4 or 6 numbers: quaternions with w >= 0, axis-angle vectors of at most pi."""
    import roma

    if representation == "quaternion":
        quaternions = roma.quat_xyzw_to_wxyz(_unit_quaternions(rotmats))
        return torch.where(quaternions[..., :1] < 0, -quaternions, quaternions)
    if representation == "axis-angle":
        return roma.unitquat_to_rotvec(_unit_quaternions(rotmats))
    return rotmats[..., :, :2].transpose(-1, -2).flatten(-2)


def _unit_quaternions(rotmats: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 4"]:
    """`roma.rotmat_to_unitquat`, w last, bit for bit, in a quarter of the time.

    Of 4 x q, 4 y q, 4 z q and 4 w q (Markley 2008, eqs. 7 to 9) it takes the one of the largest
    factor by comparisons: indices of many rows of four are slow on the CPU.
    """
    (a, b, c), (d, e, f), (g, h, i) = (
        row.unbind(-1) for row in rotmats.transpose(-1, -2).unbind(-2)
    )
    squares = 1 + a - e - i, 1 + e - i - a, 1 + i - a - e, 1 + a + e + i
    xy, xz, yz, xw, yw, zw = b + d, c + g, f + h, f - h, g - c, b - d
    first, last = torch.maximum(*squares[:2]), torch.maximum(*squares[2:])
    is_first, is_x, is_z = first >= last, squares[0] >= squares[1], squares[2] >= squares[3]
    rows = (
        (squares[0], xy, xz, xw), (xy, squares[1], yz, yw),
        (xz, yz, squares[2], zw), (xw, yw, zw, squares[3]),
    )  # fmt: skip
    chosen = [
        torch.where(is_first, torch.where(is_x, x, y), torch.where(is_z, z, w))
        for x, y, z, w in zip(*rows, strict=True)
    ]
    scaled = torch.stack(chosen, dim=-1)
    return scaled / torch.linalg.vector_norm(scaled, dim=-1, keepdim=True)


def to_rotmats(
    values: Float[Tensor, "*batch numbers"], representation: Representation
) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrices of any 3, 4 or 6 numbers, as a network puts them out.

    Quaternions are normalised and 6D goes through Gram-Schmidt.  Gradients are finite for all
    values but the zero quaternion and dependent 6D columns.
    """
    import roma

    if representation == "quaternion":
        unit = torch.nn.functional.normalize(values, dim=-1)
        return roma.unitquat_to_rotmat(roma.quat_wxyz_to_xyzw(unit))
    if representation == "axis-angle":
        return roma.rotvec_to_rotmat(values)
    columns = torch.stack([values[..., :3], values[..., 3:]], dim=-1)
    return roma.special_gramschmidt(columns, epsilon=torch.finfo(values.dtype).eps)


def log_map(rotmats: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """Axis-angle vectors of length at most pi [rad]."""
    return from_rotmats(rotmats, "axis-angle")


def continuous_in_time(
    quaternions: Float[Tensor, "*batch frames joints 4"],
) -> Float[Tensor, "*batch frames joints 4"]:
    """Signs that never jump in time, w >= 0 in the first frame: q and -q are one rotation."""
    before, after = quaternions[..., :-1, :, :], quaternions[..., 1:, :, :]
    jumps = torch.cat([quaternions[..., :1, :, :1] < 0, (after * before).sum(-1, True) < 0], dim=-3)
    # A sum, not a product of signs, since ONNX has no cumulative product.
    is_odd = torch.cumsum(jumps.to(quaternions), dim=-3).remainder(2.0)
    return quaternions * (1.0 - 2.0 * is_odd)
