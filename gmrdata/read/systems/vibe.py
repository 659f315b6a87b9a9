"""VIBE's `vibe_output.pkl`: people in crops (demo.py and doc/demo.md of mkocabas/VIBE; joblib).

A dict from the tracker's person number to a dict of arrays over the T frames of its track:

`pose` (T, 72)       axis-angle of SMPL's 24 joints, the root first, in the camera's frame [rad]
`betas` (T, 10)      SMPL's neutral shape
`frame_ids` (T,)     the video's frames from 0, with gaps
`pred_cam` (T, 3)    s, tx, ty of a crop, whose points are SMPL's plus (tx, ty, 2 * 5000 / (224 s)),
                     seen with 5000 px in a crop of 224 px (lib/models/spin.py, `projection`)
`bboxes` (T, 4)      x, y of the middle and twice the side [px]
`orig_cam` (T, 4)    sx, sy, tx, ty of the whole picture, made of `pred_cam` as if the crop were as
                     large as the box

The crop that the network saw is 1.1 times as large as the box (demo.py, `bbox_scale`), which
`orig_cam` leaves out: VIBE draws people 1.1 times too small (its issue 182).  It is widened here.
Others who write the same keys have other crops or boxes; PARE's `pose` is (T, 24, 3, 3).
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import Entry, person_name, rotmats_of
from gmrdata.values.body import N_JOINTS
from gmrdata.values.people import Crop, EstimatedPeople, EstimatedPerson, InCamera

CROP_OVER_BOX, PARES = 1.1, 1.0
_OTHERS = (("(tcmr|glot|pymaf)", 1.0), ("mps-?net", 1.1 / 1.2), ("meva", 1.2))
"""How many times as large as its box the crop is, by the name of the file or its folder (demo.py of
TCMR, GLoT, PyMAF, MPS-Net and MEVA).  VIBE's own has `joints2d_img_coord` since February 2021."""
NETWORK_PX = 224.0
KEYS = frozenset({"pose", "frame_ids", "pred_cam", "orig_cam"})
"""Any of which an entry has, when none of the others' does."""


def read_vibe(content: Mapping[Any, Any], path: Path) -> EstimatedPeople:
    people = (_person(Entry(one, person_name(key, path), path)) for key, one in content.items())
    return EstimatedPeople("vibe", (path,), tuple(people))


def _person(entry: Entry) -> EstimatedPerson:
    if entry.has("pose") and np.ndim(entry.values["pose"]) == 4:
        rotmats, widened = entry.rotations("pose", None, N_JOINTS), PARES
    else:
        rotmats, widened = rotmats_of(entry.array("pose", None, 3 * N_JOINTS)), _widened(entry)
    n_rows = len(rotmats)
    crop, in_picture = _crop(entry, n_rows, widened), _in_picture(entry, n_rows, widened)
    in_camera, lacks = None, entry.lacking("betas")
    if crop is not None or in_picture is not None:
        in_camera = InCamera(rotmats[:, 0], None, crop or "picture", in_picture=in_picture)
    else:
        lacks = entry.lacking("orig_cam")
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=entry.frame_numbers("frame_ids", n_rows),
        local_rotmats=rotmats[:, 1:],
        in_camera=in_camera,
        betas=entry.betas("betas", n_rows),
        lacks={"camera": lacks, "world": lacks},
    )


def _widened(entry: Entry) -> float:
    """The crop's side over the box's."""
    path = entry.path.absolute()
    if entry.has("joints2d_img_coord"):
        return CROP_OVER_BOX
    name = f"{path.parent.name} {'pymaf' if path.stem == 'output' else path.stem}".lower()
    ratios = (n for word, n in _OTHERS if re.search(f"(?<![a-z]){word}(?![a-z])", name))
    return next(ratios, CROP_OVER_BOX)


def _crop(entry: Entry, n_rows: int, widened: float) -> Crop | None:
    if not entry.has("pred_cam", "bboxes"):
        return None
    weak, boxes_px = entry.array("pred_cam", n_rows, 3), entry.array("bboxes", n_rows, 4)
    entry.positive("the scale of pred_cam", weak[:, 0])
    entry.positive("the size of bboxes", boxes_px[:, 2])
    return Crop(boxes_px[:, :2], widened * boxes_px[:, 2], weak, NETWORK_PX)


def _in_picture(entry: Entry, n_rows: int, widened: float) -> np.ndarray | None:
    """(T, 4) `orig_cam` of the crop that the network saw."""
    if not entry.has("orig_cam"):
        return None
    of_box = entry.array("orig_cam", n_rows, 4)
    entry.positive("the scale of orig_cam", of_box[:, :2])
    shifts_m = np.zeros((n_rows, 2))  # within the crop, by which its middle is not shifted
    if entry.has("pred_cam"):
        shifts_m = entry.array("pred_cam", n_rows, 3)[:, 1:]
    middles_m = (of_box[:, 2:] - shifts_m) / widened
    return np.concatenate([widened * of_box[:, :2], middles_m + shifts_m], axis=1)
