"""What a data set says of a sequence itself: its own camera, and what speaks against its frames."""

from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.values.files import write_npz
from gmrdata.values.records import ArrayShapes, Record, read_arrays

DATASET_CAMERA_FORMAT = "gmrdata-dataset-camera/1"
_SHAPES: ArrayShapes = {"world_from_cam": ("f", ("T", 4, 4))}


class Doubts(Record):
    """`doubts.json`: why the data set does not vouch for frames, or for the whole sequence."""

    format: Literal["gmrdata-doubts/1"] = "gmrdata-doubts/1"
    frames: tuple[tuple[str, ...], ...]
    """For each person T texts: why a frame must not be used; empty where it may."""
    sequence: tuple[str, ...]
    """Why the sequence can't be used at all; none where it can."""


def save_dataset_camera(path: Path, world_from_cam: np.ndarray) -> None:
    """Write a data set's metric cameras (T, 4, 4); NaN where unknown."""
    write_npz(path, {"format": DATASET_CAMERA_FORMAT, "world_from_cam": world_from_cam})


def load_dataset_camera(path: Path) -> np.ndarray:
    """Read cameras (T, 4, 4) [m], NaN where unknown."""
    return read_arrays(path, DATASET_CAMERA_FORMAT, _SHAPES)["world_from_cam"]
