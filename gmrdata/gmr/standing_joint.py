"""The root's motion as what a standing joint leaves to it.

A foot that stands neither turns nor moves in the world, so the root turns and moves by what the
foot does in the root's frame.  With A_i the rotation and p_i the place of a joint there,
dR = A_i A_{i+1}^T (eq. 3 with the joint's rotation in the world unchanged), and given dR,
dT = p_i - dR p_{i+1} (eqs. 3-4 with its place unchanged).  The second asks only for a point at
rest, about which the foot may turn; `extra_inputs.motions_if_standing` takes dR for it from the
same joint, this from the network.
"""

import torch
from torch import Tensor, nn

from gmrdata.body.tree import N_LOCAL
from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation
from gmrdata.gmr.root_frame import joints_in_root_frame


class StandingShares(nn.Module):
    """Which joint stands, as shares that sum to 1 over the joints 1..23 and none of them."""

    def __init__(self, n_features: int) -> None:
        super().__init__()
        self.logits = nn.Linear(n_features, N_LOCAL + 1)

    def forward(self, features: Tensor) -> Tensor:
        """Shares of the joints, without that of none: (B, T, n) -> (B, T, 23, 1)."""
        return self.logits(features).softmax(-1)[..., :N_LOCAL, None]


def root_turn(shares: Tensor, root_from_joint: Tensor) -> Tensor:
    """dR (B, T, 3, 3): the mean, as axis-angle, of what each joint leaves; none leaves no turn.

    Args:
        shares: (B, T, 23, 1).
        root_from_joint: (B, T, 23, 3, 3).
    """
    turns = rotations.log_map(root_from_joint @ _next(root_from_joint).mT)
    return rotations.to_rotmats((shares * turns).sum(-2), "axis-angle")


def root_step_m(shares: Tensor, places_m: Tensor, delta_rotmats: Tensor) -> Tensor:
    """dT (B, T, 3) [m]: the mean of what each joint leaves to the root; none leaves no step.

    Args:
        shares: (B, T, 23, 1).
        places_m: (B, T, 23, 3) joints in the root's frame [m].
        delta_rotmats: (B, T, 3, 3) dR.
    """
    return (shares * (places_m - _next(places_m) @ delta_rotmats.mT)).sum(-2)


def joints_seen(poses: Tensor, representation: Representation) -> tuple[Tensor, Tensor]:
    """Joints in the root's frame, from the network's input (B, T, D).

    The local rotations come first in the input.  Frames of zeros, which are padding, give values
    of no meaning, but finite ones.

    Returns:
        Places (B, T, 23, 3) [m] and root_from_joint (B, T, 23, 3, 3).
    """
    local = poses[..., : N_LOCAL * rotations.SIZE[representation]].unflatten(-1, (N_LOCAL, -1))
    with torch.no_grad():
        return joints_in_root_frame(rotations.to_rotmats(local, representation))


def _next(values: Tensor) -> Tensor:
    """Each frame's next one along axis 1, and the last again: its motion leads out."""
    return torch.cat([values[:, 1:], values[:, -1:]], dim=1)
