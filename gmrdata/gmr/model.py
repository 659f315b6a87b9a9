"""What the network may be given beside the local rotations, and the joint that stands.

The motion of the root cannot be seen in one local pose, only in how poses follow each other, and
mostly in the joints that stand on the floor.  With few data it helps to say so.

A foot that stands neither turns nor moves in the world, so the root turns and moves by what the
foot does in the root's frame.  With A_i the rotation and p_i the place of a joint there,
dR = A_i A_{i+1}^T (eq. 3 with the joint's rotation in the world unchanged), and given dR,
dT = p_i - dR p_{i+1} (eqs. 3-4 with its place unchanged).  The second asks only for a point at
rest, about which the foot may turn: the extra input takes dR for it from the same joint, the
network's output from the network.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from gmrdata.gmr import rotations
from gmrdata.gmr.augmentation import four_ways, mean_motion, turned_back
from gmrdata.gmr.config import ExtraInput, ModelConfig, MotionSource, NetworkConfig, Representation
from gmrdata.gmr.rotations import Answer, Features, Lengths, Sequences
from gmrdata.gmr.supports import (
    SCALE,
    StandingShares,
    Supports,
    centre_of_mass_m,
    led_by,
    support_scores,
    with_flight,
)
from gmrdata.values.body import JOINT, N_LOCAL
from gmrdata.values.shapes import Float
from gmrdata.values.skinning_torch import forward_kinematics

REST_JOINTS_M = (
    (0.000, 0.000, 0.000), (0.099, -0.063, 0.011), (-0.099, -0.063, 0.011), (0.000, 0.105, 0.006),
    (0.099, -0.448, 0.011), (-0.099, -0.448, 0.011), (0.000, 0.208, -0.003),
    (0.099, -0.838, 0.011), (-0.099, -0.838, 0.011), (0.000, 0.328, -0.036),
    (0.099, -0.906, 0.156), (-0.099, -0.906, 0.156), (0.000, 0.511, 0.001), (0.062, 0.478, 0.008),
    (-0.062, 0.478, 0.008), (0.000, 0.561, 0.013), (0.164, 0.439, 0.010), (-0.164, 0.439, 0.010),
    (0.431, 0.439, 0.010), (-0.431, 0.439, 0.010), (0.666, 0.439, 0.010), (-0.666, 0.439, 0.010),
    (0.775, 0.439, 0.010), (-0.775, 0.439, 0.010),
)  # fmt: skip
"""(24, 3) joints of an average adult in SMPL's T-pose, pelvis at the origin [m]: those of the
default body, rounded to millimetres.  A person's own shape is no input of the network."""


def joints_in_root_frame(
    local_rotmats: Float[Tensor, "*batch 23 3 3"],
) -> tuple[Float[Tensor, "*batch 23 3"], Float[Tensor, "*batch 23 3 3"]]:
    """Places of joints 1 to 23 [m] and root_from_joint, on the mean skeleton."""
    rest_m = torch.tensor(REST_JOINTS_M, dtype=local_rotmats.dtype, device=local_rotmats.device)
    places_m, root_from_joint = forward_kinematics(rest_m, local_rotmats)
    return places_m[..., 1:, :], root_from_joint[..., 1:, :, :]


Joints = tuple[Tensor, Tensor]  # what `joints_in_root_frame` gives


def velocities(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"], joints: Joints | None = None
) -> Float[Tensor, "*batch frames 23 3"]:
    """How each joint turns to the next frame: axis-angle of R_i^T R_{i+1}, in `SCALE`-ths [rad]."""
    turns = local_rotmats[..., :-1, :, :, :].transpose(-1, -2) @ local_rotmats[..., 1:, :, :, :]
    return _with_last(SCALE * rotations.log_map(turns))


def motions_if_standing(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"], joints: Joints | None = None
) -> Float[Tensor, "*batch frames 23 6"]:
    """The root's motion if each joint stood still: dR (axis-angle) [rad], dT [m], times `SCALE`."""
    return _root_motions(*(joints or joints_in_root_frame(local_rotmats)))


