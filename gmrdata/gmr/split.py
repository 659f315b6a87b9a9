"""Which clips are trained on, by subject and by published lists.

A clip's subject and trial are read from its source in the manifest.  A CMU trial is the same
recording in each form: `CMU 02_03` from ASF/AMC or BVH, and AMASS's `CMU/02/02_03_poses`.  A file
of unknown origin whose name is a CMU trial's is taken for that trial: rather a clip too few than
one that is scored later.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath

from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.runs import ClipFile, usable_files
from gmrdata.gmr.windows import Mix
from gmrdata.manifest.current import ListManifest, Source
from gmrdata.manifest.read import read_manifest
from gmrdata.read.source_motion import CMU_TRIAL
from gmrdata.stage import recipes
from gmrdata.values.errors import BadManifest, BadRecipe

_OTHERS = ("gmrdata", "3DPW", "Human3.6M", "EMDB")  # no CMU trials, whatever they are called


@dataclass(frozen=True)
class Split:
    """The clips of all manifests."""

    training: tuple[ClipFile, ...]  # manifest by manifest
    held_out: tuple[ClipFile, ...]  # of the held-out subjects, to score
    left_out: dict[str, int]  # how many clips are not trained on, by the reason
    mix: Mix  # how the training clips belong to the manifests

    @property
    def statement(self) -> str:
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.left_out.items())
        n_out = sum(self.left_out.values())
        total = len(self.training) + n_out
        return f"not trained on: {n_out} of {total} clips ({reasons})" if n_out else ""


def split_manifests(manifest_paths: Sequence[Path], config: DataConfig) -> Split:
    """Choose the clips of manifests."""
    if config.weights is not None and len(config.weights) != len(manifest_paths):
        raise BadRecipe(
            f"data.weights has {len(config.weights)} weights for {len(manifest_paths)} manifests."
            " Give one for each, or none"
        )
    lists = {name: _listed(name) for name in config.never_train_on}
    wanted = {_subject_key(subject): str(subject) for subject in config.held_out_subjects}
    training: list[list[ClipFile]] = []
    held_out: list[ClipFile] = []
    found: set[str] = set()
    left_out: Counter[str] = Counter()
    for path in manifest_paths:
        training.append([])
        for file in usable_files(path)[0]:
            subject = subject_of(file.entry.source)
            on_lists = [name for name, keys in lists.items() if _key(file.entry.source) in keys]
            if subject is not None and subject in wanted:
                found.add(subject)
                held_out.append(file)
                left_out[f"of held-out subject {wanted[subject]}"] += 1
            elif on_lists:
                left_out[f"on the list {on_lists[0]}"] += 1
            else:
                training[-1].append(file)
    missing = [name for key, name in wanted.items() if key not in found]
    if missing:
        raise BadRecipe(f"data.held_out_subjects: no clip is of {', '.join(missing)}")
    names = tuple(path.name for path in manifest_paths)
    mix = Mix(tuple(map(len, training)), config.weights, names)
    split = Split(tuple(chain(*training)), tuple(held_out), dict(left_out), mix)
    if not split.training:
        said = f" ({split.statement})" if split.statement else ""
        raise BadManifest(f"no usable clips{said}. Give manifests with clips that are not rejected")
    return split


def subject_of(source: Source) -> str | None:
    """Who moves: `CMU/02`, `KIT/3` of AMASS, `Human3.6M/S9`, `EMDB/P0`; None if that isn't said."""
    trial = cmu_trial(source)
    if trial is not None:
        return _subject_key(int(trial.partition("_")[0]))
    parts = PurePosixPath(source.sequence).parts
    if source.dataset == "AMASS" and len(parts) == 3:
        return f"{parts[0]}/{parts[1]}"
    if source.dataset in ("Human3.6M", "EMDB") and len(parts) > 1:
        return f"{source.dataset}/{parts[0]}"
    return None


def cmu_trial(source: Source) -> str | None:
    """The CMU trial that a clip is of, like 02_03; None if it is of none."""
    parts = PurePosixPath(source.sequence).parts
    is_another_set = source.dataset == "AMASS" and len(parts) == 3 and parts[0] != "CMU"
    if source.dataset in _OTHERS or is_another_set:
        return None
    match = CMU_TRIAL.match(parts[-1])
    return f"{int(match.group(1)):02d}_{match.group(2)}" if match else None


def _listed(name: str) -> frozenset[tuple[str, str]]:
    published = read_manifest(recipes.published_manifest(name))
    if not isinstance(published, ListManifest):
        raise BadRecipe(f"data.never_train_on: {name} is no published list")
    return frozenset(_key(row.source) for row in published.clips)


def _key(source: Source) -> tuple[str, str]:
    """What two clips of one recording have in common."""
    trial = cmu_trial(source)
    return ("CMU", trial) if trial is not None else (source.dataset, source.sequence)


def _subject_key(subject: int | str) -> str:
    text = str(subject)
    return f"CMU/{int(text):02d}" if text.isascii() and text.isdigit() else text
