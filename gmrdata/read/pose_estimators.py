"""People in the outputs of video pose estimators: VIBE, WHAM, PHALP (4D-Humans) and GVHMR.

VIBE's `vibe_output.pkl` and WHAM's `wham_output.pkl` are written by joblib.dump: a dict from the
tracker's person number to a dict of arrays over the T frames in which the person was tracked
(VIBE: demo.py of mkocabas/VIBE and the table in its doc/demo.md; WHAM: demo.py of yohanshin/WHAM,
with `--save_pkl`).  Read are `pose` (T, 72), axis-angle of SMPL's 24 joints with the root (in the
camera's frame) first [rad]; `frame_ids` (T,), the video's frames from 0, with gaps; and `betas`
(T, 10), SMPL's neutral shape.  WHAM's `pose_world` differs from `pose` in the root alone.

PHALP's `outputs/results/demo_<video>.pkl`, which 4D-Humans' track.py writes with its own pose
estimator in it, is written by joblib.dump with zlib: a dict from the frame's name to a dict of the
frame (phalp/trackers/PHALP.py of brjathu/PHALP; the table in 4D-Humans' README) with one entry per
track in its lists: `time`, the frame's number from 0; `shot`, 1 where a new shot begins; `tid`,
each track's number; `tracked_time`, frames since it was last seen; and `smpl`, each track's
`body_pose` (23, 3, 3), `global_orient` (1, 3, 3) and `betas` (10,).  A track that is not seen stays
in the lists for a while with its last pose.  Such entries (`tracked_time` above 0) are no poses of
their frame and are left out; and no motion is bridged over the beginning of a shot, although tracks
go on there.  Older versions also stored `embedding` as torch's tensors, which is refused.

GVHMR's `hmr4d_results.pt` is written by torch.save (tools/demo/demo.py and
hmr4d/model/gvhmr/gvhmr_pl_demo.py of zju3dv/GVHMR): `smpl_params_global` and `smpl_params_incam`,
each with `body_pose` (T, 63) axis-angle of SMPL-X's 21 body joints [rad], which are SMPL's first;
SMPL's two hand joints stay straight.  The two have the same `body_pose`.  The betas are SMPL-X's,
which mean something else on SMPL, and are not used.  One file is one person, in every frame.
"""

from collections import defaultdict
from collections.abc import Mapping
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read import tracked_people
from gmrdata.read.numbers import finite_numbers
from gmrdata.read.safe_pickle import load_plain
from gmrdata.read.torch_files import load_tensors
from gmrdata.read.tracked_people import PersonPoses
from gmrdata.values.body import N_JOINTS, N_LOCAL
from gmrdata.values.errors import BadMotionFile

ZIP = b"PK\3\4"  # how a file of torch.save begins, as each zip does
VIBE_KEYS = frozenset({"pose", "frame_ids"})
PHALP_KEYS = frozenset({"time", "tid", "smpl"})
"""What an entry of these files has, which tells them from others."""
GVHMR_KEYS = ("smpl_params_global", "smpl_params_incam")
N_SMPLX_BODY = 21


def read_people(path: Path) -> list[PersonPoses]:
    """The people of an estimator's file, which is known by what it holds; nothing of it is run."""
    with path.open("rb") as stream:
        if stream.read(len(ZIP)) == ZIP:
            return _gvhmr(path)
    content = load_plain(path)
    if isinstance(content, dict) and not content:
        return []
    first = next(iter(content.values())) if isinstance(content, dict) else None
    keys: set[Any] = set(first) if isinstance(first, dict) else set()
    if keys >= PHALP_KEYS:
        return _phalp(content, path)
    if keys & VIBE_KEYS:
        return [_vibe_or_wham_person(key, values, path) for key, values in content.items()]
    found = ", ".join(sorted(key[:40] for key in keys if isinstance(key, str))[:12])
    what = f"holds no poses in a known form (first entry has: {found or 'no dict'})"
    known = "Known are VIBE's, WHAM's, PHALP's and GVHMR's outputs, .npz, .bvh and .amc"
    raise BadMotionFile(f"{path}: {what}. {known}")


def _require(values: Any, keys: frozenset[str], name: str, path: Path) -> None:
    missing = sorted(keys - values.keys()) if isinstance(values, Mapping) else sorted(keys)
    if missing:
        raise BadMotionFile(f"{path}: {name} has no {missing[0]!r}; make the file again")


