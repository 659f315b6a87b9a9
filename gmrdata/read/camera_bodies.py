"""People before the camera, as video pose estimators leave them, and the camera that each assumed.

An estimator guesses a camera, and places the body before that one.  Where it stands before the
true camera follows from its picture, so a file is read as bodies and the camera of each row:

VIBE      `vibe_output.pkl`: `pred_cam` (T, 3) = s, tx, ty of a crop, whose points are SMPL's plus
          (tx, ty, 2 * 5000 / (224 s)), seen with 5000 px in a crop of 224 px (lib/models/spin.py,
          `projection`).  `bboxes` (T, 4) = x, y of the middle and twice the side; the crop that the
          network saw is 1.1 times as large (demo.py, `bbox_scale`).  `orig_cam` (T, 4) = sx, sy,
          tx, ty leaves that out: VIBE draws people 1.1 times too small (its issue 182), so it is
          widened here where the file has nothing else.
WHAM      `wham_output.pkl`: `pose` (T, 72) and `trans` (T, 3), SMPL's transl before the camera
          (demo.py).  Its focal length is the image's diagonal (lib/utils/imutils.py,
          `compute_cam_intrinsics`), also with --calib, which only its SLAM reads.
GVHMR     `hmr4d_results.pt`: `smpl_params_incam` with `global_orient` (T, 3), `body_pose` (T, 63)
          and `transl` (T, 3) of SMPL-X, and `K_fullimg` (T, 3, 3), the diagonal again in its demo.
TRAM      `hps/hps_track_<k>.npy`: `pred_rotmat`, `pred_trans` (T, 1, 3), SMPL's transl before a
          camera of `img_focal` and `img_center`, which `camera.npy` holds (lib/models/hmr_vimo.py,
          `get_trans`); or EMDB's `.npz`, which holds all of them.
gmrdata   the folder of `gmrdata.people.local_poses`: poses and pelves before the video's camera.
PHALP     `<name>.pkl` of PHALP and 4D-Humans: `camera_bbox` (3,) = s, tx, ty of a crop round
          `center` (2,) whose side is the larger of `scale` (2,) [px].  `camera` (3,) is the same
          in a square of 256 px that holds the image of `size` (height, width), seen with 5000 px
          (phalp/models/hmar/hmar.py, `get_3d_parameters`); it is read where the others lack.

VIBE and PHALP see a crop and nothing else: the same crop at the side of the picture and in its
middle gives the same answer.  So their orientation is as seen along the ray through the crop's
middle (Yu et al., "Perspective Crop Layers", 2021).  WHAM, GVHMR and TRAM are told where the crop
is, and answer in the axes of the camera.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read import tracked_people
from gmrdata.read.numbers import finite_numbers
from gmrdata.read.pose_estimators import GVHMR_KEYS, N_SMPLX_BODY, PHALP_KEYS, ZIP
from gmrdata.read.safe_pickle import load_object_npy, load_plain
from gmrdata.read.torch_files import load_tensors
from gmrdata.read.world_results import (
    CAMERA_FILE,
    SMPLX_REST_PELVIS_M,
    VIBE_CROP_OVER_BOX,
    person_array,
    tram_tracks,
)
from gmrdata.values.body import N_JOINTS, N_LOCAL
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.local_poses import POSES_FILE, load_local_poses
from gmrdata.values.people import person_file

Estimator = Literal["vibe", "wham", "gvhmr", "tram", "phalp", "gmrdata"]

CROP_FOCAL_PX = 5000.0
"""Focal length of HMR and those after it, in a crop of their own size [px]."""
VIBE_CROP_PX, PHALP_CROP_PX = 224.0, 256.0
AGAIN = "Give the estimator's own file, or make it again"
KNOWN = "Known are VIBE's, WHAM's, GVHMR's, TRAM's and PHALP's (4D-Humans') results"
LARGEST_SIDE_ERROR_PX = 2.0  # by which twice a principal point may differ from the image's size


@dataclass(frozen=True, eq=False)
class AssumedCamera:
    """The pinhole camera that an estimator placed a body before, by row; pixels of the image."""

    focal_px: np.ndarray  # (T,)
    centre_px: np.ndarray  # (T, 2) principal point

    def at_rows(self, rows: np.ndarray) -> "AssumedCamera":
        return AssumedCamera(self.focal_px[rows], self.centre_px[rows])


@dataclass(frozen=True, eq=False)
class SeenPerson:
    """One person of a file, over the T rows in which the estimator saw it."""

    name: str  # "person_<number>", as the file counts
    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video each row is, from 0
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    root_rotmats: np.ndarray  # (T, 3, 3) root in the axes of the camera, or along the crop's ray
    transl_m: np.ndarray  # (T, 3) SMPL's transl before the assumed camera: pelvis = transl + J0
    assumed: AssumedCamera | None
    """None where the file was made with the video's own camera."""
    crop_px: np.ndarray | None
    """(T, 2) middle of the crop, where the orientation is as seen along its ray; else None."""
    betas: np.ndarray | None  # (T, S) of SMPL's neutral body; None where they are of another
    rest_pelvis_m: np.ndarray | None = None  # (3,) J0 of the file's own body, where betas don't say


