"""TRAM's folder of a video, or its `.npz` of a sequence of EMDB (yufu-wang/tram; numpy.save).

By scripts/estimate_camera.py and estimate_humans.py, dicts in `hps/hps_track_<k>.npy`:

`pred_rotmat` (T, 24, 3, 3)   SMPL's joints, the root first, in the camera's frame
`pred_trans` (T, 1, 3)        SMPL's transl before a camera of `img_focal` and `img_center` [m]
                              (lib/models/hmr_vimo.py, `get_trans`)
`pred_shape` (T, 10)          SMPL's neutral shape; in the world one counts, the mean over time, as
                              scripts/emdb/run_eval.py takes it
`frame` (T,)                  the video's frames from 0; without it each row is one

and in `camera.npy`:

`world_cam_R` (N, 3, 3), `world_cam_T` (N, 3)   of each frame, to a world with y up [m]
`img_focal`, `img_center` (2,)                  [px]

For EMDB (scripts/emdb) they are `smpl/<sequence>.npz` and `camera/<sequence>.npz`, in all frames;
the first may hold all of it.  Both have EMDB's lens, and people stand before the first's.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.safe_pickle import load_object_npy
from gmrdata.read.systems.entries import KNOWN, Z_UP_FROM_Y_UP, Entry
from gmrdata.values.body import N_JOINTS
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InCamera, InWorld, Pinhole
from gmrdata.values.transforms import rigid

CAMERA_FILE = "camera.npy"
HPS_FOLDER = "hps"
_TRACK = re.compile(r"hps_track_(\d{1,9})\.npy")
LENS_KEYS, PATH_KEYS = ("img_focal", "img_center"), ("world_cam_R", "world_cam_T")


def is_tram_folder(folder: Path) -> bool:
    return (folder / CAMERA_FILE).is_file() and (folder / HPS_FOLDER).is_dir()


def read_tram_folder(folder: Path) -> EstimatedPeople:
    tracks: dict[int, Path] = {}
    for path in sorted((folder / HPS_FOLDER).glob("hps_track_*.npy")):
        match = _TRACK.fullmatch(path.name)
        if match and (other := tracks.setdefault(int(match[1]), path)) != path:
            what = f"{other.name} and {path.name} are of one number. Keep one of them"
            raise BadMotionFile(f"{path.parent}: {what}")
    if not (folder / CAMERA_FILE).is_file() or not tracks:
        what = f"no {CAMERA_FILE} and {HPS_FOLDER}/hps_track_<k>.npy, as TRAM writes them"
        raise MissingInput(f"{folder}: {what}, and no other system's own file. {KNOWN}")
    camera_path, files = folder / CAMERA_FILE, [tracks[number] for number in sorted(tracks)]
    camera = Entry(load_object_npy(camera_path), "the camera", camera_path)
    people = [
        _person(Entry(load_object_npy(path), f"person_{number}", path), camera)
        for number, path in sorted(tracks.items())
    ]
    n_frames = len(camera.array("world_cam_R", None, 3, 3)) if camera.has("world_cam_R") else None
    return EstimatedPeople("tram", (camera_path, *files), tuple(people), n_frames)


def read_tram_npz(arrays: dict[str, Any], path: Path) -> EstimatedPeople:
    camera_path = path.parent.parent / "camera" / path.name
    files: tuple[Path, ...] = (path,)
    if camera_path.is_file():
        arrays, files = read_npz(camera_path, plain_alone=True) | arrays, (path, camera_path)
    camera = Entry(arrays, "the camera", files[-1])
    return EstimatedPeople("tram", files, (_person(Entry(arrays, "person_0", path), camera),))


def _person(entry: Entry, camera: Entry) -> EstimatedPerson:
    rotmats = entry.rotations("pred_rotmat", None, N_JOINTS)
    n_rows, in_camera, in_world = len(rotmats), None, None
    numbers = entry.frame_numbers("frame", n_rows) if entry.has("frame") else np.arange(n_rows)
    flat = getattr(entry.values.get("pred_trans"), "ndim", None) == 2
    transl_m = entry.array("pred_trans", *((n_rows, 3) if flat else (n_rows, 1, 3)))
    transl_m = transl_m.reshape(n_rows, 3)
    if camera.has(*LENS_KEYS):
        in_camera = InCamera(rotmats[:, 0], transl_m, *lens_by_row(camera, n_rows))
    if camera.has(*PATH_KEYS):
        z_up_from_cam = path_by_row(camera, entry, numbers)
        in_world = InWorld(
            rotmats[:, 0], transl_m, z_up_from_cam, z_up_from_cam, True, of_mean_shape=True
        )
    no_betas = entry.lacking("pred_shape")
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=numbers,
        local_rotmats=rotmats[:, 1:],
        in_camera=in_camera,
        in_world=in_world,
        betas=entry.betas("pred_shape", n_rows),
        lacks={
            "camera": no_betas or camera.lacking(*LENS_KEYS),
            "world": no_betas or camera.lacking(*PATH_KEYS),
        },
    )


def lens_by_row(camera: Entry, n_rows: int) -> tuple[Pinhole, tuple[float, float] | None]:
    """The camera by row, and the size of the pictures by its principal point."""
    focal_px, centre_px = camera.flat("img_focal", 1), camera.flat("img_center", 2)
    camera.positive("img_focal", focal_px)
    width_px, height_px = (2.0 * centre_px).tolist()
    pinhole = Pinhole(np.full(n_rows, focal_px[0]), np.tile(centre_px, (n_rows, 1)))
    is_emdbs = camera.path.suffix == ".npz"  # calibrated, so its centre is not the middle
    return pinhole, None if is_emdbs else (width_px, height_px)


def path_by_row(camera: Entry, entry: Entry, numbers: np.ndarray) -> np.ndarray:
    """(T, 4, 4) z_up_from_cam of a person's rows."""
    turns = camera.rotations("world_cam_R", None)
    centres_m = camera.array("world_cam_T", len(turns), 3)
    if numbers[0] < 0 or numbers[-1] >= len(turns):
        what = f"frames to {numbers[-1]}, but {camera.path.name} has {len(turns)} cameras"
        raise BadMotionFile(f"{entry.path}: {what}. Give the camera of the same video")
    return rigid(Z_UP_FROM_Y_UP @ turns, centres_m @ Z_UP_FROM_Y_UP.T)[numbers]
