"""People in the world, as other systems write them: WHAM, GVHMR, TRAM, SLAHMR; and VIBE's people.

What each file holds, by the code that writes it:

WHAM      `wham_output.pkl` (demo.py with --save_pkl; joblib): a dict from the track's number to
          `pose_world` (T, 72) axis-angle, `trans_world` (T, 3), `betas` (T, 10), `frame_ids` (T,).
          y is up.  `trans_world` is SMPL's transl, as lib/eval/evaluate_emdb.py takes it.
GVHMR     `hmr4d_results.pt` (tools/demo/demo.py; torch.save): `smpl_params_global` with
          `global_orient` (T, 3), `body_pose` (T, 63), `transl` (T, 3), of SMPL-X.  y is up.  One
          person, in every frame.  The betas are SMPL-X's, which mean something else on SMPL.
          `smpl_params_incam` tells where the camera looks.
TRAM      `camera.npy` and `hps/hps_track_<k>.npy` in a folder (scripts/estimate_camera.py and
          estimate_humans.py; numpy.save of dicts): `pred_rotmat` (T, 24, 3, 3), `pred_trans`
          (T, 1, 3) and `pred_shape` (T, 10) in the camera's frame, `frame` (T,), and of the camera
          `world_cam_R` (N, 3, 3), `world_cam_T` (N, 3), which map it to a world with y up.  For
          EMDB: `smpl/<sequence>.npz` and `camera/<sequence>.npz` (scripts/emdb), in all frames.
          One shape counts, the mean over time, as scripts/emdb/run_eval.py takes it.
SLAHMR    `<sequence>_<step>_world_results.npz` (slahmr/optim/optimizers.py; numpy.savez): `trans`
          (B, T, 3), `root_orient` (B, T, 3), `pose_body` (B, T, 63), `betas` (B, 10 or 16) of B
          people; and `track_info.json` in the folder above: their numbers, which images each is
          seen in, and which images the T rows are; `cam_R` (B, T, 3, 3), `cam_t` (B, T, 3), the
          camera's own cam_from_world.  y is down, along the first camera's y.
VIBE      `vibe_output.pkl` (demo.py; joblib): `pose` (T, 72) and `betas` (T, 10) in the camera's
          frame, `frame_ids` (T,), and `orig_cam` (T, 4) = sx, sy, tx, ty, a weak-perspective
          camera, made from `pred_cam` (T, 3) = s, tx, ty of a crop as if that were as large as
          its `bboxes`.  The network saw one 1.1 times as large (demo.py, `bbox_scale`): VIBE draws
          people 1.1 times too small (its issue 182).  Here their camera is widened.
AMASS     any `.npz` with AMASS's keys: `poses` (T, 72, 156 or 165), `trans` (T, 3), `betas`,
          `gender`, `mocap_framerate` (or `mocap_frame_rate`).  z is up.

Frames are counted from 0, in the order of the video or of the folder's images.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read import tracked_people
from gmrdata.read.numbers import finite_numbers
from gmrdata.read.pose_estimators import GVHMR_KEYS, N_SMPLX_BODY, ZIP
from gmrdata.read.safe_pickle import load_object_npy, load_plain
from gmrdata.read.torch_files import load_tensors
from gmrdata.values.body import HANDS, N_JOINTS
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import parse_json, read_npz
from gmrdata.values.transforms import invert, rigid

System = Literal["wham", "gvhmr", "tram", "slahmr", "vibe", "amass"]

Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
Z_UP_FROM_Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Also the world of a camera that is held level, in which it looks along +y."""
SMPLX_REST_PELVIS_M = np.array([0.0031, -0.3514, 0.0120])
"""J0 of SMPL-X's neutral body in its mean shape, rest frame [m]."""
SLAHMR_FILE = re.compile(r".*_(\d{6})_world_results\.npz")
TRACK_INFO = "track_info.json"
VIBE_CROP_OVER_BOX = 1.1
_AGAIN = "Give the system's own file, or make it again"


