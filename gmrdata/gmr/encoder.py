"""What networks share that see a motion in a sequence: how it is read, and how it is put out."""

from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation


def make_encoder(n_inputs: int, hidden: int, layers: int, dropout: float) -> nn.GRU:
    """Bidirectional GRUs (paper, section 3.3).

    Args:
        n_inputs: Numbers per frame.
        hidden: Units per direction.
        layers: Number of layers.
        dropout: Share of features dropped between layers in training.
    """
    return nn.GRU(
        input_size=n_inputs,
        hidden_size=hidden,
        num_layers=layers,
        batch_first=True,
        bidirectional=True,
        dropout=dropout if layers > 1 else 0.0,
    )


def encode(encoder: nn.GRU, frames: Tensor, lengths: Tensor | None) -> Tensor:
    """Features (B, T, 2 * hidden) of sequences (B, T, D).

    Args:
        encoder: The GRUs.
        frames: (B, T, D).
        lengths: (B,) int on the CPU: real frames of each row; the rest is padding, which does not
            change the other frames' features.  None where all T are real.
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
    values: Tensor, representation: Representation, identity: Tensor
) -> tuple[Tensor, Tensor]:
    """Motions that a network's last layer stands for: dR (..., 3, 3) and dT (..., 3) [m].

    Args:
        values: (..., n + 3) numbers of a rotation, and of a translation.
        representation: That of the rotation.
        identity: (n,) the identity in it.
    """
    n_rotation = rotations.SIZE[representation]
    turns = values[..., :n_rotation]
    if representation != "axis-angle":
        # A network that puts out zeros stands still, whatever the representation.
        turns = turns + identity
    return rotations.to_rotmats(turns, representation), values[..., n_rotation:]