@dataclass(frozen=True, eq=False)
class SeenPeople:
    """What a file holds of a video."""

    estimator: Estimator
    files: tuple[Path, ...]
    people: tuple[SeenPerson, ...]
    n_frames: int | None  # of the video, where the file tells


def read_camera_bodies(path: Path, size_px: tuple[int, int]) -> SeenPeople:
    """Read a file of VIBE, WHAM, GVHMR or PHALP, TRAM's folder or `.npz`, or our own local poses;
    nothing of it is run.

    `size_px` is the (width, height) of the video's images.  A file that says that it is of images
    of another shape is refused; of the same shape at another size, it is brought to these pixels.

    Raises:
        MissingInput, BadMotionFile, BrokenPickle, UnsafePickle: name the file and the remedy.
    """
    if path.is_dir():
        own = (path / POSES_FILE).is_file()
        return _own_folder(path, size_px) if own else _tram_folder(path, size_px)
    if not path.is_file():
        raise MissingInput(f"{path}: no such file. {KNOWN}")
    if path.suffix == ".npz":
        return _tram_npz(path, size_px)
    with path.open("rb") as stream:
        if stream.read(len(ZIP)) == ZIP:
            return _gvhmr(path, size_px)
    return _pickled(load_plain(path), path, size_px)


def _own_folder(folder: Path, size_px: tuple[int, int]) -> SeenPeople:
    record, people = load_local_poses(folder)
    if record.size_px != size_px:
        sizes = "{}x{} px, and the video's are {}x{} px".format(*record.size_px, *size_px)
        raise BadMotionFile(f"{folder}: is of images of {sizes}: it is another video's. {AGAIN}")
    files = (folder / POSES_FILE, *(folder / person_file(n) for n in range(record.people)))
    seen = [
        SeenPerson(
            name=f"person_{n}",
            frame_numbers=one.frame_numbers,
            local_rotmats=one.local_rotmats,
            root_rotmats=one.root_rotmats,
            transl_m=one.pelvis_m,
            assumed=None,
            crop_px=None,
            betas=None,
            rest_pelvis_m=np.zeros(3),
        )
        for n, one in enumerate(people)
    ]
    if not seen:
        raise BadMotionFile(f"{folder}: nobody is seen in any frame of the video")
    return SeenPeople("gmrdata", files, tuple(seen), None)


def _pickled(content: Any, path: Path, size_px: tuple[int, int]) -> SeenPeople:
    if not isinstance(content, dict) or not content:
        what = "holds nobody" if isinstance(content, dict) else "holds no dict"
        raise BadMotionFile(f"{path}: {what}. {AGAIN}")
    first = next(iter(content.values()))
    keys: set[Any] = set(first) if isinstance(first, dict) else set()
    if keys >= PHALP_KEYS:
        return _phalp(content, path, size_px)
    if "trans" in keys and "pose" in keys:
        people = [_wham_person(*item, path, size_px) for item in content.items()]
        return SeenPeople("wham", (path,), tuple(people), None)
    if keys & {"pred_cam", "orig_cam"}:
        people = [_vibe_person(*item, path, size_px) for item in content.items()]
        return SeenPeople("vibe", (path,), tuple(people), None)
    raise BadMotionFile(f"{path}: {_not_known(keys)}")


