"""Where 3DPW keeps its files, found without ever leaving its root folder.

3DPW/imageFiles/<sequence>/image_00000.jpg, image_00001.jpg, ...
3DPW/sequenceFiles/{train,validation,test}/<sequence>.pkl
"""

import re
from dataclasses import dataclass
from pathlib import Path

from gmrdata.values.errors import BadSequence, MissingInput

SPLITS = ("train", "validation", "test")
IMAGES_DIR, SEQUENCES_DIR = "imageFiles", "sequenceFiles"
SEQUENCE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""What a sequence may be called: one path component that can't climb or hide."""


@dataclass(frozen=True)
class SequenceFiles:
    """Where one sequence is; nothing of it was opened yet."""

    root: Path
    name: str
    split: str

    @property
    def pickle_path(self) -> Path:
        return self.root / SEQUENCES_DIR / self.split / f"{self.name}.pkl"

    @property
    def image_dir(self) -> Path:
        return self.root / IMAGES_DIR / self.name

    def image_path(self, row: int) -> Path:
        """The image of a row of the 30 Hz arrays; `img_frame_ids` plays no part in it."""
        return self.image_dir / f"image_{row:05d}.jpg"


def find_sequences(root: Path) -> list[SequenceFiles]:
    """All sequences in the three splits, by split and name; their files are not opened."""
    if not root.is_dir():
        raise MissingInput(f"{root}: no such folder; give the one that holds {IMAGES_DIR}")
    folder = root / SEQUENCES_DIR
    if not folder.is_dir():
        remedy = f"give 3DPW's root folder, which holds {IMAGES_DIR} and {SEQUENCES_DIR}"
        raise MissingInput(f"{root}: has no folder {SEQUENCES_DIR}; {remedy}")
    require_inside(root, folder)
    splits = [split for split in SPLITS if (folder / split).is_dir()]
    found = []
    for split in splits:
        require_inside(root, folder / split)
        names = sorted(path.stem for path in (folder / split).glob("*.pkl"))
        found += [SequenceFiles(root, name, split) for name in names if not name.startswith(".")]
    if not found:
        lack = f"no .pkl in {', '.join(splits)}"
        lack = lack if splits else f"none of {', '.join(SPLITS)} is in it"
        raise MissingInput(f"{folder}: {lack}; unpack 3DPW's sequenceFiles.zip there")
    return found


def find_sequence(root: Path, name: str) -> SequenceFiles:
    """One sequence by a name like `courtyard_arguing_00`, in whichever split it is."""
    require_name(name)
    sequences = find_sequences(root)
    found = [files for files in sequences if files.name == name]
    if not found:
        what = f"no sequence {name!r} in {', '.join(SPLITS)} ({len(sequences)} others)"
        raise MissingInput(f"{root}: {what}; `gmrdata threedpw list` shows the names")
    require_one_split(name, [files.split for files in found])
    return found[0]


def require_name(name: str) -> None:
    """Refuse names that are no single plain path component."""
    if not SEQUENCE_NAME.fullmatch(name):
        like = "those are like courtyard_arguing_00, without folders and suffix"
        raise BadSequence(f"{name!r} is no name of a sequence; {like}")


def require_one_split(name: str, splits: list[str]) -> None:
    """Refuse a sequence that is in several splits, since its images can belong to only one."""
    if len(splits) > 1:
        raise BadSequence(f"{name}: is in {' and '.join(splits)}; keep one of the files")


def splits_of(sequences: list[SequenceFiles]) -> dict[str, list[str]]:
    """The splits that have each name."""
    splits: dict[str, list[str]] = {}
    for files in sequences:
        splits.setdefault(files.name, []).append(files.split)
    return splits


def require_inside(root: Path, path: Path) -> None:
    """Refuse a path that a link or `..` leads out of the root, which may be a link itself."""
    try:
        leads_to = path.resolve()
    except (OSError, RuntimeError) as error:  # links that point at each other
        raise BadSequence(f"{path}: can't be followed ({error}); put the file there") from None
    if not leads_to.is_relative_to(root.resolve()):
        remedy = "put the file itself there, or give the folder that really holds the dataset"
        raise BadSequence(f"{path}: is, or passes, a link out of {root}; {remedy} as root")
