"""What the recipe of a regenerated data set may say."""

from typing import Literal

from pydantic import Field

from gmrdata.config import Config
from gmrdata.pseudogt.override import Override
from gmrdata.sequence import SequenceConfig
from gmrdata.threedpw.intrinsics_check import IntrinsicsConfig
from gmrdata.threedpw.valid import ValidRule


class ThreedpwRecipe(Config):
    """World-frame pseudo ground truth for sequences in 3DPW's layout."""

    recipe: Literal["threedpw"]
    """Kind of recipe."""
    name: str = Field(default="3dpw-world", pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")
    """Name of the data set that is made."""
    version: str = "1.0.0"
    """Its version, major.minor.patch."""
    licence: str = Field(default="3DPW's licence: research only, not to be passed on", min_length=1)
    """Terms of the sequences."""
    bodies: tuple[str, ...] = Field(default=("anny",), min_length=1)
    """Body models: SMPL's female and male files for 3DPW; "anny" for twins."""
    valid_rule: ValidRule = "campose_valid"
    """Which frames of a person the data set vouches for."""
    sequences: tuple[str, ...] = ()
    """Names of sequences; all when empty."""
    overrides: dict[str, Override] = Field(default_factory=dict)
    """What a person decided of sequences, by name."""
    intrinsics: IntrinsicsConfig = IntrinsicsConfig()
    """How the data set's intrinsics are checked against its 2D keypoints."""
    workers: int = Field(default=2, ge=1)
    """Worker processes; each uses its share of the cores for images and features, else one."""
    sequence: SequenceConfig = SequenceConfig()
    """Masks, cameras, scale, verdict."""

    def of_sequence(self, name: str) -> SequenceConfig:
        """The stages' recipe for one sequence, with a person's decision on it."""
        if name not in self.overrides:
            return self.sequence
        decided = {"override": self.overrides[name]}
        pseudo_gt = self.sequence.pseudo_gt.model_copy(update=decided)
        return self.sequence.model_copy(update={"pseudo_gt": pseudo_gt})