def _not_known(keys: set[Any]) -> str:
    found = ", ".join(sorted(key[:40] for key in keys if isinstance(key, str))[:12])
    if "pose_world" in keys:
        what = "has a motion in the world and none before the camera (`pose`, `trans`)"
        return f"{what}; WHAM writes both with --save_pkl. {AGAIN}"
    return f"holds no people before a camera (its first entry has {found or 'no dict'}). {KNOWN}"


def _rotmats(rotvecs: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(rotvecs).as_matrix())


def _diagonal_camera(n_rows: int, size_px: tuple[int, int]) -> AssumedCamera:
    """The guess of CLIFF, which others took over: a focal length of the image's diagonal."""
    centre_px = np.tile(np.divide(size_px, 2.0), (n_rows, 1))
    return AssumedCamera(np.full(n_rows, float(np.hypot(*size_px))), centre_px)


def _named_frames(
    key: Any, values: Any, path: Path
) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Name, pose (T, 72) [rad], frames (T,) and betas (T, S) of a person of VIBE or WHAM."""
    name = tracked_people.person_name(key, path)
    pose = person_array(values, "pose", (None, 3 * N_JOINTS), name, path)
    betas = person_array(values, "betas", (len(pose), None), name, path)
    ids = person_array(values, "frame_ids", (len(pose),), name, path)
    numbers = tracked_people.frame_numbers(ids, len(pose), f"frame_ids of {name}", path)
    return name, pose, numbers, betas


def _wham_person(key: Any, values: Any, path: Path, size_px: tuple[int, int]) -> SeenPerson:
    name, pose, numbers, betas = _named_frames(key, values, path)
    # gmrdata's own export says whose shape it is, and is of the clip's own camera.
    own_body = values.get("body")
    return SeenPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=tracked_people.rotmats_of_rotvecs(pose, N_JOINTS, "pose", path),
        root_rotmats=_rotmats(pose[:, :3]),
        transl_m=person_array(values, "trans", (len(pose), 3), name, path),
        assumed=_diagonal_camera(len(pose), size_px) if own_body is None else None,
        crop_px=None,
        betas=betas if own_body in (None, "smpl-neutral") else None,
    )


def _crop_camera(
    weak: np.ndarray, crop_px: np.ndarray, sides_px: np.ndarray, own_px: float
) -> tuple[np.ndarray, AssumedCamera]:
    """SMPL's transl (T, 3) [m], and the camera round a crop, from s, tx, ty (T, 3)."""
    depths_m = 2.0 * CROP_FOCAL_PX / (own_px * weak[:, 0])
    transl_m = np.column_stack([weak[:, 1], weak[:, 2], depths_m])
    return transl_m, AssumedCamera(CROP_FOCAL_PX * sides_px / own_px, crop_px)


def _require_positive(values: np.ndarray, what: str, path: Path) -> None:
    if len(wrong := np.flatnonzero(~(values > 0))):
        raise BadMotionFile(f"{path}: {what} is not above 0 at row {wrong[0]}. {AGAIN}")


def _vibe_person(key: Any, values: Any, path: Path, size_px: tuple[int, int]) -> SeenPerson:
    name, pose, numbers, betas = _named_frames(key, values, path)
    if {"pred_cam", "bboxes"} <= values.keys():
        weak = person_array(values, "pred_cam", (len(pose), 3), name, path)
        boxes_px = person_array(values, "bboxes", (len(pose), 4), name, path)
        crop_px, sides_px = boxes_px[:, :2], VIBE_CROP_OVER_BOX * boxes_px[:, 2]
    else:
        seen = person_array(values, "orig_cam", (len(pose), 4), name, path)
        _require_positive(seen[:, 0], f"the scale of orig_cam of {name}", path)
        # A crop as wide as the image, widened: the shift is measured from the image's middle.
        crop_px = np.divide(size_px, 2.0) * (1.0 + seen[:, :2] * seen[:, 2:])
        weak = np.column_stack([seen[:, 0], np.zeros((len(pose), 2))])
        sides_px = np.full(len(pose), VIBE_CROP_OVER_BOX * size_px[0])
    _require_positive(weak[:, 0], f"the scale of the camera of {name}", path)
    _require_positive(sides_px, f"the size of the box of {name}", path)
    transl_m, assumed = _crop_camera(weak, crop_px, sides_px, VIBE_CROP_PX)
    return SeenPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=tracked_people.rotmats_of_rotvecs(pose, N_JOINTS, "pose", path),
        root_rotmats=_rotmats(pose[:, :3]),
        transl_m=transl_m,
        assumed=assumed,
        crop_px=crop_px,
        betas=betas,
    )


