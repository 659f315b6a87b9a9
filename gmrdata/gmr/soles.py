"""Soles that stand hold the body: a predicted motion, corrected by its own heels, balls and toes.

A network's turn of the root errs by some degrees a second, which moves a standing foot, 0.9 m
below, by centimetres.  Heels, balls and toes are known from the root, so a predicted motion says
how each of them moves in the world; one that hardly moves stands, and then it does not move at all.
The motion is corrected by least squares between the network, which errs, and the points, of which
each counts by how still it is (Geman & McClure 1987).  What swings counts for nothing, so a run or
a jump stays as the network has it.  All errors are rates: no frame rate is special.
"""

import math

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.model import joints_in_root_frame
from gmrdata.gmr.supports import solved
from gmrdata.values.body import JOINT
from gmrdata.values.shapes import Float

TURN_SIGMA_RAD_PER_S = tuple(map(math.radians, (8.0, 15.0, 8.0)))
"""Error of a network's turn about the root's left, up and front."""
STEP_SIGMA_M_PER_S = 0.05  # of its step, along each axis
SLIP_SIGMA_M_PER_S = 0.07
"""Speed of a standing point: errors of a leg's joints.  Half of it serves true poses a little
better, and those with 3 degrees of error on each joint worse."""
STILL_M_PER_S = 0.15  # speed of a point that counts for a quarter of one at rest
ITERATIONS = 8
RIGHT_SOLE_M = {
    "ankle": ((0.001, -0.094, -0.016),),
    "foot": ((0.011, -0.027, -0.013), (0.021, -0.027, 0.028)),
}
"""Heel, and ball and toe, of the mean skeleton's right foot, from a joint in the T-pose [m]."""

Deltas = tuple[Float[Tensor, "*batch motions 3 3"], Float[Tensor, "*batch motions 3"]]
"""dR and dT [m] of the root from each pose to the next."""


def held_by_soles(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"], deltas: Deltas, fps_hz: float
) -> Deltas:
    """Motions of the root from each pose to the next, corrected.

    To each the rates w of a turn and v of a step are added that minimise
    |w|^2 / TURN^2 + |v|^2 / STEP^2 + sum of s |u + w x q + v|^2 / SLIP^2: point q of a sole moves
    by u, and counts by s.
    """
    soles_m = sole_points_m(local_rotmats)
    before_m, after_m = soles_m[..., :-1, :, :], soles_m[..., 1:, :, :]
    sure_of_turn = after_m.new_tensor(TURN_SIGMA_RAD_PER_S) ** -2.0
    sure_of_step = STEP_SIGMA_M_PER_S**-2.0
    turn = step = torch.zeros_like(deltas[1])
    for _ in range(ITERATIONS):
        rotmats, delta_m = _corrected(deltas, turn, step, fps_hz)
        points_m = after_m @ rotmats.transpose(-1, -2)
        moved = fps_hz * (points_m + delta_m[..., None, :] - before_m)
        still = (1 + moved.square().sum(-1, keepdim=True) / STILL_M_PER_S**2) ** -2.0
        stands = SLIP_SIGMA_M_PER_S**-2.0 * still
        # The best step for any turn is a mean of points; put in, it leaves an equation of the turn.
        weight = stands.sum(-2) + sure_of_step
        centre_m = (stands * points_m).sum(-2) / weight
        drift = ((stands * moved).sum(-2) + sure_of_step * step) / weight
        pull = (stands * torch.linalg.cross(points_m, moved)).sum(-2)
        pull = pull - weight * torch.linalg.cross(centre_m, drift) + sure_of_turn * turn
        arms = (stands[..., None] * _inertia(points_m)).sum(-3)
        arms = arms - weight[..., None] * _inertia(centre_m)
        change = -solved(arms + sure_of_turn * torch.eye(3).to(arms), pull)
        step = step - drift - torch.linalg.cross(change, centre_m)
        turn = turn + change
    return _corrected(deltas, turn, step, fps_hz)


def _corrected(deltas: Deltas, turn: Tensor, step: Tensor, fps_hz: float) -> Deltas:
    rotmats, delta_m = deltas
    return rotations.to_rotmats(turn / fps_hz, "axis-angle") @ rotmats, delta_m + step / fps_hz


def _inertia(points_m: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """|q|^2 - q q^T, by which q x (w x q) is linear in w."""
    squares = points_m.square().sum(-1)[..., None, None]
    outer = points_m[..., :, None] * points_m[..., None, :]
    return squares * torch.eye(3).to(points_m) - outer


def sole_points_m(local_rotmats: Float[Tensor, "*batch 23 3 3"]) -> Float[Tensor, "*batch 6 3"]:
    """Heel, ball and toe of the left and of the right foot on the mean skeleton, root frame [m]."""
    places_m, root_from_joint = joints_in_root_frame(local_rotmats)
    points = []
    for side, to_side in (("left", -1.0), ("right", 1.0)):
        for name, offsets_m in RIGHT_SOLE_M.items():
            joint = JOINT[f"{side}_{name}"] - 1
            offsets = places_m.new_tensor(offsets_m) * places_m.new_tensor((to_side, 1.0, 1.0))
            turned_m = offsets @ root_from_joint[..., joint, :, :].transpose(-1, -2)
            points.append(places_m[..., joint, None, :] + turned_m)
    return torch.cat(points, dim=-2)
