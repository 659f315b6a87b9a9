"""Twins to measure on: 3DPW's layout and faults, with the truth kept aside; rendered once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from render.timing import run_python

from gmrdata.read.threedpw_layout import SequenceFiles, find_sequence
from gmrdata.values.files import read_json


@dataclass(frozen=True)
class Twins:
    """A folder that `gmrdata threedpw twin` made."""

    folder: Path
    """The folder."""

    @property
    def root(self) -> Path:
        """The data set."""
        return self.folder / "3DPW"

    @property
    def truth_dir(self) -> Path:
        """The exact clips."""
        return self.folder / "truth"

    @property
    def classes(self) -> dict[str, str]:
        """What the camera does, by sequence."""
        return {row["name"]: row["class_true"] for row in self._rows}

    @property
    def places(self) -> dict[str, str]:
        """Kind of place, by sequence."""
        return {row["name"]: row["scene"]["kind"] for row in self._rows}

    @property
    def _rows(self) -> list[dict[str, Any]]:
        return list(read_json(self.truth_dir / "twins.json")["sequences"])

    def files(self, name: str) -> SequenceFiles:
        """A sequence's files."""
        return find_sequence(self.root, name)


def make_twins(recipe: str | Path, folder: Path, motions_dir: Path | None = None) -> Twins:
    """Render a set of twins; one that is there and whole is taken as it is.

    Args:
        recipe: A recipe of kind `threedpw_twin`, by name or path.
        folder: Where the twins are kept from one measurement to the next.
        motions_dir: The motions that the recipe names.
    """
    motions: list[str | Path] = [] if motions_dir is None else ["--motions", motions_dir]
    run_python("-m", "gmrdata", "threedpw", "twin", recipe, *motions, "--out", folder)
    return Twins(folder)
