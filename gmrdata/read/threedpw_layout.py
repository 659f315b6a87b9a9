"""Where 3DPW keeps its files, found without ever leaving its root folder.

3DPW/imageFiles/<sequence>/image_00000.jpg, image_00001.jpg, ...
3DPW/sequenceFiles/{train,validation,test}/<sequence>.pkl
"""

import re
from collections import Counter
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
    """The dataset's root folder."""
    name: str
    """Name of the sequence, e.g. `courtyard_arguing_00`."""
    split: str
    """`train`, `validation` or `test`."""

    @property
    def pickle_path(self) -> Path:
        """The sequence file."""
        return self.root / SEQUENCES_DIR / self.split / f"{self.name}.pkl"

    @property
    def image_dir(self) -> Path:
        """The folder of its images."""
        return self.root / IMAGES_DIR / self.name

    def image_path(self, row: int) -> Path:
        """The image of a row of the 30 Hz arrays; `img_frame_ids` plays no part in it."""
        return self.image_dir / f"image_{row:05d}.jpg"


def find_sequences(root: Path) -> list[SequenceFiles]:
    """All sequences under a root, by split and name.  The sequence files are not opened.

    Other folders beside the three splits (some tools make one called `all`) are left alone.

    Raises:
        MissingInput: the root, or every split, is not there, or the splits are empty.
        BadSequence: a split's folder is a link out of the root.
    """
    folders = [(split, _require_layout(root) / split) for split in SPLITS]
    there = [(split, folder) for split, folder in folders if folder.is_dir()]
    if not there:
        raise MissingInput(
            f"{root / SEQUENCES_DIR}: none of {', '.join(SPLITS)} is in it; unpack 3DPW's "
            "sequenceFiles.zip there"
        )
    found = []
    for split, folder in there:
        require_inside(root, folder)
        names = sorted(path.stem for path in folder.glob("*.pkl"))
        found += [SequenceFiles(root, name, split) for name in names if not name.startswith(".")]
    if not found:
        raise MissingInput(
            f"{root / SEQUENCES_DIR}: no .pkl in {', '.join(split for split, _ in there)}; unpack "
            "3DPW's sequenceFiles.zip there"
        )
    return found


def find_sequence(root: Path, name: str) -> SequenceFiles:
    """One sequence by a name like `courtyard_arguing_00`, in whichever split it is.

    Raises:
        MissingInput: there is no such sequence.
        BadSequence: the name is no plain name, or two splits have it.
    """
    require_name(name)
    sequences = find_sequences(root)
    found = [files for files in sequences if files.name == name]
    if not found:
        raise MissingInput(
            f"{root}: no sequence {name!r} in {', '.join(SPLITS)} ({len(sequences)} others); "
            "`gmrdata threedpw list` shows the names"
        )
    require_one_split(name, [files.split for files in found])
    return found[0]


def require_name(name: str) -> None:
    """Refuse names that are no single plain path component.

    Raises:
        BadSequence: letters other than A-Z a-z 0-9 _ . - in it, a dot at the start, or too long.
    """
    if not SEQUENCE_NAME.fullmatch(name):
        raise BadSequence(
            f"{name!r} is no name of a sequence; those are like courtyard_arguing_00, without "
            "folders and suffix"
        )


def require_one_split(name: str, splits: list[str]) -> None:
    """Refuse a sequence that is in several splits, since its images can belong to only one.

    Raises:
        BadSequence: more than one split has it.
    """
    if len(splits) > 1:
        raise BadSequence(f"{name}: is in {' and '.join(splits)}; keep one of the files")


def splits_of(sequences: list[SequenceFiles]) -> dict[str, list[str]]:
    """The splits that have each name."""
    count = Counter(files.name for files in sequences)
    return {name: [f.split for f in sequences if f.name == name] for name in count}


def require_inside(root: Path, path: Path) -> None:
    """Refuse a path that leads out of the root through a link or `..`.

    The root itself may be a link: the user named it.

    Raises:
        BadSequence: it leads out, or links lead in a circle.
    """
    try:
        leads_to = path.resolve()
    except (OSError, RuntimeError) as error:  # links that point at each other
        raise BadSequence(f"{path}: can't be followed ({error}); put the file there") from None
    if not leads_to.is_relative_to(root.resolve()):
        raise BadSequence(
            f"{path}: is, or passes, a link out of {root}; put the file itself there, or give the "
            "folder that really holds the dataset as root"
        )


def _require_layout(root: Path) -> Path:
    if not root.is_dir():
        raise MissingInput(f"{root}: no such folder; give the one that holds {IMAGES_DIR}")
    sequences_dir = root / SEQUENCES_DIR
    if not sequences_dir.is_dir():
        raise MissingInput(
            f"{root}: has no folder {SEQUENCES_DIR}; give 3DPW's root folder, which holds "
            f"{IMAGES_DIR} and {SEQUENCES_DIR}"
        )
    require_inside(root, sequences_dir)
    return sequences_dir
