"""Read a twin set: the dataset's root, what each sequence is, and its exact people."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata.clip import Clip, load_clip
from gmrdata.errors import BadRecord, MissingInput
from gmrdata.store import read_json
from gmrdata.threedpw.layout import require_name
from gmrdata.threedpw.twin_set import DATASET_FOLDER, TRUTH_FOLDER, TWINS_FILE


@dataclass(frozen=True)
class TwinTruth:
    """A folder that `gmrdata threedpw twin` made."""

    folder: Path
    """The folder."""
    classes: dict[str, str]
    """What the camera does, by sequence."""

    @property
    def root(self) -> Path:
        """The dataset, in 3DPW's layout."""
        return self.folder / DATASET_FOLDER

    def people(self, name: str) -> list[Clip]:
        """The exact people of a sequence.

        Raises:
            MissingInput: there is no such sequence, or it has no people.
        """
        if name not in self.classes:
            raise MissingInput(
                f"{self.folder}: no twin {name!r}; there are {', '.join(self.classes)}"
            )
        folder = self.folder / TRUTH_FOLDER
        clips: list[Clip] = []
        while (path := folder / f"{name}.p{len(clips)}.npz").is_file():
            clips.append(load_clip(path))
        if not clips:
            raise MissingInput(f"{folder}: no {name}.p0.npz; make the twins again")
        return clips


def read_truth(folder: Path) -> TwinTruth:
    """Read `truth/twins.json` of a twin set.

    Raises:
        MissingInput: the folder is no twin set.
        BadRecord: twins.json is broken.
        BadSequence: a name in it is no sequence's.
    """
    path = folder / TRUTH_FOLDER / TWINS_FILE
    if not path.is_file():
        raise MissingInput(f"{path}: no such file; give a folder that `gmrdata threedpw twin` made")
    record = read_json(path)
    try:
        classes = {str(row["name"]): str(row["class_true"]) for row in record["sequences"]}
    except (KeyError, TypeError):
        raise BadRecord(
            f"{path}: not a list of sequences with name and class_true; make the twins again"
        ) from None
    for name in classes:
        require_name(name)
    return TwinTruth(folder, classes)
