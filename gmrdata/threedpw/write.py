"""Writing a sequence file in 3DPW's layout, key for key, for twins and tests."""

from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.errors import BadSequence
from gmrdata.store import atomic_path
from gmrdata.threedpw.arrays import Person, SequenceArrays
from gmrdata.threedpw.layout import SPLITS, SequenceFiles, require_name
from gmrdata.threedpw.python2_pickle import python2_pickle

LETTERS = {"female": "f", "male": "m"}
LARGEST_ID = (1 << 16) - 1
"""3DPW's `img_frame_ids` are uint16."""


def write_sequence(root: Path, split: str, arrays: SequenceArrays) -> SequenceFiles:
    """Write `sequenceFiles/<split>/<name>.pkl` under a root; the images are not written here.

    Args:
        root: The dataset's root folder; made if it is not there.
        split: `train`, `validation` or `test`.
        arrays: The content.

    Returns:
        Where the sequence is, and where its images belong.

    Raises:
        BadSequence: no such split, a name that is no plain name, or arrays that can't be written.
    """
    if split not in SPLITS:
        raise BadSequence(f"{arrays.name}: no split {split!r}; there are {', '.join(SPLITS)}")
    files = SequenceFiles(root, arrays.name, split)
    write_sequence_file(files.pickle_path, arrays)
    return files


def write_sequence_file(path: Path, arrays: SequenceArrays) -> None:
    """Write a sequence file, as a whole or not at all; the same arrays give the same bytes.

    `read_sequence_file` gives back the same arrays, bit for bit.  Optional arrays that no person
    has are left out.  `texture_maps` is empty, as it is in 3DPW's own files.

    Args:
        path: The file.
        arrays: The content.

    Raises:
        BadSequence: the name is no plain name, an id is no uint16, or only some of the people have
            an optional array.
    """
    require_name(arrays.name)
    content = python2_pickle(_content(arrays))
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _content(arrays: SequenceArrays) -> dict[str, Any]:
    people, ids = arrays.people, arrays.img_frame_ids
    if len(ids) and not (ids.min() >= 0 and ids.max() <= LARGEST_ID):
        raise BadSequence(
            f"{arrays.name}: img_frame_ids goes to {ids.max()}, 3DPW's uint16 to {LARGEST_ID}; "
            "cut the sequence into shorter ones"
        )
    content: dict[str, Any] = {
        "sequence": arrays.name,
        "betas": [person.betas for person in people],
        "poses": [person.poses_rad for person in people],
        "trans": [person.trans_m for person in people],
        "genders": [_letter(arrays, person) for person in people],
        "texture_maps": [],
        "poses2d": [person.poses2d_px.transpose(0, 2, 1) for person in people],
        "img_frame_ids": ids.astype(np.uint16),
        "cam_poses": arrays.cam_from_world,
        "campose_valid": [person.campose_valid.astype(np.uint8) for person in people],
        "cam_intrinsics": arrays.intrinsics_px,
    }
    optional = {
        "poses_60Hz": [person.poses_60hz_rad for person in people],
        "trans_60Hz": [person.trans_60hz_m for person in people],
        "betas_clothed": [person.betas_clothed for person in people],
        "v_template_clothed": [person.template_clothed_m for person in people],
        "jointPositions": [_flat(person.joints_world_m) for person in people],
    }
    for key, values in optional.items():
        given = [value is not None for value in values]
        if any(given) and not all(given):
            raise BadSequence(f"{arrays.name}: only some people have {key}; give all or none")
        if any(given):
            content[key] = values
    return content


def _letter(arrays: SequenceArrays, person: Person) -> str:
    if person.gender not in LETTERS:
        raise BadSequence(
            f"{arrays.name}: gender {person.gender!r} has no letter in 3DPW; say female or male"
        )
    return LETTERS[person.gender]


def _flat(joints_m: np.ndarray | None) -> np.ndarray | None:
    return None if joints_m is None else joints_m.reshape(len(joints_m), 72)
