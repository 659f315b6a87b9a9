"""The non-sequential model of Table 10: image features in, local poses and motions out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from gmrdata.gmr import rotations
from gmrdata.gmr.checkpoint import StepState, load_weights, read_step_state, trained_checkpoint
from gmrdata.gmr.losses import Motions
from gmrdata.gmr.model import MotionNetwork
from gmrdata.paper.joint_config import JointConfig
from gmrdata.values.body import N_LOCAL
from gmrdata.values.shapes import Float


class JointState(StepState):
    """`state.json` of a kept step."""

    format: Literal["gmrdata-joint/2"] = "gmrdata-joint/2"
    n_features: int  # numbers per frame that the network takes
    config: JointConfig


@dataclass(frozen=True, eq=False)
class JointOutput:
    """What the network sees in B sequences of T frames."""

    motions: Motions  # dR (B, T-1, 3, 3) and dT (B, T-1, 3) [m]
    local_rotmats: Tensor  # (B, T, 23, 3, 3) parent_from_joint


class JointModel(MotionNetwork):
    """GMR's encoder over image features, with a head for the motion and one for the local pose."""

    feature_mean: Tensor
    feature_scale: Tensor
    mean_pose: Tensor

    def __init__(self, config: JointConfig, n_features: int) -> None:
        super().__init__(n_features, config.model)
        self.config = config
        self.n_features = n_features
        n_latent = config.model.n_features
        self.motion = nn.Linear(n_latent, rotations.SIZE[config.model.output] + 3)
        self.pose = nn.Linear(n_latent, N_LOCAL * rotations.SIZE["6d"])
        self.register_buffer("feature_mean", torch.zeros(n_features))
        self.register_buffer("feature_scale", torch.ones(n_features))
        self.register_buffer("mean_pose", torch.tensor(rotations.IDENTITY["6d"]).repeat(N_LOCAL))

    def start_from(
        self, features: Float[Tensor, "n numbers"], local_rotmats: Float[Tensor, "n 23 3 3"]
    ) -> None:
        """Take the scale of the inputs and the mean pose from training frames."""
        self.feature_mean.copy_(features.mean(0))
        # A feature that never changes says nothing, and stays at zero.
        spread = features.std(0, correction=0)
        self.feature_scale.copy_(torch.where(spread > 0, 1 / spread.clamp_min(1e-12), 0.0))
        self.mean_pose.copy_(rotations.from_rotmats(local_rotmats, "6d").flatten(1).mean(0))

    def forward(
        self, features: Float[Tensor, "batch frames numbers"], lengths: Tensor | None = None
    ) -> JointOutput:
        """Local poses of T frames, and the T-1 motions between them; `lengths` as in `features`."""
        scaled = (features - self.feature_mean) * self.feature_scale
        latent = self.features(scaled, lengths)
        poses = (self.mean_pose + self.pose(latent)).unflatten(-1, (N_LOCAL, -1))
        motions = Motions(*self.motions(self.motion(latent[:, :-1])))
        return JointOutput(motions, rotations.to_rotmats(poses, "6d"))


def load_joint(run_dir: Path) -> JointModel:
    """The network of a run, on the CPU, in evaluation mode."""
    folder = trained_checkpoint(run_dir)
    state = read_step_state(folder, JointState)
    model = JointModel(state.config, state.n_features)
    load_weights(folder, model)
    return model.eval()
