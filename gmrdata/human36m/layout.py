"""Where Human3.6M's annotation files lie, and what its numbers mean."""

from pathlib import Path

from gmrdata.errors import MissingInput

TRAINING_SUBJECTS = (1, 5, 6, 7, 8)
"""Subjects that everybody trains on."""
TEST_SUBJECTS = (9, 11)
"""Subjects that everybody tests on."""
VIDEO_HZ = 50.0
"""Rate of the videos, and of frame numbers [Hz]."""
ACTIONS = {
    2: "Directions",
    3: "Discussion",
    4: "Eating",
    5: "Greeting",
    6: "Phoning",
    7: "Posing",
    8: "Purchases",
    9: "Sitting",
    10: "SittingDown",
    11: "Smoking",
    12: "Photo",
    13: "Waiting",
    14: "Walking",
    15: "WalkDog",
    16: "WalkTogether",
}
"""Names by the numbers that the files use."""
SIZES_PX = {1: (1000, 1002), 2: (1000, 1000), 3: (1000, 1000), 4: (1000, 1002)}
"""Width and height of each camera's images [px]: 54138969, 55011271, 58860488 and 60457274."""
PARAMETER_FILES = (
    "Human36M_subject{}_smpl_param.json",
    "Human36M_subject{}_SMPL_NeuralAnnot.json",
)
"""Names of a subject's SMPL parameters; the first that is there is read."""
CAMERA_FILE = "Human36M_subject{}_camera.json"


def find_subjects(root: Path) -> dict[int, Path]:
    """The file of SMPL parameters of each subject, in the folder or in its `annotations`.

    Raises:
        MissingInput: there is none.
    """
    folders = (root, root / "annotations")
    found = {}
    for subject in (*TRAINING_SUBJECTS, *TEST_SUBJECTS):
        names = [name.format(subject) for name in PARAMETER_FILES]
        paths = [folder / name for name in names for folder in folders]
        there = next((path for path in paths if path.is_file()), None)
        if there is not None:
            found[subject] = there
    if not found:
        raise MissingInput(
            f"{root}: no {PARAMETER_FILES[0].format('N')} here or in annotations/. Name the folder"
            " of Human3.6M's annotation files"
        )
    return found


def find_cameras(parameter_path: Path, subject: int) -> Path:
    """A subject's camera file: beside the parameters, or in `annotations` or the folder above.

    Raises:
        MissingInput: it is not there.
    """
    name = CAMERA_FILE.format(subject)
    folder = parameter_path.parent
    for place in (folder, folder / "annotations", folder.parent):
        if (place / name).is_file():
            return place / name
    raise MissingInput(f"{folder / name}: no such file. Put the subject's cameras there")
