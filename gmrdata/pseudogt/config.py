"""What a recipe may say of the pseudo ground truth."""

from gmrdata.config import Config
from gmrdata.geometry.motion_class import MotionClassConfig
from gmrdata.pseudogt.override import Override
from gmrdata.pseudogt.thresholds import VerdictConfig
from gmrdata.sfm.cues import ScaleConfig


class PseudoGtConfig(Config):
    """Metric world poses from cameras up to scale.  The people are not smoothed."""

    scale: ScaleConfig = ScaleConfig()
    """How metric scale is found."""
    verdict: VerdictConfig = VerdictConfig()
    """What a sequence and its frames must keep to."""
    override: Override | None = None
    """What a person decided of the sequence."""
    motion_class: MotionClassConfig = MotionClassConfig()
    """Where one class of camera motion ends and the next begins."""