@dataclass(frozen=True, eq=False)
class ResultPerson:
    """One person of a result, over T rows, in the file's own axes."""

    name: str  # as the file counts people: "person_<number>"
    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video each row is, from 0
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    root_rotmats: np.ndarray  # (T, 3, 3) file_from_root
    transl_m: np.ndarray | None
    """(T, 3) SMPL's transl, so that pelvis = transl + J0 [m]; None with a weak camera."""
    betas: np.ndarray | None  # (T, S) shape coefficients of SMPL; None where they are of another
    z_up_from_file: np.ndarray | None
    """(T, 4, 4) to a world with z up [m]; None where the file's frame is the camera's."""
    weak_cameras: np.ndarray | None = None
    """(T, 4) scale and shift in x and y: image = scale * (place + shift), from -1 to 1."""
    betas_body: str = "smpl-neutral"  # the BodyModel that `betas` are of
    z_up_from_cam: np.ndarray | None = None
    """(T, 4, 4) the result's own camera; its place counts with `has_camera_path` alone [m]."""
    has_camera_path: bool = False
    rest_pelvis_m: np.ndarray | None = None
    """(3,) J0 of the file's own body, rest frame [m]; None where `betas` tell it."""
    has_own_rate: bool = False  # whether rows are of the file's own frame rate, not of a video


@dataclass(frozen=True, eq=False)
class WorldResult:
    """The people of one result, and the files that it was read from."""

    system: System
    files: tuple[Path, ...]
    people: tuple[ResultPerson, ...]
    fps_hz: float | None = None  # the file's own frame rate [Hz]; None where it has none


def read_world_result(path: Path) -> WorldResult:
    """Read a file of WHAM, GVHMR, SLAHMR or VIBE, or a folder of TRAM; nothing of it is run.

    Files are known by what they hold.  BadMotionFile, MissingInput, BrokenPickle and UnsafePickle
    name the file and the remedy.
    """
    if path.is_dir():
        return _tram_folder(path)
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    if path.suffix == ".npz":
        return _npz(path)
    with path.open("rb") as stream:
        if stream.read(len(ZIP)) == ZIP:
            return WorldResult("gvhmr", (path,), (_gvhmr_person(path),))
    return _pickled(path)


def _pickled(path: Path) -> WorldResult:
    content = load_plain(path)
    if not isinstance(content, dict) or not content:
        what = "holds no people" if isinstance(content, dict) else "holds no dict"
        raise BadMotionFile(f"{path}: {what}. {_AGAIN}")
    first = next(iter(content.values()))
    keys = set(first) if isinstance(first, dict) else set()
    if keys & {"pose_world", "trans_world"}:
        people = (_wham_person(key, values, path) for key, values in content.items())
        return WorldResult("wham", (path,), tuple(people))
    if "orig_cam" in keys:
        people = (_vibe_person(key, values, path) for key, values in content.items())
        return WorldResult("vibe", (path,), tuple(people))
    found = ", ".join(sorted(key[:40] for key in keys if isinstance(key, str))[:12])
    raise BadMotionFile(
        f"{path}: neither WHAM's result (pose_world, trans_world) nor VIBE's (pose, orig_cam); its "
        f"first entry has {found or 'no dict'}. {_AGAIN}"
    )


def person_array(
    values: Any, key: str, shape: Sequence[int | None], name: str, path: Path
) -> np.ndarray:
    """One finite array of a person; None in the shape stands for any size."""
    if not isinstance(values, Mapping) or key not in values:
        raise BadMotionFile(f"{path}: {name} has no {key!r}. {_AGAIN}")
    found = finite_numbers(values[key], f"{key} of {name}", path)
    pairs = zip(shape, found.shape, strict=False)
    if found.ndim != len(shape) or any(n is not None and n != size for n, size in pairs):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise BadMotionFile(f"{path}: {key} of {name} is {found.shape}, not ({wanted}). {_AGAIN}")
    if not len(found):
        raise BadMotionFile(f"{path}: {name} has no frames. {_AGAIN}")
    return found


def _rotmats(rotvecs: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(rotvecs).as_matrix())


def _turned(rotmat: np.ndarray, n_rows: int) -> np.ndarray:
    return np.tile(rigid(rotmat, np.zeros(3)), (n_rows, 1, 1))


