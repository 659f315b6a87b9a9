"""A sequence, its mirror image, its reverse, and both: one motion, seen in four ways.

A network that is trained on windows with left and right exchanged and on windows played backwards
should answer alike to all four.  Where it doesn't, the mean of its four answers, each turned back,
is nearer to the truth than one of them.
"""

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.values.body import MIRROR, MIRRORED
from gmrdata.values.shapes import Float, Int

COUNTERPARTS = [joint - 1 for joint in MIRRORED[1:]]
"""Row of each joint's counterpart among the 23 local rotations."""


def four_ways(
    local_rotmats: Float[Tensor, "batch frames 23 3 3"], lengths: Int[Tensor, " batch"] | None
) -> list[Float[Tensor, "batch frames 23 3 3"]]:
    """As given, mirrored, reversed, and both.  `lengths` frames are real; None: all.

    Behind its end a sequence holds its last pose.
    """
    at, last = _at_and_last(local_rotmats, lengths)
    ways = []
    for frames in (torch.minimum(at, last), (last - at).clamp(min=0)):
        played = _frames_of(local_rotmats, frames)
        ways += [played, played[:, :, COUNTERPARTS] * _signs(played)]
    return ways


def mean_of_four(
    motions: list[tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]],
    lengths: Int[Tensor, " batch"] | None,
) -> tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]:
    """The mean of motions that belong to `four_ways`.

    dR of frames i to i+1 is the transpose of the one back, dR', and dT = -dR dT'.  What leads out
    of a sequence, its last motion, has no meaning.
    """
    at, last = _at_and_last(motions[0][1], lengths)
    back = (last - 1 - at).clamp(min=0)
    found = []
    for way, (turns, moves_m) in enumerate(motions):
        if way % 2:
            turns, moves_m = turns * _signs(turns), moves_m * moves_m.new_tensor(MIRROR)
        if way >= 2:
            turns, moves_m = _frames_of(turns.transpose(-1, -2), back), _frames_of(moves_m, back)
            moves_m = -(turns @ moves_m[..., None])[..., 0]
        found.append((turns, moves_m))
    return mean_motion(found)


def mean_motion(
    motions: list[tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3"]]],
) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3"]]:
    """Mean of dR and dT.

    Rotations are averaged as unit quaternions on the first one's side: the chordal mean on SO(3)
    (Hartley et al. 2013, section 5.3), which does not depend on their order.
    """
    delta_m = torch.stack([moves_m for _, moves_m in motions]).mean(0)
    turns = torch.stack([rotations.from_rotmats(found, "quaternion") for found, _ in motions])
    sides = torch.where((turns * turns[0]).sum(-1, keepdim=True) < 0, -turns, turns)
    return rotations.to_rotmats(sides.mean(0), "quaternion"), delta_m


def _at_and_last(values: Tensor, lengths: Tensor | None) -> tuple[Tensor, Tensor]:
    """Numbers of the frames (1, frames), and of each sequence's last one (batch or 1, 1)."""
    at = torch.arange(values.shape[1], device=values.device)[None]
    return at, at[:, -1:] if lengths is None else lengths.to(values.device)[:, None] - 1


def _frames_of(values: Tensor, frames: Int[Tensor, "batch frames"]) -> Tensor:
    """Each sequence's values (batch, frames, ...) in another order of its frames."""
    rows = torch.arange(values.shape[0], device=values.device)[:, None]
    return values[rows, frames]


def _signs(rotmats: Tensor) -> Tensor:
    """M R M multiplies each entry of R by one of these."""
    mirror = rotmats.new_tensor(MIRROR)
    return mirror[:, None] * mirror
