"""WHAM's `wham_output.pkl` (demo.py of yohanshin/WHAM with --save_pkl; joblib).

A dict from the tracker's person number to a dict of arrays over the T frames of its track:

`pose` (T, 72)          axis-angle of SMPL's 24 joints, the root first, in the camera's frame [rad]
`trans` (T, 3)          SMPL's transl before the camera [m], whose focal length is the picture's
                        diagonal (lib/utils/imutils.py, `compute_cam_intrinsics`), also with
                        --calib, which only its SLAM reads
`pose_world` (T, 72)    the same poses with the root in the world, y up
`trans_world` (T, 3)    SMPL's transl there [m], as lib/eval/evaluate_emdb.py takes it
`betas` (T, 10)         SMPL's neutral shape
`frame_ids` (T,)        the video's frames from 0, with gaps

What its Python API returns (wham_api.py) has rotation matrices instead, `poses_body` (T, 23, 3, 3),
`poses_root_cam` and `poses_root_world`, `frame_id`, and no `trans`.

gmrdata's own export (`gmrdata.write.systems`) has `body` besides, the name of the body that
`betas` are of; it is of the video's own camera.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import (
    Z_UP_FROM_Y_UP,
    Entry,
    implied_camera,
    person_name,
    rotmats_of,
    turned,
)
from gmrdata.values.body import N_JOINTS, N_LOCAL, NEUTRAL
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InCamera, InWorld
from gmrdata.values.transforms import rotvecs_from_rotmats

CAMERA_KEYS, WORLD_KEYS = ("pose", "trans"), ("pose_world", "trans_world")
API_ROOTS = {"poses_root_cam": "pose", "poses_root_world": "pose_world"}


def read_wham(content: Mapping[Any, Any], path: Path) -> EstimatedPeople:
    people = (_person(Entry(one, person_name(key, path), path)) for key, one in content.items())
    return EstimatedPeople("wham", (path,), tuple(people))


def _person(entry: Entry) -> EstimatedPerson:
    entry = entry if entry.has("pose") or not entry.has("poses_body") else _of_api(entry)
    key = "pose" if entry.has("pose") or not entry.has("pose_world") else "pose_world"
    rotmats = rotmats_of(entry.array(key, None, 3 * N_JOINTS))
    n_rows, in_camera, in_world = len(rotmats), None, None
    numbers, betas = entry.frame_numbers("frame_ids", n_rows), entry.betas("betas", n_rows)
    body = entry.values["body"] if isinstance(entry.values.get("body"), str) else None
    if entry.has(*CAMERA_KEYS):
        transl_m = entry.array("trans", n_rows, 3)
        in_camera = InCamera(rotmats[:, 0], transl_m, "own" if body else "diagonal")
    if entry.has(*WORLD_KEYS):
        in_world = _in_world(entry, n_rows, rotmats[:, 0] if key == "pose" else None)
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=numbers,
        local_rotmats=rotmats[:, 1:],
        in_camera=in_camera,
        in_world=in_world,
        betas=betas,
        betas_body=body or NEUTRAL,
        lacks={
            "camera": entry.lacking(*CAMERA_KEYS, "betas"),
            "world": entry.lacking(*WORLD_KEYS, "betas"),
        },
    )


def _in_world(entry: Entry, n_rows: int, cam_rotmats: np.ndarray | None) -> InWorld:
    roots = rotmats_of(entry.array("pose_world", n_rows, 3 * N_JOINTS)[:, :3])[:, 0]
    transl_m, z_up = entry.array("trans_world", n_rows, 3), turned(Z_UP_FROM_Y_UP, n_rows)
    camera = None if cam_rotmats is None else implied_camera(z_up, roots, cam_rotmats)
    return InWorld(roots, transl_m, z_up, camera)


def _of_api(entry: Entry) -> Entry:
    """What the API returns, with the demo's keys."""
    body = entry.rotations("poses_body", None, N_LOCAL)
    values = {"frame_ids": entry.values.get("frame_id"), **entry.values}
    for root, pose in API_ROOTS.items():
        if entry.has(root):
            roots = entry.orthonormal(root, entry.flat(root, 9 * len(body)).reshape(-1, 1, 3, 3))
            turns = rotvecs_from_rotmats(np.concatenate([roots, body], axis=1))
            values[pose] = turns.reshape(len(body), 3 * N_JOINTS)
    return Entry(values, entry.name, entry.path)
