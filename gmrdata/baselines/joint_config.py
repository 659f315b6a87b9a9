"""Recipe of the non-sequential model.  Needs no torch."""

from typing import Literal

from pydantic import Field

from gmrdata.gmr.config import LossConfig, Representation, StepsConfig, WindowConfig
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


class JointConfig(StepsConfig):
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

    @property
    def windows(self) -> WindowConfig:
        """How windows are cut."""
        return WindowConfig(
            frames=self.frames, fps_hz=self.fps_hz, reverse_probability=self.reverse_probability
        )
