"""What the readers of other systems' results share: entries of a file, and checks of their arrays.

A system's file is read part by part, as far as its keys are there; what is there is checked.  Who
needs a part that is not there gets `lacks` as the reason (`gmrdata.read.systems.result`).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.numbers import finite_numbers, require_radians
from gmrdata.values.body import N_LOCAL
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.transforms import are_rotations, rigid, rotmats_from_rotvecs

AGAIN = "Give the system's own file, or make it again"
KNOWN = (
    "Known are results of VIBE, WHAM, GVHMR, GEM, PromptHMR, TRAM, SLAHMR, PHALP (4D-Humans) and "
    "SAM 3D Body"
)
N_SMPLX_BODY = 21
"""Joints of SMPL-X's `body_pose`: SMPL's first after the root, without its two of the hands."""
SMPLX_REST_PELVIS_M = np.array([0.0031, -0.3514, 0.0120])
"""J0 of SMPL-X's neutral body in its mean shape, rest frame [m]."""
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
Z_UP_FROM_Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Also the world of a camera that is held level, in which it looks along +y."""
AXIS_ANGLES = (
    "pose", "poses", "pose_world", "body_pose", "global_orient", "pose_body", "root_orient",
)  # fmt: skip
LARGEST_NUMBER = 1 << 31  # of a frame's or a person's number
LARGEST_SKEW = 0.02
"""How far the product of a rotation matrix with its transpose may be from the identity."""
ONE_SHAPE = ((10,), (16,), (300,))
"""Shapes of `betas` that are no rows; SMPL's releases have so many coefficients."""
_PERSON = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, eq=False)
class Entry:
    """The values of one person, frame or camera in a file."""

    values: Any  # a mapping, if the file is what it should be
    name: str  # as messages call it
    path: Path

    def has(self, *keys: str) -> bool:
        return not self.lacking(*keys)

    def lacking(self, *keys: str) -> str:
        """What is not there of some keys, in words; empty where all are."""
        values = self.values if isinstance(self.values, Mapping) else {}
        return next((f"no {key!r}" for key in keys if values.get(key) is None), "")

    def array(self, key: str, *shape: int | None, rows: np.ndarray | None = None) -> np.ndarray:
        """An array of a shape, in which None stands for any size but 0; finite in the rows."""
        if lacking := self.lacking(key):
            raise self.fault(f"{self.name} has {lacking}")
        value, what = self.values[key], f"{key} of {self.name}"
        if rows is not None and isinstance(value, np.ndarray) and value.shape[:1] == shape[:1]:
            value, shape = value[rows], (len(rows), *shape[1:])
        numbers = finite_numbers(value, what, self.path)
        pairs = zip(shape, numbers.shape, strict=False)
        wrong = numbers.ndim != len(shape) or any(n not in (None, size) for n, size in pairs)
        if wrong or not numbers.size:
            wanted = ", ".join("T" if n is None else str(n) for n in shape)
            raise self.fault(f"{what} is {numbers.shape}, not ({wanted})")
        if key in AXIS_ANGLES and numbers.shape[-1] % 3 == 0:
            require_radians(numbers, what, self.path)
        return numbers

    def finite(self, key: str) -> np.ndarray:
        """The numbers of a key, in the shape that they have."""
        if lacking := self.lacking(key):
            raise self.fault(f"{self.name} has {lacking}")
        return finite_numbers(self.values[key], f"{key} of {self.name}", self.path)

    def flat(self, key: str, size: int | None) -> np.ndarray:
        """So many numbers, however they are nested; None for any count but 0."""
        row = self.finite(key).ravel()
        if row.size == 0 or size not in (None, row.size):
            raise self.fault(f"{key} of {self.name} has {row.size} numbers, not {size or 'any'}")
        return row

    def positive(self, key: str, values: np.ndarray) -> None:
        """Refuse what is not above 0; `key` says what it is of the entry."""
        if len(wrong := np.argwhere(~(values > 0))):
            raise self.fault(f"{key} of {self.name} is not above 0 at row {wrong[0][0]}")

    def rotations(self, key: str, *shape: int | None, rows: np.ndarray | None = None) -> np.ndarray:
        """The rotations nearest to matrices (..., 3, 3), which float32 made a little skew."""
        return self.orthonormal(key, self.array(key, *shape, 3, 3, rows=rows))

    def orthonormal(self, key: str, rotmats: np.ndarray) -> np.ndarray:
        if not are_rotations(rotmats, LARGEST_SKEW).all():
            raise self.fault(f"{key} of {self.name} holds matrices that are no rotations")
        flat = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_matrix()
        return np.asarray(flat.reshape(rotmats.shape))

    def frame_numbers(self, key: str, n_rows: int) -> np.ndarray:
        """(T,) int, rising from 0 or more: the video's frames of the rows."""
        numbers, what = self.finite(key), f"{key} of {self.name}"
        if numbers.shape != (n_rows,):
            raise self.fault(f"{what} is {numbers.shape} for {n_rows} poses")
        is_whole = np.array_equal(numbers, np.round(numbers))
        if not is_whole or numbers.min() < 0 or (np.diff(numbers) <= 0).any():
            raise self.fault(f"{what} are not rising frame numbers")
        return numbers.astype(np.int64)

    def betas(self, key: str, n_rows: int) -> np.ndarray | None:
        """(T, S) shape coefficients by row, from those or from one shape (S,) for all; or None."""
        if not self.has(key):
            return None
        if getattr(self.values[key], "shape", None) in ONE_SHAPE:
            return np.tile(self.array(key, None), (n_rows, 1))
        return self.array(key, n_rows, None)

    def fault(self, what: str) -> BadMotionFile:
        return BadMotionFile(f"{self.path}: {what}. {AGAIN}")