def _tracked(
    key: Any, values: Any, pose_key: str, path: Path
) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Name, pose (T, 72) [rad], frames (T,) and betas (T, 10) of a person of WHAM or VIBE."""
    name = tracked_people.person_name(key, path)
    pose = person_array(values, pose_key, (None, 3 * N_JOINTS), name, path)
    betas = person_array(values, "betas", (len(pose), None), name, path)
    if "frame_ids" not in values:
        raise BadMotionFile(f"{path}: {name} has no 'frame_ids'. {_AGAIN}")
    ids = f"frame_ids of {name}"
    numbers = tracked_people.frame_numbers(values["frame_ids"], len(pose), ids, path)
    return name, pose, numbers, betas


def _implied_camera(
    z_up_from_file: np.ndarray, world_rotmats: np.ndarray, cam_rotmats: np.ndarray
) -> np.ndarray:
    """(T, 4, 4) z_up_from_cam by one root's orientations in the world and the camera; no place."""
    rotmats = z_up_from_file[:, :3, :3] @ world_rotmats @ np.swapaxes(cam_rotmats, 1, 2)
    return rigid(rotmats, np.zeros(3))


def _wham_person(key: Any, values: Any, path: Path) -> ResultPerson:
    name, pose, numbers, betas = _tracked(key, values, "pose_world", path)
    root_rotmats, z_up = _rotmats(pose[:, :3]), _turned(Z_UP_FROM_Y_UP, len(pose))
    camera = None
    if "pose" in values:
        seen = person_array(values, "pose", (len(pose), 3 * N_JOINTS), name, path)
        camera = _implied_camera(z_up, root_rotmats, _rotmats(seen[:, :3]))
    body = values.get("body", "smpl-neutral")  # a key that gmrdata's own export has besides
    return ResultPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=tracked_people.rotmats_of_rotvecs(pose, N_JOINTS, "pose_world", path),
        root_rotmats=root_rotmats,
        transl_m=person_array(values, "trans_world", (len(pose), 3), name, path),
        betas=betas,
        z_up_from_file=z_up,
        z_up_from_cam=camera,
        betas_body=body if isinstance(body, str) else "smpl-neutral",
    )


def _vibe_person(key: Any, values: Any, path: Path) -> ResultPerson:
    name, pose, numbers, betas = _tracked(key, values, "pose", path)
    weak_cameras = person_array(values, "orig_cam", (len(pose), 4), name, path)
    if not (weak_cameras[:, :2] > 0).all():
        at = int(np.argmin(weak_cameras[:, :2].min(axis=1)))
        raise BadMotionFile(f"{path}: orig_cam of {name} has no scale at row {at}. {_AGAIN}")
    shifts_m = np.zeros((len(pose), 2))  # within the crop, by which its middle is not shifted
    if "pred_cam" in values:
        shifts_m = person_array(values, "pred_cam", (len(pose), 3), name, path)[:, 1:]
    scales = VIBE_CROP_OVER_BOX * weak_cameras[:, :2]
    middles_m = (weak_cameras[:, 2:] - shifts_m) / VIBE_CROP_OVER_BOX
    return ResultPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=tracked_people.rotmats_of_rotvecs(pose, N_JOINTS, "pose", path),
        root_rotmats=_rotmats(pose[:, :3]),
        transl_m=None,
        betas=betas,
        z_up_from_file=None,
        weak_cameras=np.concatenate([scales, middles_m + shifts_m], axis=1),
    )


