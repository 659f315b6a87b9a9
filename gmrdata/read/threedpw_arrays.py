"""From a sequence file (.pkl) to checked arrays.  Nothing that the pickle asks for is run.

The content of a 3DPW sequence file as plain arrays, each with the meaning that it really has.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.errors import BadSequence, MissingInput

FPS_HZ = 30.0
"""Rate of the images and of all arrays that are aligned to them [Hz]."""
IMU_HZ = 60.0
"""Rate of the IMUs and of `poses_60Hz` and `trans_60Hz` [Hz]."""
N_KEYPOINTS = 18
"""OpenPose's COCO keypoints in `poses2d`."""
GENDERS = {"f": "female", "m": "male"}
"""3DPW's letters for the gender of a person's SMPL body."""


@dataclass(frozen=True, eq=False)
class Person:
    """One person over the N frames of a sequence, in 3DPW's world.

    That world is y-up and drifts: only relative to `SequenceArrays.cam_from_world` of the same
    frame is a person where the image shows them.
    """

    poses_rad: np.ndarray
    """(N, 72) axis-angle of the 24 SMPL joints; the first three are world_from_root [rad].
    `poses` in the file."""
    trans_m: np.ndarray
    """(N, 3) SMPL's `transl` in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""
    betas: np.ndarray
    """(S,) SMPL shape; S is 10, and longer in some files: a body takes as many as it has."""
    gender: str
    """"female" or "male"; `genders` in the files, `gender` in the readme."""
    campose_valid: np.ndarray
    """(N,) bool: the camera of this frame was aligned to this person."""
    poses2d_px: np.ndarray
    """(N, 18, 3) OpenPose keypoints: x [px], y [px], confidence; all zero where fewer than 6 joints
    were found.  The files have (N, 3, 18)."""
    poses_60hz_rad: np.ndarray | None = None
    """(M, 72) as `poses_rad`, at the IMUs' 60 Hz."""
    trans_60hz_m: np.ndarray | None = None
    """(M, 3) as `trans_m`, at 60 Hz."""
    joints_world_m: np.ndarray | None = None
    """(N, 24, 3) SMPL joints in the world [m]; `jointPositions`, (N, 72) in the files."""
    betas_clothed: np.ndarray | None = None
    """(S,) shape of the clothed template."""
    template_clothed_m: np.ndarray | None = None
    """(V, 3) clothed template, rest frame [m]; V is SMPL's 6890."""


@dataclass(frozen=True, eq=False)
class SequenceArrays:
    """A sequence file: one camera and one or two people, N frames at 30 Hz.

    Row t of every array but the 60 Hz ones belongs to `image_{t:05d}.jpg`.
    """

    name: str
    """The name that stands in the file."""
    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix K [px]; pixel (0, 0) is the outer corner of the top-left pixel."""
    cam_from_world: np.ndarray
    """(N, 4, 4) rigid transforms [m], OpenCV camera axes; `cam_poses`, world to camera."""
    img_frame_ids: np.ndarray
    """(N,) rows of the **60 Hz** arrays (0, 2, 4, ...), not numbers of images."""
    people: tuple[Person, ...]
    """One or two people."""

    @property
    def n_frames(self) -> int:
        """Number of frames N."""
        return int(self.cam_from_world.shape[0])


LARGEST_FILE_BYTES = 1 << 29
"""3DPW's own files have some ten million bytes; what is far larger is something else."""
SMPL_SHAPES = 10
_AGAIN = "get the file again from 3DPW"

Size = int | None
"""A dimension of an expected shape; None for any."""


@dataclass(frozen=True)
class _File:
    """A sequence file's top level, with the path for messages."""

    path: Path
    content: dict[Any, Any]

    def bad(self, what: str, remedy: str = _AGAIN) -> BadSequence:
        return BadSequence(f"{self.path}: {what}; {remedy}")

    def get(self, *keys: str) -> Any:
        """The value of the first key that is there."""
        for key in keys:
            if key in self.content:
                return self.content[key]
        other = f" (or {keys[1]!r})" if len(keys) > 1 else ""
        raise self.bad(f"no sequence file of 3DPW, it lacks {keys[0]!r}{other}")


def read_sequence_file(path: Path) -> SequenceArrays:
    """Read one `sequenceFiles/<split>/<sequence>.pkl`, without its images.

    Layout after 3DPW's readme; where files differ from it, both are read: `genders` or `gender`,
    `poses2d` or `poses2D`, (N, 3, 18) or (N, 18, 3).  NaN in poses and cameras is kept: see
    `gmrdata.read.threedpw` for which frames can be used.

    Args:
        path: The file, a pickle of Python 2 (protocol 2, Latin-1).

    Raises:
        MissingInput: there is no such file.
        UnsafePickle: the pickle wants to call something; the message names it, nothing was run.
        BrokenPickle: truncated, or no pickle.
        BadSequence: a key is missing, or an array's type, shape or length doesn't fit the others.
    """
    file = _open(path)
    cam_from_world = _numbers(file, file.get("cam_poses"), "cam_poses", (None, 4, 4))
    n_frames = len(cam_from_world)
    if n_frames == 0:
        raise file.bad("cam_poses is empty: the sequence has no frames")
    ids = _array(file, file.get("img_frame_ids"), "img_frame_ids", (n_frames,), "iu")
    people = _people(file, n_frames)
    return SequenceArrays(
        name=_text(file, file.get("sequence"), "sequence"),
        intrinsics_px=_intrinsics(file),
        cam_from_world=cam_from_world,
        img_frame_ids=ids.astype(np.int64),
        people=people,
    )


