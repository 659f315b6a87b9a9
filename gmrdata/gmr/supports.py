"""What holds a body while it moves, and the motion of the root that follows from it.

A support is a joint that stands: it leaves the root the motion that it would have if the joint
stood still (`gmrdata.gmr.model`).  The network says which one does, by its features; and, if asked
to, by how each one moves, with weights that all supports share: then a hand or a knee is known to
stand by how feet do.  That is asked twice, the second time with how far each support is from the
first answer, as in least squares that are weighted anew.  A body in flight is a support as well:
nothing turns it but itself, and its centre of mass stays, but for what is regressed.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from gmrdata.gmr import rotations
from gmrdata.gmr.rotations import Answer, Features
from gmrdata.values.body import N_LOCAL
from gmrdata.values.shapes import Float

SCALE = 10.0  # motions at 10 fps are about 0.1 rad and 0.1 m; the other numbers are about 1
N_SUPPORTS = N_LOCAL + 1  # joints 1 to 23, and flight
PELVIS_MASS = 8.0
MASSES = (
    0.1, 0.1, 8.0, 7.0, 7.0, 8.0, 3.0, 3.0, 12.0, 1.0, 1.0, 1.0,
    2.0, 2.0, 5.0, 2.0, 2.0, 1.5, 1.5, 0.8, 0.8, 0.3, 0.3,
)  # fmt: skip
"""What hangs on joints 1 to 23, and on the pelvis, roughly in per cent of the body's mass."""
MOST_TURN_RAD = 1.0  # of a body in flight, in a step
LEAST_INERTIA = 1e-3  # of a body, over its mass [m2]; that of a child's forearm
WIDTH = 32
MOST = 6.0  # of a support's numbers, of which most are below 1


class Supports(NamedTuple):
    """What may hold a body, in each of T frames."""

    motions: Float[Tensor, "batch frames supports 6"]
    """The root's motion to the next frame by each: dR (axis-angle) [rad], dT [m], times `SCALE`."""
    places_m: Float[Tensor, "batch frames supports 3"]

    @property
    def turns(self) -> Float[Tensor, "batch frames supports 3"]:
        return self.motions[..., :3] / SCALE


class StandingShares(nn.Module):
    """Which support holds, as shares that sum to 1 over them and none of them."""

    def __init__(self, n_features: int, n_supports: int) -> None:
        super().__init__()
        self.logits = nn.Linear(n_features, n_supports + 1)

    def forward(
        self, features: Features, scores: Float[Tensor, "batch frames supports"] | None = None
    ) -> Float[Tensor, "batch frames supports 1"]:
        """Shares of the supports, without that of none; `scores` are added to their logits."""
        logits = self.logits(features)
        if scores is not None:
            logits = logits + nn.functional.pad(scores, (0, 1))
        return logits.softmax(-1)[..., :-1, None]


class SupportScores(nn.Module):
    """How much each support is like one that keeps its orientation, and like one that stays."""

    def __init__(self, n_features: int, n_numbers: int) -> None:
        super().__init__()
        self.context = nn.Linear(n_features, WIDTH)
        self.numbers = nn.Linear(n_numbers, WIDTH)
        self.own = nn.Parameter(torch.zeros(N_SUPPORTS, WIDTH))  # what they don't have in common
        self.scores = nn.Linear(WIDTH, 2)
        nn.init.zeros_(self.scores.weight)
        nn.init.zeros_(self.scores.bias)

    def forward(
        self, features: Features, numbers: Float[Tensor, "batch frames supports numbers"]
    ) -> Float[Tensor, "batch frames supports 2"]:
        numbers = numbers.clamp(-MOST, MOST)
        hidden = self.context(features)[..., None, :] + self.numbers(numbers) + self.own
        scores: Tensor = self.scores(nn.functional.silu(hidden))
        return scores


def support_scores(n_features: int) -> nn.ModuleList:
    """The two that ask: `support_numbers` alone, and with `apart_from`."""
    return nn.ModuleList(SupportScores(n_features, size) for size in (15, 15 + 8))


def led_by(
    supports: Supports,
    features: Features,
    regressed: Answer,
    shares: tuple[StandingShares | None, StandingShares | None],
    looks: nn.ModuleList | None,
) -> Answer:
    """dR and dT [m] by supports, of which `shares` hold (None: no part of it is theirs), and what
    is regressed, which is what they leave over."""

    def led(scores: Tensor | None) -> Answer:
        (turns, delta_m), of_turns, of_steps = regressed, None, None
        if scores is not None:
            of_turns, of_steps = scores.unbind(-1)
        turn_shares, step_shares = shares
        if turn_shares is not None:
            turns = root_turn(turn_shares(features, of_turns), supports.turns) @ turns
        if step_shares is not None:
            own = step_shares(features, of_steps)
            delta_m = root_step_m(own, supports.places_m, turns) + delta_m
        return turns, delta_m

    if looks is None:
        return led(None)
    first, second = looks
    numbers = support_numbers(supports)
    scores = first(features, numbers)
    apart = apart_from(*led(scores), supports)
    return led(scores + second(features, torch.cat([numbers, apart], dim=-1)))


