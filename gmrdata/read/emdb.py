"""From a sequence's `*_data.pkl` to checked arrays.  Nothing that the pickle asks for is run.

Layout after EMDB's own description of its files (Kaufmann et al. 2023).

Where EMDB's sequences lie: `P0/09_outdoor_walk/P0_09_outdoor_walk_data.pkl` and the like.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.numbers import kind_of, numbers, usable_rows
from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.errors import BadSequence, MissingInput

FPS_HZ = 30.0
"""Rate of the images and all arrays [Hz]."""


def find_sequences(root: Path) -> list[Path]:
    """The `*_data.pkl` of each sequence, sorted; links that lead out of the folder are left out.

    Raises:
        MissingInput: there is none.
    """
    inside = root.resolve()
    found = sorted(
        path
        for path in root.glob("P*/*/*_data.pkl")
        if path.is_file() and path.resolve().is_relative_to(inside)
    )
    if not found:
        raise MissingInput(
            f"{root}: no P*/<sequence>/*_data.pkl. Name the folder that holds EMDB's P0 to P9"
        )
    return found


LARGEST_FILE_BYTES = 1 << 29
"""EMDB's own files have some ten million bytes."""
LARGEST_SIDE_PX = 100_000
RIGID_TOLERANCE = 1e-3
"""Largest entry of R^T R - 1 of a rotation as files round it."""
GENDERS = ("female", "male", "neutral")
_AGAIN = "get the file again from EMDB"


@dataclass(frozen=True, eq=False)
class EmdbSequence:
    """One person and one moving camera over N frames at 30 Hz, in EMDB's y-up world."""

    name: str
    """`P0_09_outdoor_walk`."""
    emdb1: bool
    """Whether it is in EMDB 1, on which poses are scored."""
    emdb2: bool
    """Whether it is in EMDB 2, on which global trajectories are scored."""
    gender: str
    """Of the SMPL body: "female", "male" or "neutral"."""
    good: np.ndarray
    """(N,) bool: frames in which the person is in view; `good_frames_mask`."""
    poses_rad: np.ndarray
    """(N, 72) axis-angle of the 24 SMPL joints, the first three world_from_root [rad]."""
    trans_m: np.ndarray
    """(N, 3) SMPL's transl in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""
    betas: np.ndarray
    """(10,) SMPL shape."""
    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix [px]."""
    cam_from_world: np.ndarray
    """(N, 4, 4) rigid transforms [m], OpenCV camera axes; `extrinsics`."""
    width_px: int
    """Image width [px]."""
    height_px: int
    """Image height [px]."""

    @property
    def n_frames(self) -> int:
        """Number of frames N."""
        return len(self.trans_m)


