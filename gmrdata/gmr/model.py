"""The global motion regressor: local poses in, motion between frames out (the paper's Fig. 4)."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from gmrdata.gmr import inputs as extra_inputs
from gmrdata.gmr import rotations
from gmrdata.gmr.config import ExtraInput, ModelConfig, MotionSource, Representation
from gmrdata.gmr.inputs import StandingShares, joints_seen, root_step_m, root_turn
from gmrdata.values.body import N_LOCAL
from gmrdata.values.shapes import Float, Int


def make_encoder(n_inputs: int, hidden: int, layers: int, dropout: float) -> nn.GRU:
    """Bidirectional GRUs (paper, section 3.3) of `hidden` units per direction."""
    return nn.GRU(
        input_size=n_inputs,
        hidden_size=hidden,
        num_layers=layers,
        batch_first=True,
        bidirectional=True,
        dropout=dropout if layers > 1 else 0.0,
    )


def encode(
    encoder: nn.GRU,
    frames: Float[Tensor, "batch frames numbers"],
    lengths: Int[Tensor, " batch"] | None,
) -> Float[Tensor, "batch frames features"]:
    """Features of sequences, of both directions.

    `lengths`, on the CPU, says how many frames of each row are real; the rest is padding, which
    does not change the other frames' features.  None where all are real.
    """
    if lengths is None or bool((lengths == frames.shape[1]).all()):
        features: Tensor = encoder(frames)[0]
        return features
    packed = pack_padded_sequence(frames, lengths, batch_first=True, enforce_sorted=False)
    features, _ = pad_packed_sequence(
        encoder(packed)[0], batch_first=True, total_length=frames.shape[1]
    )
    return features


def motions_of(
    values: Float[Tensor, "*batch outputs"],
    representation: Representation,
    identity: Float[Tensor, " n"],
) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3"]]:
    """dR and dT [m] that a network's last layer stands for: a rotation, and a translation."""
    n_rotation = rotations.SIZE[representation]
    turns = values[..., :n_rotation]
    if representation != "axis-angle":
        # A network that puts out zeros stands still, whatever the representation.
        turns = turns + identity
    return rotations.to_rotmats(turns, representation), values[..., n_rotation:]


class Gmr(nn.Module):
    """Bidirectional GRUs, a linear projection, a linear regression (paper, section 3.3)."""

    identity: Tensor

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = make_encoder(
            input_size(config), config.hidden, config.layers, config.dropout
        )
        self.projection = nn.Linear(2 * config.hidden, config.hidden)
        self.dropout = nn.Dropout(config.dropout)
        self.regression = nn.Linear(config.hidden, rotations.SIZE[config.output] + 3)
        self.turn_shares = _shares(config.rotation, config.hidden)
        self.step_shares = _shares(config.translation, config.hidden)
        identity = torch.tensor(rotations.IDENTITY[config.output])
        self.register_buffer("identity", identity, persistent=False)

    def forward(
        self,
        poses: Float[Tensor, "batch frames numbers"],
        lengths: Int[Tensor, " batch"] | None = None,
    ) -> tuple[Float[Tensor, "batch frames 3 3"], Float[Tensor, "batch frames 3"]]:
        """dR and dT [m] from local poses, as `network_input` makes them; `lengths` as in `encode`.

        T frames in give T motions out, as in Fig. 4; but T frames have only T-1 motions, so the
        last one leads out of the sequence and callers drop it.
        """
        features = self.dropout(self.projection(encode(self.encoder, poses, lengths)))
        # bfloat16's 8 bits are enough for features, not for the motion itself.
        with torch.autocast(features.device.type, enabled=False):
            features = features.to(self.regression.weight.dtype)
            values = self.regression(features) * self.config.output_scale
            delta_rotmats, delta_m = motions_of(values, self.config.output, self.identity)
            return self._with_standing_joints(poses, features, delta_rotmats, delta_m)

    def _with_standing_joints(
        self, poses: Tensor, features: Tensor, delta_rotmats: Tensor, delta_m: Tensor
    ) -> tuple[Tensor, Tensor]:
        """The motion in whole, of which the regression puts out what standing joints leave over."""
        if self.turn_shares is None and self.step_shares is None:
            return delta_rotmats, delta_m
        places_m, root_from_joint = joints_seen(poses, self.config.input)
        if self.turn_shares is not None:
            delta_rotmats = root_turn(self.turn_shares(features), root_from_joint) @ delta_rotmats
        if self.step_shares is not None:
            delta_m = root_step_m(self.step_shares(features), places_m, delta_rotmats) + delta_m
        return delta_rotmats, delta_m


def _shares(source: MotionSource, n_features: int) -> StandingShares | None:
    return StandingShares(n_features) if source == "standing_joint" else None


def input_size(config: ModelConfig) -> int:
    """Numbers per frame D: 23 * 3 | 4 | 6 for the local rotations, and the extra ones."""
    extra = sum(extra_inputs.SIZE[kind] for kind in config.extra_inputs)
    return N_LOCAL * (rotations.SIZE[config.input] + extra)


def parameter_count(config: ModelConfig) -> int:
    """Number of trained numbers, by formula.

    A GRU direction of h units on n inputs has 3h(n + h) weights and 6h biases.
    """
    h = config.hidden
    sizes = [input_size(config)] + [2 * h] * (config.layers - 1)
    encoder = sum(2 * (3 * h * (n + h) + 6 * h) for n in sizes)
    outputs = rotations.SIZE[config.output] + 3
    outputs += (N_LOCAL + 1) * (config.rotation, config.translation).count("standing_joint")
    return encoder + (2 * h * h + h) + (h * outputs + outputs)


def network_input(
    local_rotmats: Float[Tensor, "*batch frames 23 3 3"],
    representation: Representation,
    extra: Sequence[ExtraInput] = (),
) -> Float[Tensor, "*batch frames numbers"]:
    """Local rotations of sequences as network input.

    Quaternions are continuous in time with w >= 0 in the first frame.  The extra inputs come after
    them, in the order asked for.
    """
    values = rotations.from_rotmats(local_rotmats, representation)
    if representation == "quaternion":
        values = rotations.continuous_in_time(values)
    parts = [values] + [extra_inputs.MAKE[kind](local_rotmats) for kind in extra]
    return torch.cat([part.flatten(-2) for part in parts], dim=-1)
