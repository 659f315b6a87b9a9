"""Recipe of the non-sequential model.  Needs no torch."""

from typing import Literal

from pydantic import Field

from gmrdata.gmr.config import LossConfig, Representation
from gmrdata.values.records import Config


class JointModelConfig(Config):
    """Size of the network: GMR's, with image features in place of local poses."""

    layers: int = Field(default=4, ge=1)
    """Bidirectional GRU layers, as GMR's 4."""
    hidden: int = Field(default=2048, ge=1)
    """Units per direction, and size of the latent feature, as GMR's 2048."""
    output: Representation = "axis-angle"
    """Representation of dR; local rotations are always put out in 6D, as VIBE does."""
    dropout: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of features dropped in training between GRU layers and before the last; not the
    paper's."""
    output_scale: float = Field(default=1.0, gt=0.0)
    """Factor on the motion's output; see `gmrdata.gmr.config.ModelConfig`."""


class JointConfig(Config):
    """A training run of the non-sequential model (Table 10).

    The paper says that it reformulates VIBE to put out both local pose and global motion, and no
    more: size, losses and settings are GMR's, with a term for the local pose.
    """

    recipe: Literal["joint"] = "joint"
    """Kind of recipe."""
    model: JointModelConfig = JointModelConfig()
    """The network."""
    loss: LossConfig = LossConfig()
    """Eq. 5 for the motion.  The vertex term poses the body by the true local pose."""
    local_pose: float = Field(default=1.0, ge=0.0)
    """Weight of the local pose's chordal loss (squared Frobenius norm, per joint)."""
    frames: int = Field(default=64, ge=2)
    """Frames of a window; the paper's 64.  Shorter runs are padded."""
    fps_hz: float = Field(default=10.0, gt=0.0)
    """Frame rate of the network's input [Hz]; clips must have a whole multiple of it, since
    features can't be resampled."""
    reverse_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of windows played backwards, as the paper's flip augmentation."""
    learning_rate: float = Field(default=5e-5, gt=0.0)
    """Adam's step size, as GMR's 5e-5."""
    gradient_norm: float | None = Field(default=None, gt=0.0)
    """Longest gradient, clipped beyond; None for no limit."""
    batch_size: int = Field(default=32, ge=1)
    """Windows per step, as GMR's 32."""
    steps: int = Field(default=100_000, ge=1)
    """Steps; the paper doesn't say how many."""
    seed: int = Field(default=0, ge=0)
    """Of the initial weights, the windows and the dropout."""
    log_every: int = Field(default=10, ge=1)
    """Steps between lines of metrics.jsonl."""
    checkpoint_every: int = Field(default=1000, ge=1)
    """Steps between checkpoints, from which a run that was stopped goes on."""
    threads: int = Field(default=1, ge=1)
    """CPU threads; part of the recipe, since another number rounds sums in another way."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to train.  Bitwise repetition is promised on the CPU."""