def person_name(key: Any, path: Path) -> str:
    """Name of a person that a file knows by a number or a word."""
    number = whole_number(key)
    if number is not None:
        return f"person_{number}"
    if isinstance(key, str) and _PERSON.fullmatch(key):
        return key
    what = f"a person is called {shown(key)}; give people numbers or plain words"
    raise BadMotionFile(f"{path}: {what}")


def whole_number(value: Any) -> int | None:
    """A whole number of a reasonable size, else None."""
    is_whole = isinstance(value, int | np.integer) and abs(int(value)) < LARGEST_NUMBER
    return int(value) if is_whole else None


def shown(key: Any) -> str:
    """A file's own name for something, as a message can have it."""
    return repr(key[-80:]) if isinstance(key, str) else f"a {type(key).__name__}"


def rotmats_of(rotvecs: np.ndarray) -> np.ndarray:
    """Axis-angle (T, 3 J) [rad] as (T, J, 3, 3)."""
    return rotmats_from_rotvecs(rotvecs.reshape(len(rotvecs), -1, 3))


def smplx_local(body_pose: np.ndarray) -> np.ndarray:
    """Local rotations (T, 23, 3, 3) of SMPL's tree from SMPL-X's `body_pose` (T, 63) [rad]."""
    straight = np.tile(np.eye(3), (len(body_pose), N_LOCAL - N_SMPLX_BODY, 1, 1))
    return np.concatenate([rotmats_of(body_pose), straight], axis=1)


def turned(rotmat: np.ndarray, n_rows: int) -> np.ndarray:
    """(T, 4, 4) one rotation for all rows."""
    return np.tile(rigid(rotmat, np.zeros(3)), (n_rows, 1, 1))


def implied_camera(
    z_up_from_file: np.ndarray, world_rotmats: np.ndarray, cam_rotmats: np.ndarray
) -> np.ndarray:
    """(T, 4, 4) z_up_from_cam by one root's orientations in the world and the camera; no place."""
    rotmats = z_up_from_file[:, :3, :3] @ world_rotmats @ np.swapaxes(cam_rotmats, 1, 2)
    return rigid(rotmats, np.zeros(3))
