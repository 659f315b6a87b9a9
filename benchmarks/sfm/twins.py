"""Twins to measure on: 3DPW's layout and faults, with the truth kept aside; rendered once."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from record import OUT_DIR
from render.timing import run_python

from gmrdata.read.threedpw_files import SequenceFiles, find_sequence
from gmrdata.twins.twin_set import TwinSequence, TwinsRecord


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
        return {twin.name: twin.class_true for twin in self._twins}

    @property
    def places(self) -> dict[str, str]:
        """Kind of place, by sequence."""
        return {twin.name: twin.scene.kind for twin in self._twins}

    @property
    def _twins(self) -> tuple[TwinSequence, ...]:
        return TwinsRecord.read(self.truth_dir / "twins.json").sequences

    def files(self, name: str) -> SequenceFiles:
        """A sequence's files."""
        return find_sequence(self.root, name)


def the_twins(given: Path | None, small: bool, motions_dir: Callable[[], Path]) -> Twins:
    """The eight twins, if none are given; two small ones where only the parts are tried."""
    if given is not None:
        return Twins(given.resolve())
    name = "twins_small" if small else "twins"
    return make_twins(name, (OUT_DIR / name).resolve(), None if small else motions_dir())


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
