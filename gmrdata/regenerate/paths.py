"""Where a regenerated data set keeps what: the only place that knows these names."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SetPaths:
    """The output folder of `gmrdata threedpw`."""

    root: Path
    """The folder; the manifest stands in it and points below it."""

    @property
    def manifest(self) -> Path:
        """The manifest."""
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
        """Every sequence at a glance."""
        return self.root / "index.html"

    @property
    def pages_dir(self) -> Path:
        """A page for each sequence."""
        return self.root / "qa"

    def body_dir(self, number: int) -> Path:
        """Stage: a body of the recipe."""
        return self.root / "bodies" / f"body_{number}"

    def sequence_dir(self, name: str) -> Path:
        """All stages of one sequence."""
        return self.root / "sequences" / name

    def people_dir(self, name: str) -> Path:
        """Stage: the people as the cameras see them."""
        return self.sequence_dir(name) / "people"

    def masks_dir(self, name: str) -> Path:
        """Stage: the masks."""
        return self.sequence_dir(name) / "masks"

    def sfm_dir(self, name: str) -> Path:
        """Stage: the cameras."""
        return self.sequence_dir(name) / "sfm"

    def pseudo_gt_dir(self, name: str) -> Path:
        """Stage: the world motions, or why there are none."""
        return self.sequence_dir(name) / "pseudo_gt"