def _root_motions(places_m: Tensor, root_from_joint: Tensor) -> Tensor:
    delta_rotmats = root_from_joint[..., :-1, :, :, :] @ root_from_joint[
        ..., 1:, :, :, :
    ].transpose(-1, -2)
    moved_m = (delta_rotmats @ places_m[..., 1:, :, :, None])[..., 0]
    delta_m = places_m[..., :-1, :, :] - moved_m
    return _with_last(SCALE * torch.cat([rotations.log_map(delta_rotmats), delta_m], dim=-1))


def seen_from_feet(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"], joints: Joints | None = None
) -> Float[Tensor, "*batch frames 2 30"]:
    """The body in the frame of each foot, left and right: upright while that foot stands flat.

    Four places [m], and how each changes to the next frame, times `SCALE`: of the centre of mass,
    the other ankle and the pelvis from the foot's ankle, and of the other foot's ball from this
    one's.  Then the root's and the other foot's up (y of their frames).
    """
    places_m, root_from_joint = joints or joints_in_root_frame(local_rotmats)
    centre_m = centre_of_mass_m(places_m)
    feet = []
    for foot, other in ((ANKLES[0], ANKLES[1]), (ANKLES[1], ANKLES[0])):
        foot_from_root = root_from_joint[..., foot, :, :].transpose(-1, -2)
        ankle_m = places_m[..., foot, :]
        balls_m = places_m[..., other + _TO_BALL, :] - places_m[..., foot + _TO_BALL, :]
        numbers = []
        for place_m in (centre_m - ankle_m, places_m[..., other, :] - ankle_m, -ankle_m, balls_m):
            seen_m = (foot_from_root @ place_m[..., None])[..., 0]
            change_m = seen_m[..., 1:, :] - seen_m[..., :-1, :]
            numbers += [seen_m, SCALE * _with_last(change_m[..., None, :])[..., 0, :]]
        up_of_other = (foot_from_root @ root_from_joint[..., other, :, 1, None])[..., 0]
        feet.append(torch.cat([*numbers, foot_from_root[..., :, 1], up_of_other], dim=-1))
    return torch.stack(feet, dim=-2)


ANKLES = (JOINT["left_ankle"] - 1, JOINT["right_ankle"] - 1)
_TO_BALL = JOINT["left_foot"] - JOINT["left_ankle"]

EXTRA_SIZES: dict[ExtraInput, tuple[int, int]] = {
    "velocity": (N_LOCAL, 3),
    "standing": (N_LOCAL, 6),
    "feet": (2, 30),
}
"""Rows (joints 1 to 23, or feet) and numbers of each row."""
_MAKE_EXTRA = {"velocity": velocities, "standing": motions_if_standing, "feet": seen_from_feet}


def _with_last(values: Tensor) -> Tensor:
    """Zeros after the last frame, which has no next one: (..., T-1, 23, n) -> (..., T, 23, n)."""
    return torch.cat([values, torch.zeros_like(values[..., :1, :, :])], dim=-3)


def input_rotmats(
    poses: Float[Tensor, "*batch numbers"], representation: Representation
) -> Float[Tensor, "*batch 23 3 3"]:
    """Local rotations, which come first in the network's input."""
    local = poses[..., : N_LOCAL * rotations.SIZE[representation]]
    # Not unflattened, of which ONNX's exporter takes the example's sizes for those of all inputs.
    local = local.reshape(*poses.shape[:-1], N_LOCAL, -1)
    return rotations.to_rotmats(local, representation)


LEGS_AND_TRUNK = range(JOINT["neck"] - 1)
"""Rows of hips, knees, ankles, feet and spine among the 23 local rotations."""