def _scaled_to(
    own_size_px: np.ndarray, size_px: tuple[int, int], path: Path, error_px: float = 0.0
) -> float:
    """Pixels of the video for one of the file's images (width, height), which have its shape."""
    factors = np.divide(size_px, own_size_px)
    if abs(factors[0] / factors[1] - 1.0) * min(own_size_px) > 1.0 + error_px:
        shown = f"{own_size_px[0]:.0f}x{own_size_px[1]:.0f}"
        what = f"is of images of {shown} px, and the video's are {size_px[0]}x{size_px[1]} px"
        raise BadMotionFile(f"{path}: {what}: it is another video's, or a turned one's. {AGAIN}")
    return float(factors[0])


def _gvhmr(path: Path, size_px: tuple[int, int]) -> SeenPeople:
    content = load_tensors(path)
    seen = content.get(GVHMR_KEYS[1])
    if not isinstance(seen, Mapping):
        has = ", ".join(map(str, content))[:200]
        raise BadMotionFile(f"{path}: no {GVHMR_KEYS[1]} (it has {has}). {AGAIN}")
    rows = _whole_rows(content, seen, path)
    shown = {key: finite_numbers(_rows(seen, key, rows, path), key, path) for key in _GVHMR_ARRAYS}
    name, n_rows = "person_0", len(rows)
    matrices = person_array(content, "K_fullimg", (None, 3, 3), name, path)
    if len(matrices) != len(_first(seen, path)):
        raise BadMotionFile(f"{path}: K_fullimg has {len(matrices)} rows, not {n_rows}. {AGAIN}")
    matrices = matrices[rows]
    _require_positive(matrices[:, 0, 0], "the focal length in K_fullimg", path)
    factor = 1.0
    if "valid" not in content:  # gmrdata's own export has the clip's camera, and this key
        own_px = 2.0 * np.median(matrices[:, :2, 2], axis=0)
        factor = _scaled_to(own_px, size_px, path, LARGEST_SIDE_ERROR_PX)
    person = SeenPerson(
        name=name,
        frame_numbers=rows,
        local_rotmats=tracked_people.rotmats_of_rotvecs(
            person_array(shown, "body_pose", (n_rows, 3 * N_SMPLX_BODY), name, path),
            N_SMPLX_BODY,
            "body_pose",
            path,
        ),
        root_rotmats=_rotmats(person_array(shown, "global_orient", (n_rows, 3), name, path)),
        transl_m=person_array(shown, "transl", (n_rows, 3), name, path),
        assumed=AssumedCamera(factor * matrices[:, 0, 0], factor * matrices[:, :2, 2]),
        crop_px=None,
        betas=None,
        rest_pelvis_m=SMPLX_REST_PELVIS_M,
    )
    return SeenPeople("gvhmr", (path,), (person,), len(_first(seen, path)))


_GVHMR_ARRAYS = ("body_pose", "global_orient", "transl")


def _first(seen: Mapping[str, Any], path: Path) -> np.ndarray:
    """`body_pose`, whose rows are the video's frames."""
    found = seen.get("body_pose")
    if not isinstance(found, np.ndarray) or found.ndim != 2 or not len(found):
        raise BadMotionFile(f"{path}: body_pose in {GVHMR_KEYS[1]} is not (T, 63). {AGAIN}")
    return found


def _rows(seen: Mapping[str, Any], key: str, rows: np.ndarray, path: Path) -> np.ndarray:
    found = seen.get(key)
    if not isinstance(found, np.ndarray) or len(found) != len(_first(seen, path)):
        raise BadMotionFile(f"{path}: {GVHMR_KEYS[1]} has no {key} for each row. {AGAIN}")
    return np.asarray(found[rows])


def _whole_rows(content: Mapping[str, Any], seen: Mapping[str, Any], path: Path) -> np.ndarray:
    """(T,) rows that may be used: all, or those of `valid`, a key of gmrdata's own export."""
    n_rows, valid = len(_first(seen, path)), content.get("valid")
    if valid is None:
        return np.arange(n_rows)
    if not isinstance(valid, np.ndarray) or valid.dtype != bool or valid.shape != (n_rows,):
        raise BadMotionFile(f"{path}: `valid` is not ({n_rows},) bool. {AGAIN}")
    if not valid.any():
        raise BadMotionFile(f"{path}: `valid` names no frame. {AGAIN}")
    return np.flatnonzero(valid)


