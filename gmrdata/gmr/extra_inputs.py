"""What the network may be given beside the local rotations: functions of them, and of nothing else.

The motion of the root cannot be seen in one local pose, only in how poses follow each other, and
mostly in the joints that stand on the floor.  With few data it helps to say so.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.config import ExtraInput
from gmrdata.gmr.root_frame import joints_in_root_frame

SCALE = 10.0
"""Motions at 10 fps are about 0.1 rad and 0.1 m; the network's other numbers are about 1."""


def velocities(local_rotmats: Tensor) -> Tensor:
    """How each joint turns to the next frame: axis-angle of R_i^T R_{i+1}, in `SCALE`-ths [rad].

    Args:
        local_rotmats: (..., T, 23, 3, 3) parent_from_joint.

    Returns:
        (..., T, 23, 3); zero in the last frame, which has no next one.
    """
    turns = local_rotmats[..., :-1, :, :, :].transpose(-1, -2) @ local_rotmats[..., 1:, :, :, :]
    return _with_last(SCALE * rotations.log_map(turns))


def motions_if_standing(local_rotmats: Tensor) -> Tensor:
    """For each joint, the motion that the root would make if this joint stood still.

    With A_i the rotation and p_i the place of a joint in the root's frame, a joint that neither
    turns nor moves in the world means dR = A_i A_{i+1}^T and dT = p_i - dR p_{i+1}.

    Args:
        local_rotmats: (..., T, 23, 3, 3) parent_from_joint.

    Returns:
        (..., T, 23, 6): axis-angle of dR [rad] and dT [m], both times `SCALE`; zero in the last
        frame, which has no next one.
    """
    joints_m, root_from_joint = joints_in_root_frame(local_rotmats)
    delta_rotmats = root_from_joint[..., :-1, :, :, :] @ root_from_joint[..., 1:, :, :, :].mT
    moved_m = (delta_rotmats @ joints_m[..., 1:, :, :, None])[..., 0]
    delta_m = joints_m[..., :-1, :, :] - moved_m
    return _with_last(SCALE * torch.cat([rotations.log_map(delta_rotmats), delta_m], dim=-1))


SIZE: dict[ExtraInput, int] = {"velocity": 3, "standing": 6}
"""Numbers per joint."""

MAKE: dict[ExtraInput, Callable[[Tensor], Tensor]] = {
    "velocity": velocities,
    "standing": motions_if_standing,
}
"""Functions from (..., T, 23, 3, 3) to (..., T, 23, `SIZE`)."""


def _with_last(values: Tensor) -> Tensor:
    """A frame of zeros after the last one: (..., T-1, 23, n) -> (..., T, 23, n)."""
    return torch.cat([values, torch.zeros_like(values[..., :1, :, :])], dim=-3)
