"""Our COLMAP stage on a data set, run as a user runs it, and what it left."""

from dataclasses import dataclass
from pathlib import Path

from render.timing import run_python

from gmrdata.manifest.current import ClipEntry, Manifest
from gmrdata.manifest.read import load_entry, read_manifest
from gmrdata.people.sources import masks_seconds
from gmrdata.stage.store import stage_seconds
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts
from gmrdata.values.clip import Clip
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.people import person_file


@dataclass(frozen=True)
class Regenerated:
    """The output folder of `gmrdata threedpw regenerate`."""

    root: Path
    """The folder."""

    def folder(self, name: str, stage: str) -> Path:
        """The folder of a sequence's stage."""
        return self.root / "sequences" / name / stage

    @property
    def manifest_path(self) -> Path:
        """The manifest."""
        return self.root / "pseudo_gt.yaml"

    @property
    def verdicts(self) -> dict[str, SequenceVerdict]:
        """Each sequence's verdict by name."""
        verdicts = Verdicts.read(self.root / "verdicts.json").sequences
        return {verdict.sequence: verdict for verdict in verdicts}

    def entries(self, name: str) -> list[ClipEntry]:
        """The manifest's clips of a sequence, in the order of its people."""
        manifest = read_manifest(self.manifest_path)
        assert isinstance(manifest, Manifest)
        return [clip for clip in manifest.clips if clip.source.sequence == name]

    def clips(self, name: str) -> list[Clip]:
        """They themselves; `valid` only where the manifest keeps a frame."""
        return [load_entry(self.manifest_path, entry) for entry in self.entries(name)]

    def camera_clips(self, name: str) -> list[Path]:
        """The people in the camera frame, which the plain recipe gets too."""
        people_dir = self.folder(name, "people")
        count = len(list(people_dir.glob("person_*.npz")))
        return [people_dir / person_file(number) for number in range(count)]

    def given_seconds(self, name: str) -> float:
        """Wall time of what the plain recipe gets as well: camera-frame people and masks [s]."""
        masks_dir = self.folder(name, "masks")
        people_s = stage_seconds(self.folder(name, "people"))
        return people_s + (masks_seconds(masks_dir) if masks_dir.is_dir() else 0.0)

    def own_seconds(self, name: str) -> float:
        """Wall time of cameras, scale and world motion [s]; nothing for a stage that failed."""
        folders = [self.folder(name, stage) for stage in ("sfm", "pseudo_gt")]
        return sum(stage_seconds(f) for f in folders if (f / STAGE_FILE).is_file())


def regenerate(
    root: Path,
    out_dir: Path,
    *,
    sequences: tuple[str, ...] = (),
    recipe: str | Path = "threedpw",
    workers: int = 1,
) -> Regenerated:
    """Run `gmrdata threedpw regenerate` in a process of its own.

    Args:
        root: The data set.
        out_dir: Its output folder.
        sequences: Names; all when empty.
        recipe: A recipe that travels with gmrdata, or a file.
        workers: Worker processes.
    """
    words: list[str | Path] = ["-m", "gmrdata", "threedpw", "regenerate", "--threedpw", root]
    words += ["--out", out_dir, "--recipe", recipe, "--workers", str(workers)]
    words += ["--sequences", *sequences] if sequences else []
    run_python(*words)
    return Regenerated(out_dir)
