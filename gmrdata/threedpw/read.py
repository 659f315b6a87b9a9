"""One sequence of 3DPW: its arrays, its images, and what is odd about them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.threedpw.arrays import Person, SequenceArrays
from gmrdata.threedpw.images import SequenceImages, check_intrinsics, check_sequence_images
from gmrdata.threedpw.layout import SequenceFiles, find_sequence, require_inside, require_name
from gmrdata.threedpw.parse import read_sequence_file

SAME_POSE_RAD = 1e-3
"""Largest difference between a 30 Hz pose and the 60 Hz row that it was taken from [rad]."""


@dataclass(frozen=True, eq=False)
class Sequence3DPW:
    """A sequence: row t of the arrays belongs to image t."""

    files: SequenceFiles
    """Where it is."""
    arrays: SequenceArrays
    """The content of the sequence file."""
    images: SequenceImages
    """Its images."""
    problems: tuple[str, ...]
    """What is odd and doesn't keep the sequence from being used, for a person to read."""

    @property
    def name(self) -> str:
        """The sequence's name, that of its file."""
        return self.files.name

    @property
    def n_frames(self) -> int:
        """Number of frames N at 30 Hz."""
        return self.arrays.n_frames


def read_sequence(root: Path, name: str) -> Sequence3DPW:
    """Read a sequence by name from whichever split it is in.

    Args:
        root: The folder that holds `imageFiles` and `sequenceFiles`.
        name: Name of the sequence, e.g. `courtyard_arguing_00`.

    Raises:
        MissingInput: the sequence, or its folder of images, is not there.
        UnsafePickle: the pickle wants to call something; nothing was run.
        BrokenPickle: truncated, or no pickle.
        BadSequence: arrays that do not fit together, K of other images, or a path out of the root.
        BadFrames: not one image can be used.
    """
    return read_found(find_sequence(root, name))


def read_found(files: SequenceFiles) -> Sequence3DPW:
    """Read a sequence that `find_sequences` found; errors as in `read_sequence`."""
    require_name(files.name)
    require_inside(files.root, files.pickle_path)
    arrays = read_sequence_file(files.pickle_path)
    images = check_sequence_images(files, arrays.n_frames)
    check_intrinsics(files.pickle_path, arrays.intrinsics_px, images.width_px, images.height_px)
    return Sequence3DPW(files, arrays, images, tuple(_problems(files, arrays, images)))


def _problems(files: SequenceFiles, arrays: SequenceArrays, images: SequenceImages) -> list[str]:
    problems = []
    if arrays.name != files.name:
        problems.append(f"the file says that it is sequence {arrays.name[:100]!r}")
    bad_images = sum(fault != "" for fault in images.faults)
    if bad_images:
        problems.append(f"{bad_images} of {arrays.n_frames} images can't be used")
    if images.spare:
        problems.append(f"{images.spare} images beyond the last row")
    if len(arrays.people) > 2:
        problems.append(f"{len(arrays.people)} people, 3DPW has one or two")
    for index, person in enumerate(arrays.people):
        odd = _odd_60hz(person, arrays.img_frame_ids)
        problems += [f"person {index}: {odd}"] if odd else []
    return problems


def _odd_60hz(person: Person, img_frame_ids: np.ndarray) -> str:
    """What is odd about the 60 Hz arrays: `img_frame_ids` are rows of theirs, not image numbers."""
    poses, trans = person.poses_60hz_rad, person.trans_60hz_m
    if poses is None or trans is None:
        return "no 60 Hz arrays"
    if len(poses) != len(trans):
        return f"poses_60Hz has {len(poses)} rows, trans_60Hz {len(trans)}"
    if img_frame_ids.min() < 0 or img_frame_ids.max() >= len(poses):
        return f"img_frame_ids goes to {img_frame_ids.max()}, poses_60Hz has {len(poses)} rows"
    difference = np.abs(poses[img_frame_ids] - person.poses_rad)
    if np.nanmax(difference, initial=0.0) > SAME_POSE_RAD:
        return "img_frame_ids doesn't lead from poses_60Hz to poses"
    return ""