def read_emdb(path: Path) -> EmdbSequence:
    """Read one `*_data.pkl`.  NaN in poses and cameras is kept; `gmrdata.motion.emdb` drops it.

    Raises:
        MissingInput: there is no such file.
        UnsafePickle: the pickle wants to call something; the message names it, nothing was run.
        BrokenPickle: truncated, or no pickle.
        BadSequence: a key is missing, or an array's type, shape or length doesn't fit the others.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise BadSequence(f"{path}: has {path.stat().st_size} bytes, which no sequence has")
    content = load_plain(path)
    try:
        return _sequence(content)
    except ValueError as error:
        raise BadSequence(f"{path}: {error}; {_AGAIN}") from None


def rigid_rows(transforms: np.ndarray) -> np.ndarray:
    """(N, 4, 4) -> (N,) bool: finite, a proper rotation and a translation."""
    finite = usable_rows(transforms)
    rotmats = np.where(finite[:, None, None], transforms[:, :3, :3], np.eye(3))
    off = np.abs(np.swapaxes(rotmats, 1, 2) @ rotmats - np.eye(3)).max(axis=(1, 2))
    proper = (off < RIGID_TOLERANCE) & (np.linalg.det(rotmats) > 0)
    return finite & proper & (transforms[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)


def _sequence(content: Any) -> EmdbSequence:
    smpl, camera = _dict(content, "smpl"), _dict(content, "camera")
    n_frames = _whole(content, "n_frames", most=10_000_000)
    width_px, height_px = (_whole(camera, key, LARGEST_SIDE_PX) for key in ("width", "height"))
    root_rad = _array(smpl, "poses_root", (n_frames, 3))
    body_rad = _array(smpl, "poses_body", (n_frames, 69))
    betas = _array(smpl, "betas", (10,))
    if not usable_rows(betas[None]).all():
        raise ValueError("betas are not finite")
    return EmdbSequence(
        name=_text(content, "name"),
        emdb1=_flag(content, "emdb1"),
        emdb2=_flag(content, "emdb2"),
        gender=_gender(content),
        good=_good(content, n_frames),
        poses_rad=np.concatenate([root_rad, body_rad], axis=1),
        trans_m=_array(smpl, "trans", (n_frames, 3)),
        betas=betas,
        intrinsics_px=_intrinsics(camera),
        cam_from_world=_array(camera, "extrinsics", (n_frames, 4, 4)),
        width_px=width_px,
        height_px=height_px,
    )


def _get(content: Any, key: str) -> Any:
    if not isinstance(content, dict):
        raise ValueError(f"holds {kind_of(content)} where a dictionary with {key!r} belongs")
    if key not in content:
        raise ValueError(f"no sequence of EMDB, it lacks {key!r}")
    return content[key]


def _dict(content: Any, key: str) -> dict[Any, Any]:
    value = _get(content, key)
    if not isinstance(value, dict):
        raise ValueError(f"{key} is {kind_of(value)}, expected a dictionary")
    return value


def _array(content: Any, key: str, shape: tuple[int, ...]) -> np.ndarray:
    value = _get(content, key)
    try:
        return numbers(value, shape)
    except ValueError as error:
        raise ValueError(f"{key} {error}") from None


def _whole(content: Any, key: str, most: int) -> int:
    value = _get(content, key)
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not 1 <= value <= most:
        raise ValueError(f"{key} is {value!r:.40}, expected a whole number from 1")
    return int(value)


def _text(content: Any, key: str) -> str:
    value = _get(content, key)
    if isinstance(value, np.ndarray) and value.dtype.kind in "US" and value.size == 1:
        value = value.reshape(())[()]
    if isinstance(value, bytes):
        value = value.decode("latin1")
    if not isinstance(value, str):
        raise ValueError(f"{key} is {kind_of(value)}, expected a string")
    return str(value)


def _flag(content: Any, key: str) -> bool:
    value = _get(content, key)
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{key} is {kind_of(value)}, expected True or False")
    return bool(value)


def _gender(content: Any) -> str:
    gender = _text(content, "gender").lower()
    if gender not in GENDERS:
        raise ValueError(f"gender is {gender[:20]!r}, expected {', '.join(GENDERS)}")
    return gender


def _good(content: Any, n_frames: int) -> np.ndarray:
    good = np.asarray(_get(content, "good_frames_mask"))
    if good.shape != (n_frames,) or good.dtype.kind not in "biu":
        raise ValueError(f"good_frames_mask is {kind_of(good)}, expected {n_frames} of True, False")
    return good != 0


def _intrinsics(camera: dict[Any, Any]) -> np.ndarray:
    intrinsics_px = _array(camera, "intrinsics", (3, 3))
    is_pinhole = (
        usable_rows(intrinsics_px[None]).all()
        and intrinsics_px[0, 0] > 0
        and intrinsics_px[1, 1] > 0
        and np.array_equal(intrinsics_px[2], (0.0, 0.0, 1.0))
        and intrinsics_px[1, 0] == 0
    )
    if not is_pinhole:
        raise ValueError(f"intrinsics is no calibration matrix: {intrinsics_px.tolist()}")
    return intrinsics_px
