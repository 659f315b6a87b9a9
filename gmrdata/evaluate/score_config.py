"""How clips are scored."""

from typing import Literal

from pydantic import Field

from gmrdata.config import Config
from gmrdata.evaluate.protocol_names import ProtocolName
from gmrdata.gmr.config import Which


class ScoreConfig(Config):
    """The recipe of a score."""

    which: Which = "latest"
    """Which weights of a network are scored; predictions from files have none."""
    all_phases: bool = False
    """Whether a clip of a higher frame rate is scored in all its phases, or in the first; the paper
    doesn't say."""
    protocol: ProtocolName | None = None
    """What is measured beside OME, TME, VME and the vertex error over time."""
    fps_hz: float = Field(default=10.0, gt=0)
    """Rate of OME, TME and VME of predictions from files [Hz]; a network is scored at its own."""
    missing: Literal["error", "drop"] = "error"
    """Whether valid frames without a prediction are an error, or dropped and counted."""
    resamples: int = Field(default=2000, ge=100)
    """How often clips are drawn for a bootstrap interval."""
    seed: int = Field(default=0, ge=0)
    """What they are drawn by."""
