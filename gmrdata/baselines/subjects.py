"""The people of a manifest whose motion is to be predicted."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.clip import Clip, read_npz
from gmrdata.errors import BadMotionFile
from gmrdata.gmr.usable import usable_files
from gmrdata.paths import resolve_inside


@dataclass(frozen=True, eq=False)
class Subject:
    """A clip of the manifest, and what writing another motion of the same body takes."""

    clip: Clip
    """The clip; `valid` is False outside the manifest's kept ranges, and True somewhere."""
    rest_pelvis_m: np.ndarray
    """(3,) J0 of its body and shape, rest frame [m]."""


def manifest_subjects(path: Path) -> tuple[list[Subject], dict[str, str]]:
    """The clips of a manifest, and the reason by id of those that can't be used.

    Raises:
        MissingInput: the manifest or a clip's file is not there.
        BadManifest: the manifest is broken, or only a list.
        BadMotionFile: a clip's file is broken.
    """
    files, left_out = usable_files(path)
    subjects = []
    for file in files:
        clip = file.load()
        if clip.valid.any():
            arrays = read_npz(resolve_inside(path.parent, file.entry.arrays.path))
            subjects.append(Subject(clip, arrays["rest_pelvis_m"]))
        else:
            left_out[clip.id] = "no frame is valid"
    return subjects, left_out


def first_pose(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Root rotation (3, 3) and pelvis (3,) [m] of the first valid row.

    A baseline that knows motions alone begins here; no error of motions sees where it begins.

    Raises:
        BadMotionFile: that row holds NaN or infinite numbers.
    """
    row = int(np.argmax(clip.valid))
    root_rotmat, pelvis_m = clip.motion.root_rotmats[row], clip.motion.pelvis_m[row]
    if not (np.isfinite(root_rotmat).all() and np.isfinite(pelvis_m).all()):
        raise BadMotionFile(
            f"clip {clip.id}: frame {row} holds NaN or infinite numbers. Mark such frames as not"
            " valid, or make the clip again"
        )
    return root_rotmat, pelvis_m
