"""The tracks of PHALP, which 4D-Humans' track.py writes with its own pose estimator in it.

`outputs/results/demo_<video>.pkl`, written by joblib.dump with zlib: a dict from the frame's name
to a dict of the frame (phalp/trackers/PHALP.py of brjathu/PHALP; the table in 4D-Humans' README).
Its lists have one entry per track:

- `time` the frame's number, from 0; `shot` 1 where a new shot begins,
- `tid` each track's number; `tracked_time` frames since it was last seen,
- `smpl` each track's `body_pose` (23, 3, 3), `global_orient` (1, 3, 3) and `betas` (10,).

A track that is not seen stays in the lists for a while with its last pose.  Such entries
(`tracked_time` above 0) are no poses of their frame and are left out; and no motion is bridged
over the beginning of a shot, although tracks go on there.

Older versions also stored `embedding` as torch's tensors, which the reader of pickles refuses.
"""

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.body.tree import N_LOCAL
from gmrdata.errors import BadMotionFile
from gmrdata.local_pose.people import (
    PersonPoses,
    frame_numbers,
    mean_betas,
    numbers,
    orthonormal,
    person_name,
    shown,
    whole_number,
)

KEYS = frozenset({"time", "tid", "smpl"})
"""What tells these files from others."""


def people_of_phalp(content: Mapping[Any, Any], path: Path) -> list[PersonPoses]:
    """The people of a file.

    Args:
        content: What the file holds.
        path: The file, for messages.

    Raises:
        BadMotionFile: a list is missing or shorter than others, an array has another shape, or
            holds NaN.
    """
    tracks: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    cuts = set()
    for name, frame in content.items():
        time = _check_frame(frame, shown(name), path)
        if whole_number(frame.get("shot")):
            cuts.add(time)
        unseen = frame.get("tracked_time") or [0] * len(frame["tid"])
        for track, waited, smpl in zip(frame["tid"], unseen, frame["smpl"], strict=False):
            if whole_number(waited) == 0:
                tracks[person_name(track, path)].append((time, smpl))
    return [
        _person(name, sorted(entries, key=lambda entry: entry[0]), frozenset(cuts), path)
        for name, entries in tracks.items()
    ]


def _check_frame(frame: Any, name: str, path: Path) -> int:
    """The frame's number."""
    missing = sorted(KEYS - frame.keys()) if isinstance(frame, Mapping) else sorted(KEYS)
    if missing:
        raise BadMotionFile(f"{path}: frame {name} has no {missing[0]!r}; make the file again")
    lists = [frame[key] for key in ("tid", "smpl", "tracked_time") if frame.get(key) is not None]
    if not all(isinstance(one, list) and len(one) == len(frame["tid"]) for one in lists):
        raise BadMotionFile(
            f"{path}: the lists of frame {name} are of different lengths; make the file again"
        )
    time = whole_number(frame["time"])
    if time is None:
        raise BadMotionFile(f"{path}: the time of frame {name} is no number; make it again")
    return time


def _person(
    name: str, entries: list[tuple[int, Any]], cuts: frozenset[int], path: Path
) -> PersonPoses:
    poses = [_pose(smpl, name, time, path) for time, smpl in entries]
    times = [time for time, _ in entries]
    betas = [smpl["betas"] for _, smpl in entries if "betas" in smpl]
    known = numbers(betas, f"betas of {name}", path).reshape(len(betas), -1) if betas else None
    return PersonPoses(
        name=name,
        local_rotmats=orthonormal(np.stack(poses), f"body_pose of {name}", path),
        frame_numbers=frame_numbers(times, len(poses), f"times of {name}", path),
        betas=mean_betas(known, f"betas of {name}", path),
        cuts=cuts,
    )


def _pose(smpl: Any, name: str, time: int, path: Path) -> np.ndarray:
    """(23, 3, 3) of one track in one frame."""
    found = smpl.get("body_pose") if isinstance(smpl, Mapping) else None
    pose = numbers(found, f"body_pose of {name} in frame {time}", path)
    if pose.shape != (N_LOCAL, 3, 3):
        raise BadMotionFile(
            f"{path}: body_pose of {name} in frame {time} is {pose.shape}, not ({N_LOCAL}, 3, 3)."
            " Give PHALP's own output"
        )
    return pose
