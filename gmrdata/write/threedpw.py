"""Writing a sequence file in 3DPW's layout, key for key, for twins and tests.

The pickles are as Python 2 wrote 3DPW's own: protocol 2, byte strings, arrays.  They need
`encoding="latin1"` to be read, as the real files do.
"""

from pathlib import Path

import numpy as np

from gmrdata.read.threedpw_files import GENDERS, SPLITS, SequenceArrays, SequenceFiles, require_name
from gmrdata.values.errors import BadSequence
from gmrdata.values.files import write_bytes
from gmrdata.write.pickles import python2_pickle

LETTERS = {name: letter for letter, name in GENDERS.items()}
LARGEST_ID = (1 << 16) - 1  # 3DPW's `img_frame_ids` are uint16


def write_sequence(root: Path, split: str, arrays: SequenceArrays) -> SequenceFiles:
    """Write `sequenceFiles/<split>/<name>.pkl` under a root; the images are not written here."""
    if split not in SPLITS:
        raise BadSequence(f"{arrays.name}: no split {split!r}; there are {', '.join(SPLITS)}")
    files = SequenceFiles(root, arrays.name, split)
    write_bytes(files.pickle_path, sequence_bytes(arrays))
    return files


def sequence_bytes(arrays: SequenceArrays) -> bytes:
    """A sequence file; the same arrays give the same bytes.

    `read_sequence_file` gives back the same arrays, bit for bit.  Optional arrays that no person
    has are left out.  `texture_maps` is empty, as it is in 3DPW's own files.
    """
    require_name(arrays.name)
    return python2_pickle(_content(arrays))


def _content(arrays: SequenceArrays) -> dict[str, object]:
    people, ids = arrays.people, arrays.img_frame_ids
    if len(ids) and not (ids.min() >= 0 and ids.max() <= LARGEST_ID):
        what = f"img_frame_ids goes to {ids.max()}, 3DPW's uint16 to {LARGEST_ID}"
        raise BadSequence(f"{arrays.name}: {what}; cut the sequence into shorter ones")
    for person in people:
        if person.gender not in LETTERS:
            what = f"the body is {person.gender}, and 3DPW has female and male ones alone"
            raise BadSequence(f"{arrays.name}: {what}")
    content: dict[str, object] = {
        "sequence": arrays.name,
        "betas": [person.betas for person in people],
        "poses": [person.poses_rad for person in people],
        "trans": [person.trans_m for person in people],
        "genders": [LETTERS[person.gender] for person in people],
        "texture_maps": [],
        "poses2d": [person.poses2d_px.transpose(0, 2, 1) for person in people],
        "img_frame_ids": ids.astype(np.uint16),
        "cam_poses": arrays.cam_from_world,
        "campose_valid": [person.campose_valid.astype(np.uint8) for person in people],
        "cam_intrinsics": arrays.intrinsics_px,
    }
    joints_m = [person.joints_world_m for person in people]
    optional = {
        "poses_60Hz": [person.poses_60hz_rad for person in people],
        "trans_60Hz": [person.trans_60hz_m for person in people],
        "betas_clothed": [person.betas_clothed for person in people],
        "v_template_clothed": [person.template_clothed_m for person in people],
        "jointPositions": [None if m is None else m.reshape(len(m), 72) for m in joints_m],
    }
    for key, values in optional.items():
        n_given = sum(value is not None for value in values)
        if 0 < n_given < len(people):
            raise BadSequence(f"{arrays.name}: only some people have {key}; give all or none")
        content |= {key: values} if n_given else {}
    return content
