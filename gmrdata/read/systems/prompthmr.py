"""PromptHMR's `results.pkl` of a video (yufu-wang/PromptHMR, pipeline/pipeline.py; joblib).

A dict, of which these are read: `people`, from the tracker's number to a dict of

`frames` (T,)       the video's frames from 0
`smplx_cam`         SMPL-X before the camera: `pose` (T, 75), axis-angle of its joints, the root
                    first [rad], and `trans` (T, 3) [m]
`smplx_world`       the same in the world, y up: `pose` (T, 165), `trans` (T, 3)

and `camera_world`, with `img_focal` and `img_center` (2,) [px] of pictures that may be smaller than
the video's, and of each frame cam_from_world: `Rcw` (N, 3, 3), `Tcw` (N, 3) [m].  Its `Twc` is
another place: pipeline/postprocessing.py turns it the wrong way.

Of a video of more than 60 Hz it takes the last of each n frames, n the rate over 60, rounded
(pipeline/utils.py, `video2frames`); `frames` then count those.  Of a folder of images it takes all.

As of GVHMR's, SMPL's two hand joints stay straight, and `shape`, SMPL-X's, is not used.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import (
    SMPLX_REST_PELVIS_M,
    Z_UP_FROM_Y_UP,
    Entry,
    person_name,
    rotmats_of,
    smplx_local,
    turned,
)
from gmrdata.read.systems.tram import LENS_KEYS, PATH_KEYS, lens_by_row, path_by_row
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InCamera, InWorld

KEYS = frozenset({"people", "camera_world"})
N_JOINTS = {"smplx_cam": 25, "smplx_world": 55}
MOST_HZ = 60.0  # of a video of which it takes all frames
N_BODY = 22  # the root and those that SMPL has too


def read_prompthmr(content: Mapping[Any, Any], path: Path) -> EstimatedPeople:
    camera = Entry(content["camera_world"], "camera_world", path)
    n_frames = None
    if camera.has("Rcw", "Tcw"):
        turns = np.swapaxes(camera.rotations("Rcw", None), 1, 2)
        n_frames = len(turns)
        centres_m = -np.einsum("tij,tj->ti", turns, camera.array("Tcw", n_frames, 3))
        made = dict(zip(PATH_KEYS, (turns, centres_m), strict=True))
        camera = Entry(camera.values | made, camera.name, path)
    entries = content["people"] if isinstance(content["people"], Mapping) else {}
    people = (
        _person(Entry(one, person_name(key, path), path), camera) for key, one in entries.items()
    )
    return EstimatedPeople("prompt-hmr", (path,), tuple(people), n_frames)


def taken_every(fps_hz: float) -> int:
    """Of how many frames of a video it takes one, the last."""
    return max(1, round(fps_hz / MOST_HZ))


def _person(entry: Entry, camera: Entry) -> EstimatedPerson:
    n_rows, in_camera, in_world = entry.flat("frames", None).size, None, None
    numbers = entry.frame_numbers("frames", n_rows)
    poses, transl_m = {}, {}
    for key, n_joints in N_JOINTS.items():
        if entry.has(key):
            part = Entry(entry.values[key], f"{key} of {entry.name}", entry.path)
            poses[key] = part.array("pose", n_rows, 3 * n_joints)[:, : 3 * N_BODY]
            transl_m[key] = part.array("trans", n_rows, 3)
    if not poses:
        raise entry.fault(f"{entry.name} has {entry.lacking(*N_JOINTS)}")
    if "smplx_cam" in poses and camera.has(*LENS_KEYS):
        root = rotmats_of(poses["smplx_cam"][:, :3])[:, 0]
        in_camera = InCamera(root, transl_m["smplx_cam"], *lens_by_row(camera, n_rows))
    if "smplx_world" in poses:
        path = path_by_row(camera, entry, numbers) if camera.has(*PATH_KEYS) else None
        root, z_up = rotmats_of(poses["smplx_world"][:, :3])[:, 0], turned(Z_UP_FROM_Y_UP, n_rows)
        in_world = InWorld(root, transl_m["smplx_world"], z_up, path, path is not None)
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=numbers,
        local_rotmats=smplx_local(next(iter(poses.values()))[:, 3:]),
        in_camera=in_camera,
        in_world=in_world,
        rest_pelvis_m=SMPLX_REST_PELVIS_M,
        lacks={
            "camera": entry.lacking("smplx_cam") or camera.lacking(*LENS_KEYS),
            "world": entry.lacking("smplx_world"),
        },
    )
