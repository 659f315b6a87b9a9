"""What the recipe of a regenerated data set may say, and where such a set keeps what."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from gmrdata.manifest.current import Semver
from gmrdata.read.threedpw import ValidRule
from gmrdata.solve.request import SequenceConfig
from gmrdata.threedpw.intrinsics_check import IntrinsicsCheckConfig
from gmrdata.values import limits
from gmrdata.values.records import Config
from gmrdata.world.recipe import Override


class ThreedpwRecipe(Config):
    """World-frame pseudo ground truth for sequences in 3DPW's layout."""

    recipe: Literal["threedpw"]
    name: str = Field(default="3dpw-world", pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")
    """Name of the data set that is made."""
    version: Semver = "1.0.0"
    """Its version, major.minor.patch."""
    licence: str = Field(default="3DPW's licence: research only, not to be passed on", min_length=1)
    bodies: tuple[str, ...] = Field(default=("anny",), min_length=1)
    """Body models: SMPL's female and male files for 3DPW; "anny" for twins."""
    valid_rule: ValidRule = "campose_valid"
    """Which frames of a person the data set vouches for."""
    sequences: tuple[str, ...] = ()
    """Names of sequences; all when empty."""
    overrides: dict[str, Override] = Field(default_factory=dict)
    """What a person decided of sequences, by name."""
    intrinsics: IntrinsicsCheckConfig = IntrinsicsCheckConfig()
    """How the data set's intrinsics are checked against its 2D keypoints."""
    workers: int = Field(default=2, ge=1, le=limits.MOST_WORKERS)
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


@dataclass(frozen=True)
class SetPaths:
    """The output folder of `gmrdata threedpw`; the manifest stands in it and points below it."""

    root: Path

    @property
    def manifest(self) -> Path:
        return self.root / "pseudo_gt.yaml"

    @property
    def verdicts(self) -> Path:
        """Every sequence's verdict, those included that could not be read."""
        return self.root / "verdicts.json"

    @property
    def failures_dir(self) -> Path:
        """Why sequences failed, one text file each."""
        return self.root / "failed"

    @property
    def index_page(self) -> Path:
        return self.root / "index.html"

    @property
    def pages_dir(self) -> Path:
        return self.root / "qa"

    def body_dir(self, number: int) -> Path:
        return self.root / "bodies" / f"body_{number}"

    def sequence_dir(self, name: str) -> Path:
        """All stages of one sequence: `people`, `masks`, `sfm`, `lines`, and `pseudo_gt`: the world
        motions, or why there are none."""
        return self.root / "sequences" / name

    def pseudo_gt_dir(self, name: str) -> Path:
        return self.sequence_dir(name) / "pseudo_gt"
