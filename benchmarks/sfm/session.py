"""What the measurements of the COLMAP stage share: twins, our run on them, and the record."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml
from record import OUT_DIR, Record, machine
from sfm.ours import Regenerated, regenerate
from sfm.twins import Twins, make_twins, the_twins

LONG_RECIPE, ROLLING_RECIPE = (Path(__file__).parent / f"{n}.yaml" for n in ("long", "rolling"))


@dataclass
class Session:
    """One run of the measurements; what it makes lies in `out/bench/sfm`, which it empties."""

    small: bool
    """Whether to only try every part, without bars."""
    twins_given: Path | None
    """Twins that are there already."""
    motions_dir: Callable[[], Path]
    """Where the motions of the twins are; asked only where twins are rendered."""

    def __post_init__(self) -> None:
        shutil.rmtree(self.work_dir, ignore_errors=True)
        self.work_dir.mkdir(parents=True)

    @cached_property
    def record(self) -> Record:
        """What was measured so far."""
        return Record(OUT_DIR / "sfm.json", self.small, self._settings)

    @property
    def work_dir(self) -> Path:
        """Where runs are kept, to look at."""
        return (OUT_DIR / "sfm").resolve()

    @cached_property
    def twins(self) -> Twins:
        """The data sets to measure on."""
        return the_twins(self.twins_given, self.small, self.motions_dir)

    @cached_property
    def long_twins(self) -> Twins:
        """A sequence of 300 frames."""
        if self.small:
            return self.twins
        return make_twins(LONG_RECIPE, (OUT_DIR / "twins_long").resolve())

    def rolling_twins(self, readout: float) -> Twins:
        """Two short walks, whose rows are read out within this share of the time of a frame."""
        recipe = yaml.safe_load(ROLLING_RECIPE.read_text(encoding="utf-8"))
        recipe["set"]["render"]["readout"] = readout
        if self.small:
            recipe["set"]["film"] |= {"duration_s": 0.8, "width_px": 180, "height_px": 320}
        name = f"twins_rolling_{readout:g}{'_small' if self.small else ''}"
        path = (OUT_DIR / f"{name}.yaml").resolve()
        path.write_text(yaml.safe_dump(recipe), encoding="utf-8")
        return make_twins(path, path.with_suffix(""))

    @cached_property
    def made(self) -> Regenerated:
        """Our run on the twins: one worker process."""
        return self.regenerate(self.twins.root, "ours")

    def regenerate(self, root: Path, name: str, *, workers: int = 1) -> Regenerated:
        """Our run on a data set, with a name of its own."""
        return regenerate(root, self.work_dir / name, workers=workers)

    def _settings(self) -> dict[str, Any]:
        return machine() | {
            "scale": "small" if self.small else "full",
            "twins": "given" if self.twins_given is not None else "rendered by the recipe",
            "threads": "images, features: one per core; all else: ours one, plain one per core",
            "pycolmap": metadata.version("pycolmap"),
        }