def _gvhmr_person(path: Path) -> ResultPerson:
    content = load_tensors(path)
    if not isinstance(content.get(GVHMR_KEYS[0]), Mapping):
        has = ", ".join(map(str, content))[:200]
        raise BadMotionFile(f"{path}: no {GVHMR_KEYS[0]} (it has {has}). {_AGAIN}")
    values, seen = (content.get(name) for name in GVHMR_KEYS)
    if not isinstance(seen, Mapping | None):
        raise BadMotionFile(f"{path}: {GVHMR_KEYS[1]} is no dict. {_AGAIN}")
    rows = _usable_rows(content, path)
    poses = person_array(values, "body_pose", (None, 3 * N_SMPLX_BODY), "the person", path)
    n_frames = len(poses)
    rows = np.arange(n_frames) if rows is None else rows
    orient = person_array(values, "global_orient", (n_frames, 3), "the person", path)
    transl_m = person_array(values, "transl", (n_frames, 3), "the person", path)
    if not rows.size or rows[-1] >= n_frames:
        raise BadMotionFile(f"{path}: `valid` names no frames of its {n_frames}. {_AGAIN}")
    root_rotmats, z_up, camera = _rotmats(orient[rows]), _turned(Z_UP_FROM_Y_UP, len(rows)), None
    if seen:
        what = f"global_orient in {GVHMR_KEYS[1]}"
        shown = {"global_orient": finite_numbers(seen.get("global_orient"), what, path)}
        if shown["global_orient"].shape == (n_frames, 3):
            shown["global_orient"] = shown["global_orient"][rows]
        found = person_array(shown, "global_orient", (len(rows), 3), "the person in camera", path)
        camera = _implied_camera(z_up, root_rotmats, _rotmats(found))
    return ResultPerson(
        name="person_0",
        frame_numbers=rows,
        local_rotmats=tracked_people.rotmats_of_rotvecs(
            poses[rows], N_SMPLX_BODY, "body_pose", path
        ),
        root_rotmats=root_rotmats,
        transl_m=transl_m[rows],
        betas=None,
        z_up_from_file=z_up,
        z_up_from_cam=camera,
        rest_pelvis_m=SMPLX_REST_PELVIS_M,
    )


def _usable_rows(content: Mapping[str, Any], path: Path) -> np.ndarray | None:
    """Rows that may be used, by a key that gmrdata's own export has besides; None without it."""
    if "valid" not in content:
        return None
    valid = content["valid"]
    if not isinstance(valid, np.ndarray) or valid.dtype != bool or valid.ndim != 1:
        raise BadMotionFile(f"{path}: `valid` is not (T,) bool. {_AGAIN}")
    return np.flatnonzero(valid)


def _npz(path: Path) -> WorldResult:
    arrays = read_npz(path)
    if "pred_rotmat" in arrays:
        camera_path = path.parent.parent / "camera" / path.name
        person = _tram_person("person_0", arrays, read_npz(camera_path), path, camera_path)
        return WorldResult("tram", (path, camera_path), (person,))
    if {"root_orient", "pose_body", "trans"} <= arrays.keys():
        return _slahmr(path, arrays)
    if {"poses", "trans"} <= arrays.keys():
        return _amass(path, arrays)
    has = ", ".join(arrays)[:200]
    raise BadMotionFile(
        f"{path}: no result of SLAHMR (trans, root_orient, pose_body) or TRAM (pred_rotmat), and "
        f"no motion with AMASS's keys (poses, trans); it has {has}. {_AGAIN}"
    )


CAMERA_FILE = "camera.npy"
HPS_FOLDER = "hps"
_TRACK = re.compile(r"hps_track_(\d{1,9})\.npy")


def is_tram_folder(folder: Path) -> bool:
    return (folder / CAMERA_FILE).is_file() and (folder / HPS_FOLDER).is_dir()


def tram_tracks(folder: Path) -> dict[int, Path]:
    """The tracks' files of TRAM's folder by number; MissingInput where it is none."""
    tracks = {
        int(found[1]): path
        for path in (folder / HPS_FOLDER).glob("hps_track_*.npy")
        if (found := _TRACK.fullmatch(path.name))
    }
    if not (folder / CAMERA_FILE).is_file() or not tracks:
        what = f"no {CAMERA_FILE} and {HPS_FOLDER}/hps_track_<k>.npy"
        raise MissingInput(f"{folder}: {what}, as TRAM writes them. {_AGAIN}")
    return tracks


def _tram_folder(folder: Path) -> WorldResult:
    camera_path, tracks = folder / CAMERA_FILE, tram_tracks(folder)
    camera = load_object_npy(camera_path)
    people = [
        _tram_person(f"person_{number}", load_object_npy(path), camera, path, camera_path)
        for number, path in sorted(tracks.items())
    ]
    return WorldResult("tram", (camera_path, *sorted(tracks.values())), tuple(people))


