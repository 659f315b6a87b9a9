"""SLAHMR's `<sequence>_<step>_world_results.npz` (vye16/slahmr, slahmr/optim/optimizers.py).

numpy.savez of B people over T rows, y down, along the first camera's y:

`trans` (B, T, 3)                       SMPL's transl [m]
`root_orient` (B, T, 3)                 axis-angle [rad]
`pose_body` (B, T, 63)                  of the 21 joints after the root; the hands stay straight
`betas` (B, 10 or 16)                   SMPL's neutral shape
`cam_R` (B, T, 3, 3), `cam_t` (B, T, 3) the camera's own cam_from_world

`track_info.json`, in the folder above or beside it, has the people's numbers in the order of the
arrays, which images show each, and which images the T rows are.  They are counted from the first
of a shot (slahmr/data/dataset.py, `get_shot_img_files`), whose number stands in the run's name, and
have the rate to which the run brought the video, which Hydra notes in `.hydra/config.yaml`.
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.safe_pickle import explained
from gmrdata.read.systems.entries import (
    LARGEST_NUMBER,
    N_SMPLX_BODY,
    Z_UP_FROM_Y_DOWN,
    Entry,
    rotmats_of,
    smplx_local,
    turned,
)
from gmrdata.values import plain_yaml
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import parse_json
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InWorld
from gmrdata.values.transforms import invert, rigid

SLAHMR_FILE = re.compile(r".*_(\d{6})_world_results\.npz")
RUN = r"-(?:all|longest-[0-9]+|[0-9]+(?:-[0-9]+)*)-shot-([0-9]+)(?:-.*)?"
"""Of a run's name, after the sequence: its tracks, its shot, and the images in that."""
TRACK_INFO = "track_info.json"
CONFIG = ".hydra/config.yaml"
FRAME_RATE_HZ = 30.0  # of video_to_frames in slahmr/preproc, where the config says none
KEYS = frozenset({"root_orient", "pose_body", "trans"})


def files_beside(path: Path) -> dict[str, Path]:
    """What a result is read with, by role: `tracks`, and `config` if it is there; empty without."""
    infos = (path.with_name(TRACK_INFO), path.parent.parent / TRACK_INFO)
    info = next((one for one in infos if one.is_file()), None)
    files = {} if info is None else {"tracks": info, "config": info.parent / CONFIG}
    return {role: file for role, file in files.items() if file.is_file()}


def read_slahmr(arrays: dict[str, Any], path: Path) -> EstimatedPeople:
    beside = files_beside(path)
    if not beside:
        remedy = f"Keep SLAHMR's {TRACK_INFO} beside the file or in the folder above"
        raise MissingInput(
            f"{path}: no {TRACK_INFO}, so its frames and people can't be told. {remedy}"
        )
    run = beside["tracks"].parent.resolve().name
    shot = re.fullmatch(f".+{RUN}", run)
    if shot and int(shot[1]):
        what = f"{run} is of a later shot, and its frames count from that shot's first"
        remedy = "Cut the video before the shot, or name the folder shot-0 and say --first-image"
        raise BadMotionFile(f"{path}: {what}. {remedy}")
    tracks, first, n_rows = _track_info(beside["tracks"])
    entry, sizes = Entry(arrays, "the result", path), (len(tracks), n_rows)
    values = {key: entry.array(key, *sizes, 3) for key in ("trans", "root_orient")}
    values["pose_body"] = entry.array("pose_body", *sizes, 3 * N_SMPLX_BODY)
    values["betas"] = entry.array("betas", len(tracks), None)
    if entry.has("cam_R", "cam_t"):
        values["cam_R"] = entry.array("cam_R", *sizes, 3, 3)
        values["cam_t"] = entry.array("cam_t", *sizes, 3)
    people = [
        _person(Entry({key: one[index] for key, one in values.items()}, name, path), seen, first)
        for index, (name, seen) in enumerate(tracks.items())
    ]
    fps_hz = _rate_hz(beside["config"]) if "config" in beside else None
    return EstimatedPeople("slahmr", (path, *beside.values()), tuple(people), fps_hz=fps_hz)


def _rate_hz(path: Path) -> float | None:
    """Of the images that a run took from a video [Hz]; None where it was given images."""
    with explained(path, "SLAHMR's config", BadMotionFile):
        data = plain_yaml.parse(path.read_text(encoding="utf-8"))[0]["data"]
        if data["type"] != "video":
            return None
        rate_hz = float(data["frame_opts"].get("fps", FRAME_RATE_HZ))
        if not 0.0 < rate_hz < math.inf:
            raise ValueError(f"fps is {rate_hz:g}")
        return rate_hz


def _track_info(path: Path) -> tuple[dict[str, np.ndarray], tuple[int, int], int]:
    """The people in the order of the arrays, with (N,) bool which images of the interval show each;
    where that and the rows in it begin; and the number of rows."""
    with explained(path, f"SLAHMR's {TRACK_INFO}", BadMotionFile):
        content = parse_json(path.read_text(encoding="utf-8"))
        meta = content["meta"]
        start, (row_start, row_stop) = int(meta["data_interval"][0]), map(int, meta["seq_interval"])
        tracks = sorted(content["tracks"].items(), key=lambda item: int(item[1]["index"]))
        if [int(info["index"]) for _, info in tracks] != list(range(len(tracks))):
            raise ValueError("the tracks' indices are not 0, 1, 2, ...")
        if not 0 <= start < LARGEST_NUMBER or not 0 <= row_start < row_stop:
            raise ValueError("its intervals hold no frames")
        seen = {
            f"person_{int(key)}": np.asarray(info["vis_mask"], dtype=bool).ravel()
            for key, info in tracks
        }
        if any(len(mask) < row_stop for mask in seen.values()):
            raise ValueError("a vis_mask is shorter than its interval")
        return seen, (start, row_start), row_stop - row_start


def _person(entry: Entry, mask: np.ndarray, first: tuple[int, int]) -> EstimatedPerson:
    values, (start, row_start) = entry.values, first
    seen = np.flatnonzero(mask[row_start : row_start + len(values["trans"])])
    if not seen.size:
        raise entry.fault(f"{entry.name} is seen in no frame")
    # Before the first and after the last image that shows the person the rows are padding.
    rows = np.arange(seen[0], seen[-1] + 1)
    z_up, camera = turned(Z_UP_FROM_Y_DOWN, len(rows)), None
    if "cam_R" in values:
        turns = entry.orthonormal("cam_R", values["cam_R"][rows])
        camera = z_up @ invert(rigid(turns, values["cam_t"][rows]))
    roots = rotmats_of(values["root_orient"][rows])[:, 0]
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=start + row_start + rows,
        local_rotmats=smplx_local(values["pose_body"][rows]),
        in_world=InWorld(roots, values["trans"][rows], z_up, camera, camera is not None),
        betas=np.tile(values["betas"], (len(rows), 1)),
        lacks={"camera": "a motion in the world alone"},
    )