class MotionNetwork(nn.Module):
    """Bidirectional GRUs and a linear projection (paper, section 3.3), before some heads."""

    identity: Tensor

    def __init__(self, n_inputs: int, size: NetworkConfig) -> None:
        super().__init__()
        self.size = size
        self.encoder = nn.GRU(
            input_size=n_inputs,
            hidden_size=size.hidden,
            num_layers=size.layers,
            batch_first=True,
            bidirectional=True,
            dropout=size.dropout if size.layers > 1 else 0.0,
        )
        self.projection = nn.Linear(2 * size.hidden, size.n_features)
        self.dropout = nn.Dropout(size.dropout)
        identity = torch.tensor(rotations.IDENTITY[size.output])
        self.register_buffer("identity", identity, persistent=False)

    def features(self, frames: Sequences, lengths: Lengths) -> Features:
        """Features of sequences, of which `lengths` (on the CPU) frames are real; None: all."""
        if lengths is None or bool((lengths == frames.shape[1]).all()):
            encoded = self.encoder(frames)[0]
        else:
            packed = pack_padded_sequence(frames, lengths, batch_first=True, enforce_sorted=False)
            encoded, _ = pad_packed_sequence(
                self.encoder(packed)[0], batch_first=True, total_length=frames.shape[1]
            )
        features: Tensor = self.dropout(self.projection(encoded))
        return features

    def motions(
        self, values: Float[Tensor, "*batch outputs"]
    ) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3"]]:
        """dR and dT [m] that a last layer's numbers stand for: a rotation, and a translation."""
        values = values * self.size.output_scale
        n_rotation = rotations.SIZE[self.size.output]
        turns = values[..., :n_rotation]
        if self.size.output != "axis-angle":
            # A network that puts out zeros stands still, whatever the representation.
            turns = turns + self.identity
        return rotations.to_rotmats(turns, self.size.output), values[..., n_rotation:]


class Gmr(MotionNetwork):
    """The GRUs, the projection, and a linear regression (paper, section 3.3)."""

    columns: Tensor

    def __init__(self, config: ModelConfig) -> None:
        columns = input_columns(config)
        super().__init__(len(columns), config)
        self.config = config
        self.register_buffer("columns", torch.tensor(columns), persistent=False)
        self.regression = nn.Linear(config.n_features, rotations.SIZE[config.output] + 3)
        self.turn_shares = _shares(config.rotation, config)
        self.step_shares = _shares(config.translation, config)
        self.looks = support_scores(config.n_features) if config.joints_say else None
        self._given = _columns_of("standing", config)

    def forward(self, poses: Sequences, lengths: Lengths = None) -> Answer:
        """dR and dT [m] from local poses, as `network_input` makes them; `lengths`: see `features`.

        T frames in give T motions out, as in Fig. 4; but T frames have only T-1 motions, so the
        last one leads out of the sequence and callers drop it.
        """
        return mean_motion(self.answers(poses, lengths))

    def answers(self, poses: Sequences, lengths: Lengths = None) -> list[Answer]:
        """What `forward` is the mean of: one answer, or of a symmetric network four."""
        if self.training or not self.config.symmetric:
            return [self._motions_of(poses, self._features_of(poses, lengths))]
        local_rotmats = input_rotmats(poses, self.config.input)
        ways = torch.cat(four_ways(local_rotmats, lengths))
        ways = network_input(ways, self.config.input, self.config.extra_inputs)
        features = self._features_of(ways, None if lengths is None else lengths.repeat(4))
        # Four parts of a size that ONNX need not know; one after the other, since supports take
        # most of the memory.
        parts = (values.reshape(4, -1, *values.shape[1:]) for values in (ways, features))
        return turned_back([self._motions_of(*part) for part in zip(*parts, strict=True)], lengths)

    def _features_of(self, poses: Sequences, lengths: Lengths) -> Features:
        """Features of sequences, by the columns that the GRUs get."""
        seen = poses if self.columns.numel() == poses.shape[-1] else poses[..., self.columns]
        return self.features(seen, lengths)

    def _motions_of(self, poses: Sequences, features: Features) -> Answer:
        """What the network answers to sequences as they are, by their features."""
        # bfloat16's 8 bits are enough for features, not for the motion itself.
        with torch.autocast(features.device.type, enabled=False):
            features = features.to(self.regression.weight.dtype)
            regressed = self.regression(features)
            if self.turn_shares is None and self.step_shares is None:
                return self.motions(regressed)
            with torch.no_grad():  # in padding they are finite, but of no meaning
                joints = joints_in_root_frame(input_rotmats(poses, self.config.input))
                given = poses[..., self._given]
                motions = given.unflatten(-1, (-1, 6)) if given.numel() else _root_motions(*joints)
                supports = Supports(motions, joints[0])
                supports = supports if self.looks is None else with_flight(supports)
            # The regression puts out what supports leave over.
            shares = self.turn_shares, self.step_shares
            return led_by(supports, features, self.motions(regressed), shares, self.looks)