def support_numbers(supports: Supports) -> Float[Tensor, "batch frames supports 15"]:
    """What `SupportScores` looks at first: motions to the next frame and from the one before, and
    the place, in half metres."""
    motions, places_m = supports
    before = torch.cat([motions[:, :1], motions[:, :-1]], dim=1)
    return torch.cat([motions, before, 2 * places_m], dim=-1)


def apart_from(
    turns: Float[Tensor, "batch frames 3 3"],
    delta_m: Float[Tensor, "batch frames 3"],
    supports: Supports,
) -> Float[Tensor, "batch frames supports 8"]:
    """What it looks at then: how far from a motion is the one that each support leaves to the root,
    dR [rad] and dT [m], and how long these two are, times `SCALE`."""
    turned = supports.turns - rotations.log_map(turns)[..., None, :]
    moved_m = _steps_m(supports.places_m, turns) - delta_m[..., None, :]
    parts = [SCALE * turned, SCALE * moved_m]
    lengths = [(part.square().sum(-1, keepdim=True) + 1e-4).sqrt() for part in parts]
    return torch.cat([*parts, *lengths], dim=-1)


def root_turn(
    shares: Float[Tensor, "*#batch supports 1"], turns: Float[Tensor, "*#batch supports 3"]
) -> Float[Tensor, "*batch 3 3"]:
    """dR: the mean, as axis-angle, of what each support leaves to the root; none leaves no turn."""
    return rotations.to_rotmats((shares * turns).sum(-2), "axis-angle")


def root_step_m(
    shares: Float[Tensor, "*#batch supports 1"],
    places_m: Float[Tensor, "*#batch supports 3"],
    delta_rotmats: Float[Tensor, "*#batch 3 3"],
) -> Float[Tensor, "*batch 3"]:
    """dT [m]: the mean of what each support leaves to the root; none leaves no step."""
    return (shares * _steps_m(places_m, delta_rotmats)).sum(-2)


def _steps_m(places_m: Tensor, delta_rotmats: Tensor) -> Tensor:
    """dT [m] that each support leaves to the root: (B, T, supports, 3)."""
    return places_m - _next(places_m) @ delta_rotmats.transpose(-1, -2)


def _next(values: Tensor) -> Tensor:
    """Each frame's next one along axis 1, and the last again: its motion leads out."""
    return torch.cat([values[:, 1:], values[:, -1:]], dim=1)


def with_flight(supports: Supports) -> Supports:
    """Joints, and as one more support their body in flight, which does not spin.

    Its angular momentum about the centre of mass is 0: with the arms r before and r' after the
    step, sum m r x (r' - r + w x r') = 0, of which w is the root's turn.
    """
    places_m = supports.places_m
    centre_m = centre_of_mass_m(places_m)[..., None, :]
    arms_m = torch.cat([torch.zeros_like(centre_m), places_m], dim=-2) - centre_m
    later_m = _next(arms_m)
    masses = places_m.new_tensor((PELVIS_MASS, *MASSES))[:, None]
    masses = masses / masses.sum()
    spin = (masses * torch.linalg.cross(arms_m, later_m - arms_m)).sum(-2)
    weighted_m = masses * later_m
    outer = weighted_m.transpose(-1, -2) @ arms_m
    trace = (weighted_m * arms_m).sum((-1, -2))[..., None, None] + LEAST_INERTIA
    turns = -solved(trace * torch.eye(3).to(places_m) - outer, spin)[..., None, :]
    # A first-order turn, which has no meaning where a pose becomes another one at once.
    turns = turns * (MOST_TURN_RAD / turns.norm(dim=-1, keepdim=True).clamp(min=MOST_TURN_RAD))
    delta_rotmats = rotations.to_rotmats(turns[..., 0, :], "axis-angle")
    motions = SCALE * torch.cat([turns, _steps_m(centre_m, delta_rotmats)], dim=-1)
    return Supports(
        torch.cat([supports.motions, motions], dim=-2), torch.cat([places_m, centre_m], dim=-2)
    )


def centre_of_mass_m(places_m: Float[Tensor, "*batch 23 3"]) -> Float[Tensor, "*batch 3"]:
    """Of a body with the pelvis at the origin and joints 1 to 23 there [m]."""
    masses = places_m.new_tensor(MASSES)
    return (places_m * masses[:, None]).sum(-2) / (masses.sum() + PELVIS_MASS)


def solved(matrix: Tensor, vector: Tensor) -> Tensor:
    """x of M x = v, by Cramer's rule, which ONNX has: (..., 3, 3), (..., 3) -> (..., 3)."""
    columns = matrix.transpose(-1, -2)
    crossed = torch.linalg.cross(columns[..., [1, 2, 0], :], columns[..., [2, 0, 1], :])
    determinant = (columns[..., 0, :] * crossed[..., 0, :]).sum(-1, keepdim=True)
    return (crossed @ vector[..., None])[..., 0] / determinant
