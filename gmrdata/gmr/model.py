"""The global motion regressor: local poses in, motion between frames out (the paper's Fig. 4)."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from gmrdata.gmr import inputs as extra_inputs
from gmrdata.gmr import rotations
from gmrdata.gmr.config import ExtraInput, ModelConfig, MotionSource, NetworkConfig, Representation
from gmrdata.gmr.inputs import StandingShares, root_step_m, root_turn
from gmrdata.gmr.symmetries import four_ways, mean_motion, mean_of_four
from gmrdata.values.body import JOINT, N_LOCAL
from gmrdata.values.shapes import Float, Int

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

    def features(
        self, frames: Float[Tensor, "batch frames numbers"], lengths: Int[Tensor, " batch"] | None
    ) -> Float[Tensor, "batch frames features"]:
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
        self.turn_shares = _shares(config.rotation, config.n_features)
        self.step_shares = _shares(config.translation, config.n_features)
        self._is_free = config.regressed == "freely"

    def forward(
        self,
        poses: Float[Tensor, "batch frames numbers"],
        lengths: Int[Tensor, " batch"] | None = None,
    ) -> tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]:
        """dR and dT [m] from local poses, as `network_input` makes them; `lengths`: see `features`.

        T frames in give T motions out, as in Fig. 4; but T frames have only T-1 motions, so the
        last one leads out of the sequence and callers drop it.
        """
        if self.training or not self.config.symmetric:
            return self._motions_of(poses, lengths)
        local_rotmats = extra_inputs.input_rotmats(poses, self.config.input)
        seen = [
            network_input(way, self.config.input, self.config.extra_inputs)
            for way in four_ways(local_rotmats, lengths)
        ]
        return mean_of_four([self._motions_of(way, lengths) for way in seen], lengths)

    def _motions_of(
        self, poses: Float[Tensor, "batch frames numbers"], lengths: Int[Tensor, " batch"] | None
    ) -> tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]:
        """What the network answers to sequences as they are."""
        seen = poses if self.columns.numel() == poses.shape[-1] else poses[..., self.columns]
        features = self.features(seen, lengths)
        # bfloat16's 8 bits are enough for features, not for the motion itself.
        with torch.autocast(features.device.type, enabled=False):
            features = features.to(self.regression.weight.dtype)
            regressed = self.regression(features)
            if self._is_free and self.turn_shares is None and self.step_shares is None:
                return self.motions(regressed)
            with torch.no_grad():  # in padding they are finite, but of no meaning
                local_rotmats = extra_inputs.input_rotmats(poses, self.config.input)
                places_m, root_from_joint = extra_inputs.joints_in_root_frame(local_rotmats)
            if not self._is_free:
                speeds = extra_inputs.speeds_of_change(places_m, root_from_joint)
                regressed = regressed * speeds
            # The regression puts out what standing joints leave over.
            turns, delta_m = self.motions(regressed)
            if self.turn_shares is not None:
                turns = root_turn(self.turn_shares(features), root_from_joint) @ turns
            if self.step_shares is not None:
                delta_m = root_step_m(self.step_shares(features), places_m, turns) + delta_m
            return turns, delta_m


class MeanGmr(nn.Module):
    """Several networks of one config, and the mean of their motions."""

    def __init__(self, models: Sequence[Gmr]) -> None:
        super().__init__()
        self.models = nn.ModuleList(models)
        self.config = models[0].config

    def forward(
        self,
        poses: Float[Tensor, "batch frames numbers"],
        lengths: Int[Tensor, " batch"] | None = None,
    ) -> tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]:
        """dR and dT [m], as each of the networks gives them."""
        return mean_motion([model(poses, lengths) for model in self.models])


def _shares(source: MotionSource, n_features: int) -> StandingShares | None:
    return StandingShares(n_features) if source == "standing_joint" else None


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


def _extra_sizes(config: ModelConfig) -> list[tuple[int, int]]:
    return [extra_inputs.SIZE[kind] for kind in config.extra_inputs]


def network_input(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"],
    representation: Representation,
    extra: Sequence[ExtraInput] = (),
) -> Float[Tensor, "*batch frames numbers"]:
    """Network input of local rotations: quaternions continuous in time; then the extra inputs."""
    values = rotations.from_rotmats(local_rotmats, representation)
    if representation == "quaternion":
        values = rotations.continuous_in_time(values)
    parts = [values] + [extra_inputs.MAKE[kind](local_rotmats) for kind in extra]
    return torch.cat([part.flatten(-2) for part in parts], dim=-1)
