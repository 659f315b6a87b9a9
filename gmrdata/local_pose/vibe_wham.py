"""VIBE's `vibe_output.pkl` and WHAM's `wham_output.pkl`.

Both are written by joblib.dump: a dict from the tracker's person number to a dict of arrays over
the T frames in which the person was tracked (VIBE: demo.py of mkocabas/VIBE and the table in its
doc/demo.md; WHAM: demo.py of yohanshin/WHAM, with `--save_pkl`).  Read are

- `pose` (T, 72) axis-angle of SMPL's 24 joints, the root (in the camera's frame) first [rad],
- `frame_ids` (T,) the video's frames, from 0; a track may have gaps,
- `betas` (T, 10) SMPL's neutral shape.

Not read: VIBE's `pred_cam`, `orig_cam`, `verts`, `joints2d`, `bboxes`, and WHAM's `trans`,
`pose_world`, `trans_world`, `verts`.  WHAM's `pose_world` differs from `pose` in the root alone.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gmrdata.body.tree import N_JOINTS
from gmrdata.errors import BadMotionFile
from gmrdata.local_pose.people import (
    PersonPoses,
    frame_numbers,
    mean_betas,
    numbers,
    person_name,
    rotmats_of_rotvecs,
)

KEYS = frozenset({"pose", "frame_ids"})
"""What tells these files from others."""


def people_of_vibe_or_wham(content: Mapping[Any, Any], path: Path) -> list[PersonPoses]:
    """The people of a file.

    Args:
        content: What the file holds.
        path: The file, for messages.

    Raises:
        BadMotionFile: an array is missing, has another shape, or holds NaN.
    """
    return [_person(key, values, path) for key, values in content.items()]


def _person(key: Any, values: Any, path: Path) -> PersonPoses:
    name = person_name(key, path)
    missing = sorted(KEYS - values.keys()) if isinstance(values, Mapping) else sorted(KEYS)
    if missing:
        raise BadMotionFile(f"{path}: {name} has no {missing[0]!r}; make the file again")
    poses = numbers(values["pose"], f"pose of {name}", path)
    local_rotmats = rotmats_of_rotvecs(poses, N_JOINTS, f"pose of {name}", path)
    return PersonPoses(
        name=name,
        local_rotmats=local_rotmats,
        frame_numbers=frame_numbers(values["frame_ids"], len(poses), f"frame_ids of {name}", path),
        betas=mean_betas(values.get("betas"), f"betas of {name}", path),
    )
