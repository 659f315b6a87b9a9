"""What the readers of local poses share: one person's frames, their checks, and their runs."""

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.numbers import finite_numbers
from gmrdata.values.bodies import SMPL, shape_on
from gmrdata.values.body import N_LOCAL, BodyModel, gender_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import slerp

LARGEST_NUMBER = 1 << 31  # of a frame's or a person's number
LARGEST_SKEW = 0.02
"""How far the product of a rotation matrix with its transpose may be from the identity."""
_PERSON = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, eq=False)
class PersonPoses:
    """The frames in which a file has one person."""

    name: str  # unique in the file; letters, digits, `_` and `-`
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video each row is
    betas: np.ndarray | None
    """(S,) shape coefficients of SMPL's neutral body; None where the file has others or none."""
    cuts: frozenset[int] = frozenset()  # frames with which a new shot of the video begins


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


def rotmats_of_rotvecs(rotvecs: np.ndarray, n_joints: int, what: str, path: Path) -> np.ndarray:
    """Local rotations (T, 23, 3, 3) of the tree from axis-angle (T, 3 * n_joints) [rad].

    `n_joints` is 24 for SMPL with its root, and 21 for SMPL-X's body joints without root and hands;
    the two hand joints are the identity then.
    """
    if rotvecs.ndim != 2 or rotvecs.shape[1] != 3 * n_joints or not len(rotvecs):
        fault = f"{rotvecs.shape}, not (T, {3 * n_joints}): {n_joints} joints as axis-angle"
        raise BadMotionFile(f"{path}: {what} is {fault}. Give the estimator's own output")
    local = np.zeros((len(rotvecs), N_LOCAL, 3))
    has_root = n_joints == N_LOCAL + 1
    local[:, : n_joints - has_root] = rotvecs.reshape(-1, n_joints, 3)[:, int(has_root) :]
    return Rotation.from_rotvec(local.reshape(-1, 3)).as_matrix().reshape(-1, N_LOCAL, 3, 3)


def orthonormal(rotmats: np.ndarray, what: str, path: Path) -> np.ndarray:
    """The rotations nearest to float32 matrices (..., 3, 3)."""
    skew = np.abs(rotmats @ np.swapaxes(rotmats, -1, -2) - np.eye(3)).max()
    if not skew <= LARGEST_SKEW or (np.linalg.det(rotmats) < 0).any():
        raise BadMotionFile(f"{path}: {what} holds matrices that are no rotations; make it again")
    flat = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_matrix()
    return np.asarray(flat.reshape(rotmats.shape))


def frame_numbers(value: Any, n_frames: int, what: str, path: Path) -> np.ndarray:
    """Checked video frames of the rows: (T,) int, rising."""
    found = finite_numbers(value, what, path)
    if found.shape != (n_frames,):
        fault = f"{what} is {found.shape} for {n_frames} poses"
        raise BadMotionFile(f"{path}: {fault}; make the file again")
    whole = np.array_equal(found, np.round(found)) and np.abs(found).max() < LARGEST_NUMBER
    if not whole or (np.diff(found) <= 0).any():
        raise BadMotionFile(f"{path}: {what} are not rising frame numbers; make the file again")
    return found.astype(np.int64)


def mean_betas(value: Any, what: str, path: Path) -> np.ndarray | None:
    """One shape for all frames: (T, S) or (S,) -> (S,), or None where the file has none."""
    if value is None:
        return None
    betas = finite_numbers(value, what, path)
    if betas.ndim not in (1, 2) or not betas.size:
        raise BadMotionFile(f"{path}: {what} is {betas.shape}, not (T, S); make the file again")
    return np.asarray(betas.mean(axis=0)) if betas.ndim == 2 else betas


def runs_of(
    person: PersonPoses, body: BodyModel, fps_hz: float, path: Path, bridge_frames: int
) -> list[Clip]:
    """A person's unbroken runs as clips: where frames are missing or a shot ends, one ends.

    The clips have no camera, the identity as root and the pelvis at 0, since the file's do not
    matter; `image_numbers` are the video's frames.  The file's shape is taken where it is of the
    body.  Gaps of `bridge_frames` or fewer are filled instead, by slerp of each joint, but never
    over the beginning of a shot; filled frames are not valid.
    """
    numbers = person.frame_numbers
    begins = np.diff(numbers, prepend=numbers[0]) > 1 + bridge_frames
    shot = np.searchsorted(sorted(person.cuts), numbers, side="right")
    begins |= np.diff(shot, prepend=shot[0]) > 0
    begins[0] = True
    starts = np.flatnonzero(begins)
    shape = _shape_on(body, person.betas)
    clips = []
    for start, stop in pairwise([*starts, len(begins)]):
        local_rotmats, valid = _filled(person.local_rotmats[start:stop], numbers[start:stop])
        first, last, n = int(numbers[start]), int(numbers[stop - 1]), len(valid)
        filled = f", {n - valid.sum()} missing frames filled" if not valid.all() else ""
        motion = Motion(
            local_rotmats=local_rotmats,
            root_rotmats=np.tile(np.eye(3), (n, 1, 1)),
            pelvis_m=np.zeros((n, 3)),
            shape=shape,
            fps_hz=fps_hz,
            body=body.name,
            gender=gender_of(body),
            frame="camera",
            source=f"{path.name}, {person.name}, frames {first}-{last} at {fps_hz:g} fps{filled}",
        )
        name = person.name if len(starts) == 1 else f"{person.name}_from_{first}"
        clips.append(Clip(name, motion, valid, np.arange(first, last + 1), None))
    return clips


def _filled(rotmats: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 23, 3, 3) from the first number to the last, and which of them were there."""
    frames = np.arange(numbers[0], numbers[-1] + 1)
    before = np.searchsorted(numbers, frames, side="right") - 1
    valid = numbers[before] == frames
    filled = rotmats[before].copy()
    gaps = before[~valid]
    if len(gaps):
        shares = (frames[~valid] - numbers[gaps]) / (numbers[gaps + 1] - numbers[gaps])
        filled[~valid] = slerp(rotmats[gaps], rotmats[gaps + 1], shares)
    return filled, valid


def _shape_on(body: BodyModel, betas: np.ndarray | None) -> np.ndarray:
    """(S,) SMPL's neutral betas on SMPL's neutral body; the mean shape of all others."""
    if betas is None or body.name != f"{SMPL}neutral":
        return np.zeros(body.n_shape)
    return shape_on(body, betas)
