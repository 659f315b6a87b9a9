"""Recipe of the non-sequential model.  Needs no torch."""

from typing import Literal, Self

from pydantic import Field, model_validator

from gmrdata.gmr.config import (
    LossConfig,
    NetworkConfig,
    StepsConfig,
    WindowConfig,
    check_batch,
)
from gmrdata.values import limits


class JointConfig(StepsConfig):
    """A training run of the non-sequential model (Table 10).

    The paper says that it reformulates VIBE to put out both local pose and global motion, and no
    more: size, losses and settings are GMR's, with a term for the local pose.
    """

    recipe: Literal["joint"] = "joint"
    model: NetworkConfig = NetworkConfig()
    """The network; local rotations are always put out in 6D, as VIBE does."""
    loss: LossConfig = LossConfig()
    """Eq. 5 for the motion.  The vertex term poses the body by the true local pose."""
    local_pose: float = Field(default=1.0, ge=0.0)
    """Weight of the local pose's chordal loss (squared Frobenius norm, per joint)."""
    frames: int = Field(default=64, ge=2, le=limits.MOST_FRAMES)
    """Frames of a window; the paper's 64.  Shorter runs are padded."""
    fps_hz: float = Field(default=10.0, ge=0.1, le=1000.0)
    """Frame rate of the network's input [Hz]; clips must have a whole multiple of it, since
    features can't be resampled."""
    reverse_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of windows played backwards, as the paper's flip augmentation."""

    @model_validator(mode="after")
    def _batch_can_be_held(self) -> Self:
        check_batch(self.batch_size, self.frames)
        return self

    @property
    def windows(self) -> WindowConfig:
        return WindowConfig(
            frames=self.frames, fps_hz=self.fps_hz, reverse_probability=self.reverse_probability
        )