def _tram_person(
    name: str, values: Any, camera: Any, path: Path, camera_path: Path
) -> ResultPerson:
    rotmats = person_array(values, "pred_rotmat", (None, N_JOINTS, 3, 3), name, path)
    rotmats = tracked_people.orthonormal(rotmats, f"pred_rotmat of {name}", path)
    n_rows = len(rotmats)
    betas = person_array(values, "pred_shape", (n_rows, None), name, path).mean(axis=0)
    transl_m = finite_numbers(values.get("pred_trans"), f"pred_trans of {name}", path)
    if transl_m.shape not in ((n_rows, 3), (n_rows, 1, 3)):
        what = f"pred_trans of {name} is {transl_m.shape}, not ({n_rows}, 1, 3)"
        raise BadMotionFile(f"{path}: {what}. {_AGAIN}")
    numbers = np.arange(n_rows)
    if "frame" in values:
        what = f"frame of {name}"
        numbers = tracked_people.frame_numbers(values["frame"], n_rows, what, path)
    turns = person_array(camera, "world_cam_R", (None, 3, 3), "the camera", camera_path)
    turns = tracked_people.orthonormal(turns, "world_cam_R", camera_path)
    centres_m = person_array(camera, "world_cam_T", (len(turns), 3), "the camera", camera_path)
    if numbers[0] < 0 or numbers[-1] >= len(turns):
        what = f"frames to {numbers[-1]}, but {camera_path.name} has {len(turns)} cameras"
        raise BadMotionFile(f"{path}: {what}. Give the camera of the same video")
    z_up_from_cam = rigid(Z_UP_FROM_Y_UP @ turns, centres_m @ Z_UP_FROM_Y_UP.T)
    return ResultPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        transl_m=transl_m.reshape(n_rows, 3),
        betas=np.tile(betas, (n_rows, 1)),
        z_up_from_file=z_up_from_cam[numbers],
        z_up_from_cam=z_up_from_cam[numbers],
        has_camera_path=True,
    )


def _slahmr(path: Path, arrays: Mapping[str, np.ndarray]) -> WorldResult:
    info_path = next(
        (
            one
            for one in (path.with_name(TRACK_INFO), path.parent.parent / TRACK_INFO)
            if one.is_file()
        ),
        None,
    )
    if info_path is None:
        remedy = f"Keep SLAHMR's {TRACK_INFO} beside the file or in the folder above"
        raise MissingInput(
            f"{path}: no {TRACK_INFO}, so its frames and people can't be told. {remedy}"
        )
    tracks, first, n_rows = _track_info(info_path)
    sizes = len(tracks), n_rows
    values = {
        "trans": person_array(arrays, "trans", (*sizes, 3), "the result", path),
        "root_orient": person_array(arrays, "root_orient", (*sizes, 3), "the result", path),
        "pose_body": person_array(
            arrays, "pose_body", (*sizes, 3 * N_SMPLX_BODY), "the result", path
        ),
        "betas": person_array(arrays, "betas", (len(tracks), None), "the result", path),
    }
    if {"cam_R", "cam_t"} <= arrays.keys():
        values["cam_R"] = person_array(arrays, "cam_R", (*sizes, 3, 3), "the camera", path)
        values["cam_t"] = person_array(arrays, "cam_t", (*sizes, 3), "the camera", path)
    people = [
        _slahmr_person({key: one[index] for key, one in values.items()}, track, first, path)
        for index, track in enumerate(tracks)
    ]
    return WorldResult("slahmr", (path, info_path), tuple(people))


_NOT_INFO = (
    ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError,
    OSError,
)  # fmt: skip
"""What a JSON file of another form raises when it is looked through."""


@dataclass(frozen=True)
class _Track:
    name: str
    seen: np.ndarray  # (N,) bool: images of SLAHMR's data interval that show the person


def _track_info(path: Path) -> tuple[list[_Track], tuple[int, int], int]:
    """The people in the order of the arrays; where the images' interval and the rows in it begin;
    and the number of rows."""
    try:
        content = parse_json(path.read_text(encoding="utf-8"))
        meta = content["meta"]
        start, (row_start, row_stop) = int(meta["data_interval"][0]), map(int, meta["seq_interval"])
        found = sorted(content["tracks"].items(), key=lambda item: int(item[1]["index"]))
        if [int(info["index"]) for _, info in found] != list(range(len(found))):
            raise ValueError("the tracks' indices are not 0, 1, 2, ...")
        if not 0 <= start < tracked_people.LARGEST_NUMBER or not 0 <= row_start < row_stop:
            raise ValueError("its intervals hold no frames")
        tracks = [
            _Track(f"person_{int(key)}", np.asarray(info["vis_mask"], dtype=bool).ravel())
            for key, info in found
        ]
        if not all(len(track.seen) >= row_stop for track in tracks):
            raise ValueError("a vis_mask is shorter than its interval")
    except _NOT_INFO as error:
        fault = f"{type(error).__name__}: {str(error)[:200]}"
        raise BadMotionFile(f"{path}: not SLAHMR's {TRACK_INFO} ({fault}). {_AGAIN}") from None
    return tracks, (start, row_start), row_stop - row_start


