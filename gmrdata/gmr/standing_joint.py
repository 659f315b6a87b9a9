"""The root's translation as what a standing joint leaves to it.

A foot that stands does not move in the world, so the root moves by what the foot moves in the
root's frame.  With p_i the place of a joint there, that is dT = p_i - dR p_{i+1} (eqs. 3-4 with the
joint's place in the world unchanged).  Unlike `extra_inputs.motions_if_standing` this asks only for
a point at rest, about which the foot may turn, and takes dR from the network.
"""

import torch
from torch import Tensor, nn

from gmrdata.body.tree import N_LOCAL
from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation
from gmrdata.gmr.root_frame import joints_in_root_frame


class StandingJoint(nn.Module):
    """Which joint stands, as shares that sum to 1 over the joints 1..23 and none of them."""

    def __init__(self, n_features: int) -> None:
        super().__init__()
        self.logits = nn.Linear(n_features, N_LOCAL + 1)

    def forward(self, features: Tensor, places_m: Tensor, delta_rotmats: Tensor) -> Tensor:
        """dT (B, T, 3) [m]: the mean of what each joint leaves to the root; none leaves nothing.

        Args:
            features: (B, T, n).
            places_m: (B, T, 23, 3) joints in the root's frame [m].
            delta_rotmats: (B, T, 3, 3) dR.
        """
        shares = self.logits(features).softmax(-1)[..., :N_LOCAL]
        return (shares[..., None] * steps_if_still(places_m, delta_rotmats)).sum(-2)


def steps_if_still(places_m: Tensor, delta_rotmats: Tensor) -> Tensor:
    """dT if a joint's place does not move in the world: (B, T, 23, 3) [m].

    Args:
        places_m: (B, T, 23, 3) joints in the root's frame [m].
        delta_rotmats: (B, T, 3, 3) dR; the last one leads out of the sequence, as if to the last
            frame again.
    """
    next_m = torch.cat([places_m[:, 1:], places_m[:, -1:]], dim=1)
    return places_m - next_m @ delta_rotmats.mT


def places_seen(poses: Tensor, representation: Representation) -> Tensor:
    """Joints in the root's frame (B, T, 23, 3) [m], from the network's input (B, T, D).

    The local rotations come first in the input.  Frames of zeros, which are padding, give places
    of no meaning, but finite ones.
    """
    local = poses[..., : N_LOCAL * rotations.SIZE[representation]].unflatten(-1, (N_LOCAL, -1))
    with torch.no_grad():
        return joints_in_root_frame(rotations.to_rotmats(local, representation))[0]
