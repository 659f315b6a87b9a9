"""CMU motions on the default body, and those of some subjects alone."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from record import OUT_DIR

from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.runs import split_manifests
from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ManifestHead, write_manifest
from gmrdata.motion.files import find_motions
from gmrdata.motion.library import make_library

HELD_OUT = (2, 8)
"""Subjects of whom every trial is scored and none is trained on."""
SMALL = ("02_01", "08_01", "05_01", "35_01", "16_15", "12_01")
"""Trials that are enough to try every part."""


@dataclass(frozen=True)
class Motions:
    """The manifest of all motions, and that of what a recipe holds out."""

    every: Path
    held_out: Path
    training_trials: frozenset[str]
    """Ids of the clips that are trained on."""


def import_motions(cmu_dirs: Sequence[Path], out_dir: Path, *, small: bool) -> Path:
    """Manifest of CMU's motions on the default body; those that are imported already are kept."""
    every = [file for folder in cmu_dirs for file in find_motions(folder)]
    files = [file for file in every if not small or file.stem in SMALL]
    return make_library(tuple(files), "anny", out_dir)


def every_motion(cmu_dir: Path, *, small: bool) -> Path:
    """Manifest of the CMU motions at hand, which all measurements share."""
    name = "cmu_motions_small" if small else "cmu_motions"
    return import_motions([cmu_dir], (OUT_DIR / name).resolve(), small=small)


def holding_out(config: TrainConfig, subjects: Sequence[int]) -> TrainConfig:
    """The recipe without some subjects.  02 and 08 are never trained on, whoever is scored."""
    held_out = tuple(sorted({*HELD_OUT, *subjects}))
    data = config.data.model_copy(update={"held_out_subjects": held_out})
    return config.model_copy(update={"data": data})


def scored_motions(every: Path, config: TrainConfig, subjects: Sequence[int]) -> Motions:
    """A manifest beside that of all motions, of what the recipe holds out of some subjects."""
    split = split_manifests([every], config.data)
    wanted = {f"{subject:02d}" for subject in subjects}
    ids = {file.entry.id for file in split.held_out if file.entry.id.split("_")[0] in wanted}
    held_out = part_of(every, f"subjects_{'_'.join(sorted(wanted))}", ids)
    return Motions(every, held_out, frozenset(file.entry.id for file in split.training))


def part_of(every: Path, name: str, ids: Collection[str]) -> Path:
    """A manifest of some clips beside that of all."""
    manifest = read_manifest(every)
    assert isinstance(manifest, Manifest)
    head = ManifestHead(
        name, manifest.version, manifest.description, manifest.kind, manifest.licence
    )
    clips = [clip for clip in manifest.clips if clip.id in ids]
    path = every.with_name(f"{name}.yaml")
    return write_manifest(path, head, clips, created_by=manifest.created_by, redo=True)