class MeanGmr(nn.Module):
    """Several networks of one config, and the mean of their motions."""

    def __init__(self, models: Sequence[Gmr]) -> None:
        super().__init__()
        self.models: Sequence[Gmr] = nn.ModuleList(models)  # type: ignore[assignment]
        self.config = models[0].config

    def forward(self, poses: Sequences, lengths: Lengths = None) -> Answer:
        """dR and dT [m], as each of the networks gives them."""
        return mean_motion(self.answers(poses, lengths))

    def answers(self, poses: Sequences, lengths: Lengths = None) -> list[Answer]:
        """Those of all networks."""
        return [one for model in self.models for one in model.answers(poses, lengths)]


def _shares(source: MotionSource, config: ModelConfig) -> StandingShares | None:
    n_supports = N_LOCAL + config.joints_say
    return StandingShares(config.n_features, n_supports) if source == "standing_joint" else None


def input_size(config: ModelConfig) -> int:
    """Numbers per frame D: 23 * 3 | 4 | 6 for the local rotations, and the extra ones."""
    extra = sum(rows * numbers for rows, numbers in _extra_sizes(config))
    return N_LOCAL * rotations.SIZE[config.input] + extra


def input_columns(config: ModelConfig) -> list[int]:
    """Which of those numbers the GRUs get."""
    columns, start = [], 0
    for rows, numbers in ((N_LOCAL, rotations.SIZE[config.input]), *_extra_sizes(config)):
        some = rows == N_LOCAL and config.looks_at == "legs_and_trunk"
        seen = LEGS_AND_TRUNK if some else range(rows)
        columns += [start + numbers * row + i for row in seen for i in range(numbers)]
        start += rows * numbers
    return columns


def _columns_of(kind: ExtraInput, config: ModelConfig) -> slice:
    """Where an extra input lies in the network's; nowhere if it is none."""
    if kind not in config.extra_inputs:
        return slice(0)
    before = config.extra_inputs[: config.extra_inputs.index(kind)]
    start = input_size(config.model_copy(update={"extra_inputs": before}))
    return slice(start, start + EXTRA_SIZES[kind][0] * EXTRA_SIZES[kind][1])


def _extra_sizes(config: ModelConfig) -> list[tuple[int, int]]:
    return [EXTRA_SIZES[kind] for kind in config.extra_inputs]


def network_input(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"],
    representation: Representation,
    extra: Sequence[ExtraInput] = (),
) -> Float[Tensor, "*batch frames numbers"]:
    """Network input of local rotations: quaternions continuous in time; then the extra inputs."""
    values = rotations.from_rotmats(local_rotmats, representation)
    if representation == "quaternion":
        values = rotations.continuous_in_time(values)
    joints = joints_in_root_frame(local_rotmats) if extra else None
    parts = [values] + [_MAKE_EXTRA[kind](local_rotmats, joints) for kind in extra]
    return torch.cat([part.flatten(-2) for part in parts], dim=-1)


def given_input(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"], config: ModelConfig
) -> Float[Tensor, "*batch frames numbers"]:
    """Input of a trained network; a symmetric one makes the extra inputs of four ways itself."""
    return network_input(
        local_rotmats, config.input, () if config.symmetric else config.extra_inputs
    )
