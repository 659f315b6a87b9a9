"""The non-sequential model of Table 10: image features in, local poses and motions out."""

from dataclasses import dataclass
from pathlib import Path

import torch
from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.body.tree import N_LOCAL
from gmrdata.errors import BadCheckpoint, BadRecord, MissingInput
from gmrdata.gmr import rotations
from gmrdata.gmr.checkpoint import writable
from gmrdata.gmr.encoder import encode, make_encoder, motions_of
from gmrdata.gmr.losses import Motions
from gmrdata.store import atomic_path, read_json, write_json

FORMAT = "gmrdata-joint/1"
WEIGHTS = "model.safetensors"
STATE = "model.json"


@dataclass(frozen=True, eq=False)
class JointOutput:
    """What the network sees in B sequences of T frames."""

    motions: Motions
    """dR (B, T-1, 3, 3) and dT (B, T-1, 3) [m]."""
    local_rotmats: Tensor
    """(B, T, 23, 3, 3) parent_from_joint."""


class JointModel(nn.Module):
    """GMR's encoder over image features, with a head for the motion and one for the local pose."""

    feature_mean: Tensor
    feature_scale: Tensor
    mean_pose: Tensor
    identity: Tensor

    def __init__(self, config: JointConfig, n_features: int) -> None:
        super().__init__()
        self.config = config
        self.n_features = n_features
        size = config.model
        self.encoder = make_encoder(n_features, size.hidden, size.layers, size.dropout)
        self.projection = nn.Linear(2 * size.hidden, size.hidden)
        self.dropout = nn.Dropout(size.dropout)
        self.motion = nn.Linear(size.hidden, rotations.SIZE[size.output] + 3)
        self.pose = nn.Linear(size.hidden, N_LOCAL * rotations.SIZE["6d"])
        self.register_buffer("feature_mean", torch.zeros(n_features))
        self.register_buffer("feature_scale", torch.ones(n_features))
        self.register_buffer("mean_pose", torch.tensor(rotations.IDENTITY["6d"]).repeat(N_LOCAL))
        self.register_buffer(
            "identity", torch.tensor(rotations.IDENTITY[size.output]), persistent=False
        )

    def start_from(self, features: Tensor, local_rotmats: Tensor) -> None:
        """Take the scale of the inputs and the mean pose from training frames.

        Args:
            features: (n, D).
            local_rotmats: (n, 23, 3, 3).
        """
        self.feature_mean.copy_(features.mean(0))
        # A feature that never changes says nothing, and stays at zero.
        spread = features.std(0, correction=0)
        self.feature_scale.copy_(torch.where(spread > 0, 1 / spread.clamp_min(1e-12), 0.0))
        self.mean_pose.copy_(rotations.from_rotmats(local_rotmats, "6d").flatten(1).mean(0))

    def forward(self, features: Tensor, lengths: Tensor | None = None) -> JointOutput:
        """Local poses of T frames, and the T-1 motions between them.

        Args:
            features: (B, T, D).
            lengths: (B,) int on the CPU: real frames of each row; None where all T are real.
        """
        scaled = (features - self.feature_mean) * self.feature_scale
        latent = self.dropout(self.projection(encode(self.encoder, scaled, lengths)))
        size = self.config.model
        values = self.motion(latent[:, :-1]) * size.output_scale
        poses = (self.mean_pose + self.pose(latent)).unflatten(-1, (N_LOCAL, -1))
        return JointOutput(
            Motions(*motions_of(values, size.output, self.identity)),
            rotations.to_rotmats(poses, "6d"),
        )


def save_joint(run_dir: Path, model: JointModel, body: str) -> None:
    """Write a trained network's weights and what it takes to read them.

    Args:
        run_dir: The run's folder.
        model: The network.
        body: Name of the body that it was trained on.
    """
    with atomic_path(run_dir / WEIGHTS) as temporary:
        save_file(writable(model.state_dict()), temporary)
    state = {
        "format": FORMAT,
        "n_features": model.n_features,
        "body": body,
        "config": model.config.model_dump(mode="json"),
    }
    write_json(run_dir / STATE, state)


def load_joint(run_dir: Path) -> JointModel:
    """The network of a finished run, on the CPU, in evaluation mode.

    Raises:
        MissingInput: the folder holds no such network.
        BadCheckpoint: a file is truncated, or of another network.
    """
    path = run_dir / STATE
    if not path.is_file():
        raise MissingInput(f"{path}: no trained model there. Give the folder of a finished run")
    try:
        state = read_json(path)
        if not isinstance(state, dict) or state.get("format") != FORMAT:
            raise BadCheckpoint(f"{path}: not a model of {FORMAT}. Give a run made by gmrdata")
        config = JointConfig.model_validate(state.get("config"))
        model = JointModel(config, int(state["n_features"]))
        model.load_state_dict(load_file(run_dir / WEIGHTS))
    except (BadRecord, ValidationError, KeyError, TypeError, ValueError) as error:
        raise BadCheckpoint(f"{path}: unreadable ({error}). Train again") from None
    except (SafetensorError, OSError, RuntimeError) as error:
        raise BadCheckpoint(
            f"{run_dir / WEIGHTS}: truncated, missing or of another model ({error}). Train again"
        ) from None
    return model.eval()
