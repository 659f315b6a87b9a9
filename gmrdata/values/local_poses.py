"""People before the camera, as the built-in estimator leaves them, and their files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, PositiveInt

from gmrdata.values.body import N_LOCAL
from gmrdata.values.files import write_npz
from gmrdata.values.people import person_file
from gmrdata.values.records import ArrayShapes, Record, check_shapes, read_arrays

POSES_FILE = "local_poses.json"
POSES_FORMAT = "gmrdata-poses/1"

_SHAPES: ArrayShapes = {
    "frame_numbers": ("iu", ("T",)),
    "local_rotmats": ("f", ("T", N_LOCAL, 3, 3)),
    "root_rotmats": ("f", ("T", 3, 3)),
    "pelvis_m": ("f", ("T", 3)),
}


@dataclass(frozen=True, eq=False)
class LocalPoses:
    """One person before the camera, over the T frames in which it was seen."""

    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video, counted from 0
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    root_rotmats: np.ndarray  # (T, 3, 3) cam_from_root
    pelvis_m: np.ndarray  # (T, 3) before the camera, for the body's mean shape [m]

    def write(self, path: Path) -> None:
        """Write the poses as an .npz without pickled objects."""
        arrays = {key: np.asarray(getattr(self, key)) for key in _SHAPES}
        check_shapes(path, arrays, _SHAPES)
        write_npz(path, {"format": np.array(POSES_FORMAT), **arrays})

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one person's poses; BadRecord names what is wrong with the file."""
        return cls(**read_arrays(path, POSES_FORMAT, _SHAPES))


class LocalPosesRecord(Record):
    """`local_poses.json`: who is in a folder of poses, and of what video."""

    format: Literal["gmrdata-local-poses/1"] = "gmrdata-local-poses/1"
    people: int = Field(ge=0)
    images: PositiveInt
    frames: PositiveInt
    """Of the video, up to the last image."""
    size_px: tuple[int, int]
    body: str
    """Of whose mean shape the places are."""
    method: str


def load_local_poses(folder: Path) -> tuple[LocalPosesRecord, list[LocalPoses]]:
    """The people of a finished folder; MissingInput or BadRecord names the file that is wrong."""
    record = LocalPosesRecord.read(folder / POSES_FILE)
    return record, [LocalPoses.read(folder / person_file(n)) for n in range(record.people)]