def _tram_npz(path: Path, size_px: tuple[int, int]) -> SeenPeople:
    arrays = read_npz(path)
    if "pred_rotmat" not in arrays:
        has = ", ".join(arrays)[:200]
        raise BadMotionFile(f"{path}: not TRAM's (it has {has}). {KNOWN}")
    person = _tram_person("person_0", arrays, arrays, path, size_px)
    return SeenPeople("tram", (path,), (person,), None)


def _tram_folder(folder: Path, size_px: tuple[int, int]) -> SeenPeople:
    camera_path, tracks = folder / CAMERA_FILE, tram_tracks(folder)
    camera = load_object_npy(camera_path)
    turns = person_array(camera, "world_cam_R", (None, 3, 3), "the camera", camera_path)
    people = [
        _tram_person(f"person_{number}", load_object_npy(path), camera, path, size_px)
        for number, path in sorted(tracks.items())
    ]
    files = (camera_path, *(tracks[number] for number in sorted(tracks)))
    return SeenPeople("tram", files, tuple(people), len(turns))


def _tram_person(
    name: str, values: Any, camera: Any, path: Path, size_px: tuple[int, int]
) -> SeenPerson:
    rotmats = person_array(values, "pred_rotmat", (None, N_JOINTS, 3, 3), name, path)
    rotmats = tracked_people.orthonormal(rotmats, f"pred_rotmat of {name}", path)
    n_rows = len(rotmats)
    numbers = np.arange(n_rows)
    if "frame" in values:
        what = f"frame of {name}"
        numbers = tracked_people.frame_numbers(values["frame"], n_rows, what, path)
    transl_m = finite_numbers(values.get("pred_trans"), f"pred_trans of {name}", path)
    if transl_m.size != 3 * n_rows:
        what = f"pred_trans of {name} is {transl_m.shape}, not ({n_rows}, 1, 3)"
        raise BadMotionFile(f"{path}: {what}. {AGAIN}")
    focal_px, centre_px = (
        finite_numbers(camera.get(key), f"{key} of the camera", path).ravel()
        for key in ("img_focal", "img_center")
    )
    if focal_px.size != 1 or centre_px.size != 2:
        raise BadMotionFile(f"{path}: no img_focal and img_center of the camera. {AGAIN}")
    _require_positive(np.r_[focal_px, centre_px], "img_focal or img_center", path)
    factor = _scaled_to(2.0 * centre_px, size_px, path, LARGEST_SIDE_ERROR_PX)
    return SeenPerson(
        name=name,
        frame_numbers=numbers,
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        transl_m=transl_m.reshape(n_rows, 3),
        assumed=AssumedCamera(
            np.full(n_rows, factor * focal_px[0]), np.tile(factor * centre_px, (n_rows, 1))
        ),
        crop_px=None,
        betas=person_array(values, "pred_shape", (n_rows, None), name, path),
    )


@dataclass(frozen=True, eq=False)
class _PhalpRow:
    """One track in one frame, in the pixels of the file's own images."""

    time: int
    rotmats: np.ndarray  # (24, 3, 3)
    betas: np.ndarray  # (S,)
    weak: np.ndarray  # (3,) s, tx, ty of the crop
    crop_px: np.ndarray  # (2,)
    side_px: float


def _phalp(content: Mapping[Any, Any], path: Path, size_px: tuple[int, int]) -> SeenPeople:
    tracks: dict[str, list[_PhalpRow]] = defaultdict(list)
    for key, frame in content.items():
        for track, row in _phalp_rows(frame, tracked_people.shown(key), path, size_px):
            tracks[track].append(row)
    if not tracks:
        raise BadMotionFile(f"{path}: nobody is seen in any frame. {AGAIN}")
    people = [_phalp_person(name, rows, path) for name, rows in tracks.items()]
    return SeenPeople("phalp", (path,), tuple(people), len(content))