def _slahmr_person(
    values: Mapping[str, np.ndarray], track: _Track, first: tuple[int, int], path: Path
) -> ResultPerson:
    start, row_start = first
    seen = np.flatnonzero(track.seen[row_start : row_start + len(values["trans"])])
    if not seen.size:
        raise BadMotionFile(f"{path}: {track.name} is seen in no frame. {_AGAIN}")
    # Before the first and after the last image that shows the person the rows are padding.
    rows = np.arange(seen[0], seen[-1] + 1)
    poses, z_up, camera = values["pose_body"][rows], _turned(Z_UP_FROM_Y_DOWN, len(rows)), None
    if "cam_R" in values:
        turns = tracked_people.orthonormal(values["cam_R"][rows], "cam_R", path)
        camera = z_up @ invert(rigid(turns, values["cam_t"][rows]))
    return ResultPerson(
        name=track.name,
        frame_numbers=start + row_start + rows,
        local_rotmats=tracked_people.rotmats_of_rotvecs(poses, N_SMPLX_BODY, "pose_body", path),
        root_rotmats=_rotmats(values["root_orient"][rows]),
        transl_m=values["trans"][rows],
        betas=np.tile(values["betas"], (len(rows), 1)),
        z_up_from_file=z_up,
        z_up_from_cam=camera,
        has_camera_path=camera is not None,
    )


def _amass(path: Path, arrays: Mapping[str, np.ndarray]) -> WorldResult:
    poses = person_array(arrays, "poses", (None, None), "the motion", path)
    if poses.shape[1] not in HANDS:
        what = f"poses are {poses.shape}; known are (T, 72), (T, 156) and (T, 165)"
        raise BadMotionFile(f"{path}: {what}. {_AGAIN}")
    chosen = [*range(22), *HANDS[poses.shape[1]]]
    rotmats = _rotmats(poses.reshape(-1, 3)).reshape(len(poses), -1, 3, 3)[:, chosen]
    is_smplx = poses.shape[1] == 165
    person = ResultPerson(
        name="person_0",
        frame_numbers=np.arange(len(poses)),
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        transl_m=person_array(arrays, "trans", (len(poses), 3), "the motion", path),
        betas=None if is_smplx or "betas" not in arrays else _amass_betas(arrays, len(poses), path),
        z_up_from_file=_turned(np.eye(3), len(poses)),
        betas_body=f"smpl-{_amass_gender(arrays)}",
        has_own_rate=True,
    )
    return WorldResult("amass", (path,), (person,), _amass_rate_hz(arrays, path))


def _amass_betas(arrays: Mapping[str, np.ndarray], n_rows: int, path: Path) -> np.ndarray | None:
    found = tracked_people.mean_betas(arrays["betas"], "betas", path)
    return None if found is None else np.tile(found, (n_rows, 1))


def _amass_gender(arrays: Mapping[str, np.ndarray]) -> str:
    value = np.asarray(arrays.get("gender", "neutral")).ravel()
    word = value[0] if value.size else "neutral"
    return (word.decode("ascii", "replace") if isinstance(word, bytes) else str(word)).lower()


def _amass_rate_hz(arrays: Mapping[str, np.ndarray], path: Path) -> float | None:
    key = next((key for key in ("mocap_framerate", "mocap_frame_rate") if key in arrays), None)
    if key is None:
        return None
    found = finite_numbers(arrays[key], key, path).ravel()
    if found.size != 1 or not found[0] > 0:
        raise BadMotionFile(f"{path}: {key} is no frame rate. {_AGAIN}")
    return float(found[0])