def _vibe_or_wham_person(key: Any, values: Any, path: Path) -> PersonPoses:
    name = tracked_people.person_name(key, path)
    _require(values, VIBE_KEYS, name, path)
    poses = finite_numbers(values["pose"], f"pose of {name}", path)
    rotmats = tracked_people.rotmats_of_rotvecs(poses, N_JOINTS, f"pose of {name}", path)
    ids = f"frame_ids of {name}"
    numbers = tracked_people.frame_numbers(values["frame_ids"], len(poses), ids, path)
    betas = tracked_people.mean_betas(values.get("betas"), f"betas of {name}", path)
    return PersonPoses(name, rotmats, numbers, betas)


def _phalp(content: Mapping[Any, Any], path: Path) -> list[PersonPoses]:
    tracks: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    cuts = set()
    for name, frame in content.items():
        time = _check_frame(frame, tracked_people.shown(name), path)
        if tracked_people.whole_number(frame.get("shot")):
            cuts.add(time)
        unseen = frame.get("tracked_time") or [0] * len(frame["tid"])
        for track, waited, smpl in zip(frame["tid"], unseen, frame["smpl"], strict=False):
            if tracked_people.whole_number(waited) == 0:
                tracks[tracked_people.person_name(track, path)].append((time, smpl))
    return [_phalp_person(*track, frozenset(cuts), path) for track in tracks.items()]


def _check_frame(frame: Any, name: str, path: Path) -> int:
    """The number of a frame whose lists are of one length."""
    _require(frame, PHALP_KEYS, f"frame {name}", path)
    lists = [frame["tid"], frame["smpl"]]
    lists += [] if frame.get("tracked_time") is None else [frame["tracked_time"]]
    whole = all(isinstance(one, list) for one in lists)
    if not whole or any(len(one) != len(lists[0]) for one in lists):
        what = f"the lists of frame {name} are of different lengths"
        raise BadMotionFile(f"{path}: {what}; make the file again")
    time = tracked_people.whole_number(frame["time"])
    if time is None:
        raise BadMotionFile(f"{path}: the time of frame {name} is no number; make it again")
    return time


def _phalp_person(
    name: str, entries: list[tuple[int, Any]], cuts: frozenset[int], path: Path
) -> PersonPoses:
    entries = sorted(entries, key=itemgetter(0))
    poses = [_phalp_pose(smpl, f"body_pose of {name} in frame {n}", path) for n, smpl in entries]
    times = [time for time, _ in entries]
    betas = [smpl["betas"] for _, smpl in entries if "betas" in smpl]
    what = f"betas of {name}"
    known = finite_numbers(betas, what, path).reshape(len(betas), -1) if betas else None
    rotmats = tracked_people.orthonormal(np.stack(poses), f"body_pose of {name}", path)
    numbers = tracked_people.frame_numbers(times, len(poses), f"times of {name}", path)
    return PersonPoses(name, rotmats, numbers, tracked_people.mean_betas(known, what, path), cuts)


def _phalp_pose(smpl: Any, what: str, path: Path) -> np.ndarray:
    found = smpl.get("body_pose") if isinstance(smpl, Mapping) else None
    pose = finite_numbers(found, what, path)
    if pose.shape != (N_LOCAL, 3, 3):
        what = f"{what} is {pose.shape}, not ({N_LOCAL}, 3, 3)"
        raise BadMotionFile(f"{path}: {what}. Give PHALP's own output")
    return pose


def _gvhmr(path: Path) -> list[PersonPoses]:
    content = load_tensors(path)
    found = next((content[key] for key in GVHMR_KEYS if key in content), None)
    if not isinstance(found, Mapping) or "body_pose" not in found:
        has = ", ".join(map(str, content))[:200]
        what = f"has no body_pose in {' or '.join(GVHMR_KEYS)} (it has {has})"
        raise BadMotionFile(f"{path}: {what}. Give GVHMR's hmr4d_results.pt")
    poses = finite_numbers(found["body_pose"], "body_pose", path)
    local_rotmats = tracked_people.rotmats_of_rotvecs(poses, N_SMPLX_BODY, "body_pose", path)
    return [PersonPoses("person", local_rotmats, np.arange(len(poses)), None)]