def _open(path: Path) -> _File:
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise BadSequence(
            f"{path}: has {path.stat().st_size} bytes, which no sequence of 3DPW has; {_AGAIN}"
        )
    content = load_plain(path)
    if not isinstance(content, dict):
        raise BadSequence(f"{path}: holds a {type(content).__name__}, not a dictionary; {_AGAIN}")
    return _File(path, content)


def _people(file: _File, n_frames: int) -> tuple[Person, ...]:
    poses = file.get("poses")
    if not isinstance(poses, list | tuple) or not poses:
        raise file.bad(f"poses is {_kind(poses)}, expected a list with one array per person")
    return tuple(_person(file, index, len(poses), n_frames) for index in range(len(poses)))


def _person(file: _File, index: int, n_people: int, n_frames: int) -> Person:
    def one(*keys: str) -> Any:
        return _of_person(file, file.get(*keys), keys[0], index, n_people)

    def numbers(key: str, shape: tuple[Size, ...]) -> np.ndarray:
        return _numbers(file, one(key), f"{key}[{index}]", shape)

    def optional(key: str, shape: tuple[Size, ...]) -> np.ndarray | None:
        return numbers(key, shape) if file.content.get(key) is not None else None

    valid = _array(file, one("campose_valid"), f"campose_valid[{index}]", (n_frames,), "biu")
    betas_clothed = optional("betas_clothed", (None,))
    joints_m = optional("jointPositions", (n_frames, 72))
    return Person(
        poses_rad=numbers("poses", (n_frames, 72)),
        trans_m=numbers("trans", (n_frames, 3)),
        betas=_betas(file, numbers("betas", (None,)), f"betas[{index}]"),
        gender=_gender(file, one("genders", "gender"), index),
        campose_valid=valid != 0,
        poses2d_px=_keypoints(file, one("poses2d", "poses2D"), f"poses2d[{index}]", n_frames),
        poses_60hz_rad=optional("poses_60Hz", (None, 72)),
        trans_60hz_m=optional("trans_60Hz", (None, 3)),
        joints_world_m=None if joints_m is None else joints_m.reshape(n_frames, 24, 3),
        betas_clothed=betas_clothed,
        template_clothed_m=optional("v_template_clothed", (None, 3)),
    )


def _of_person(file: _File, value: Any, key: str, index: int, n_people: int) -> Any:
    if not isinstance(value, list | tuple) or len(value) != n_people:
        raise file.bad(f"{key} is {_kind(value)}, expected a list for {n_people} people, as poses")
    return value[index]


def _numbers(file: _File, value: Any, what: str, shape: tuple[Size, ...]) -> np.ndarray:
    return _array(file, value, what, shape, "fiu").astype(np.float64)


def _array(file: _File, value: Any, what: str, shape: tuple[Size, ...], kinds: str) -> np.ndarray:
    """An array of numpy's `kinds` and the shape; the message says what was found instead."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in kinds:
        raise file.bad(f"{what} is {_kind(value)}, expected an array of numbers")
    fits = len(value.shape) == len(shape) and all(
        size in (None, found) for size, found in zip(shape, value.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise file.bad(f"{what} has shape {value.shape}, expected ({wanted}) as cam_poses has it")
    return value


def _betas(file: _File, betas: np.ndarray, what: str) -> np.ndarray:
    if len(betas) < SMPL_SHAPES or not np.isfinite(betas).all():
        raise file.bad(f"{what} has {len(betas)} values, expected {SMPL_SHAPES} finite ones")
    return betas


def _keypoints(file: _File, value: Any, what: str, n_frames: int) -> np.ndarray:
    """`poses2d` as (N, 18, 3), from the files' (N, 3, 18) or the readme's (N, 18, 3)."""
    if isinstance(value, np.ndarray) and value.shape[1:] == (3, N_KEYPOINTS):
        value = value.transpose(0, 2, 1)
    return np.ascontiguousarray(_numbers(file, value, what, (n_frames, N_KEYPOINTS, 3)))


def _gender(file: _File, value: Any, index: int) -> str:
    gender = _text(file, value, f"genders[{index}]").lower()
    if gender not in GENDERS | {name: name for name in GENDERS.values()}:
        raise file.bad(f"genders[{index}] is {gender[:20]!r}, expected 'm' or 'f'")
    return GENDERS.get(gender, gender)


def _text(file: _File, value: Any, what: str) -> str:
    """A string, as Python 2 and 3 and numpy write one."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "US" and value.size == 1:
        value = value.reshape(())[()]
    if isinstance(value, bytes):
        value = value.decode("latin1")
    if not isinstance(value, str):
        raise file.bad(f"{what} is {_kind(value)}, expected a string")
    return str(value)


def _intrinsics(file: _File) -> np.ndarray:
    intrinsics_px = _numbers(file, file.get("cam_intrinsics"), "cam_intrinsics", (3, 3))
    fx_px, fy_px = intrinsics_px[0, 0], intrinsics_px[1, 1]
    is_pinhole = (
        np.isfinite(intrinsics_px).all()
        and fx_px > 0
        and fy_px > 0
        and np.array_equal(intrinsics_px[2], (0.0, 0.0, 1.0))
        and intrinsics_px[1, 0] == 0
    )
    if not is_pinhole:
        raise file.bad(f"cam_intrinsics is no calibration matrix: {intrinsics_px.tolist()}")
    return intrinsics_px


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of dtype {value.dtype} and shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a {type(value).__name__} of {len(value)}"
    return f"a {type(value).__name__}"