def _phalp_rows(
    frame: Any, name: str, path: Path, size_px: tuple[int, int]
) -> list[tuple[str, _PhalpRow]]:
    """The tracks that are seen in a frame; others stay in its lists for a while."""
    time = tracked_people.whole_number(frame.get("time")) if isinstance(frame, dict) else None
    if time is None or time < 0:
        raise BadMotionFile(f"{path}: the time of frame {name} is no number. {AGAIN}")
    lists = {key: frame.get(key) for key in _PHALP_LISTS if key in frame}
    n_tracks = len(lists["tid"]) if isinstance(lists.get("tid"), list) else -1
    if any(not isinstance(one, list) or len(one) != n_tracks for one in lists.values()):
        raise BadMotionFile(f"{path}: the lists of frame {name} are of other lengths. {AGAIN}")
    rows = []
    for at, track in enumerate(frame["tid"]):
        values = {key: one[at] for key, one in lists.items()}
        if tracked_people.whole_number(values.get("tracked_time", 0)) == 0:
            who = tracked_people.person_name(track, path)
            rows.append((who, _phalp_row(time, values, f"{who} in frame {name}", path, size_px)))
    return rows


_PHALP_LISTS = (
    "tid", "tracked_time", "smpl", "camera", "camera_bbox", "center", "scale", "size",
)  # fmt: skip


def _phalp_row(
    time: int, values: Mapping[str, Any], who: str, path: Path, size_px: tuple[int, int]
) -> _PhalpRow:
    def numbers(key: str, size: int, of: Mapping[str, Any] = values) -> np.ndarray:
        found = finite_numbers(of.get(key), f"{key} of {who}", path).ravel()
        if found.size != size:
            fault = f"{key} of {who} has {found.size} numbers, not {size}"
            raise BadMotionFile(f"{path}: {fault}. {AGAIN}")
        return found

    smpl = values.get("smpl")
    if not isinstance(smpl, Mapping):
        raise BadMotionFile(f"{path}: no smpl of {who}. {AGAIN}")
    local = numbers("body_pose", N_LOCAL * 9, smpl).reshape(N_LOCAL, 3, 3)
    root = numbers("global_orient", 9, smpl).reshape(1, 3, 3)
    own_size_px = numbers("size", 2)[::-1]
    _require_positive(own_size_px, f"size of {who}", path)
    factor = _scaled_to(own_size_px, size_px, path)
    if {"camera_bbox", "center", "scale"} <= values.keys():
        weak, crop_px = numbers("camera_bbox", 3), numbers("center", 2)
        side_px = float(numbers("scale", 2).max())
    else:  # the same for the square that holds the whole image
        weak = numbers("camera", 3)
        _require_positive(weak[2:], f"the depth of {who}", path)
        side_px, depth_m = float(own_size_px.max()), float(weak[2])
        weak = np.r_[2.0 * CROP_FOCAL_PX / (PHALP_CROP_PX * depth_m), weak[:2]]
        crop_px = own_size_px / 2.0
        crop_px = crop_px + weak[0] * side_px / 2.0 * weak[1:]  # the ray is the person's
        weak = np.r_[weak[0], 0.0, 0.0]
    _require_positive(np.r_[weak[:1], side_px], f"the scale of {who}", path)
    betas = finite_numbers(smpl.get("betas"), f"betas of {who}", path).ravel()
    rotmats = np.concatenate([root, local])
    return _PhalpRow(time, rotmats, betas, weak, factor * crop_px, factor * side_px)


def _phalp_person(name: str, rows: list[_PhalpRow], path: Path) -> SeenPerson:
    rows = sorted(rows, key=lambda row: row.time)
    times = [row.time for row in rows]
    rotmats = np.stack([row.rotmats for row in rows])
    rotmats = tracked_people.orthonormal(rotmats, f"the pose of {name}", path)
    if len({row.betas.size for row in rows}) > 1:
        raise BadMotionFile(f"{path}: betas of {name} are of other lengths by frame. {AGAIN}")
    crop_px = np.stack([row.crop_px for row in rows])
    sides_px = np.array([row.side_px for row in rows])
    weak = np.stack([row.weak for row in rows])
    transl_m, assumed = _crop_camera(weak, crop_px, sides_px, PHALP_CROP_PX)
    return SeenPerson(
        name=name,
        frame_numbers=tracked_people.frame_numbers(times, len(rows), f"times of {name}", path),
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        transl_m=transl_m,
        assumed=assumed,
        crop_px=crop_px,
        betas=np.stack([row.betas for row in rows]),
    )
