"""Human3.6M's JSON files of one subject: SMPL parameters of each take, and the four cameras.

Layout, as I2L-MeshNet (Moon and Lee 2020) and NeuralAnnot (Moon et al. 2022) give it out and their
loaders read it: parameters[action][subaction][frame] = {pose, shape, trans, ...} with `pose` 72
numbers [rad], `shape` 10 betas of SMPL's neutral body and `trans` SMPL's transl in Human3.6M's
z-up world [m]; cameras[number] = {R, t, f, c}, where a world point X [mm] is R X + t in the camera.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read import numbers
from gmrdata.values.errors import BadRecord, BadSequence, MissingInput
from gmrdata.values.files import read_json
from gmrdata.values.transforms import are_rotations, invert, rigid

TRAINING_SUBJECTS, TEST_SUBJECTS = (1, 5, 6, 7, 8), (9, 11)
"""Subjects that everybody trains on, and tests on."""
VIDEO_HZ = 50.0  # rate of the videos, and of frame numbers [Hz]
ACTIONS = {
    2: "Directions", 3: "Discussion", 4: "Eating", 5: "Greeting", 6: "Phoning", 7: "Posing",
    8: "Purchases", 9: "Sitting", 10: "SittingDown", 11: "Smoking", 12: "Photo", 13: "Waiting",
    14: "Walking", 15: "WalkDog", 16: "WalkTogether",
}  # fmt: skip
"""Names by the numbers that the files use."""
SIZES_PX = {1: (1000, 1002), 2: (1000, 1000), 3: (1000, 1000), 4: (1000, 1002)}
"""Width and height of each camera's images [px]: 54138969, 55011271, 58860488 and 60457274."""
PARAMETER_FILES = ("Human36M_subject{}_smpl_param.json", "Human36M_subject{}_SMPL_NeuralAnnot.json")
"""Names of a subject's SMPL parameters; the first that is there is read."""
CAMERA_FILE = "Human36M_subject{}_camera.json"
LARGEST_FILE_BYTES = 1 << 31  # a subject's parameters have some ten to some hundred million bytes
MOST_FRAMES = 20_000  # the longest video has 6343 frames
_WHOLE_NUMBER = re.compile(r"0|[1-9][0-9]{0,5}")
_AGAIN = "get the file again"


def find_subjects(root: Path) -> dict[int, Path]:
    """The file of SMPL parameters of each subject, in the folder or in its `annotations`."""
    folders = (root, root / "annotations")
    files = {}
    for subject in (*TRAINING_SUBJECTS, *TEST_SUBJECTS):
        paths = [folder / n.format(subject) for n in PARAMETER_FILES for folder in folders]
        there = [path for path in paths if path.is_file()]
        if there:
            files[subject] = there[0]
    if not files:
        what = f"no {PARAMETER_FILES[0].format('N')} here or in annotations/"
        raise MissingInput(f"{root}: {what}. Name the folder of Human3.6M's annotation files")
    return files


def find_cameras(parameter_path: Path, subject: int) -> Path:
    """A subject's camera file: beside the parameters, or in `annotations` or the folder above."""
    name = CAMERA_FILE.format(subject)
    folder = parameter_path.parent
    for place in (folder, folder / "annotations", folder.parent):
        if (place / name).is_file():
            return place / name
    raise MissingInput(f"{folder / name}: no such file. Put the subject's cameras there")


@dataclass(frozen=True, eq=False)
class Action:
    """One performance of an action: N frames that have SMPL parameters, in ascending order."""

    action: int  # 2 to 16
    subaction: int  # 1 or 2
    frames: np.ndarray  # (N,) int frame numbers in the 50 Hz video, from 0
    poses_rad: np.ndarray  # (N, 72) axis-angle of the 24 SMPL joints, the root's in the world [rad]
    shapes: np.ndarray  # (N, 10) betas, which each frame's fit chose anew
    trans_m: np.ndarray
    """(N, 3) SMPL's transl in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""


@dataclass(frozen=True, eq=False)
class FixedCamera:
    """One of the four cameras: K (3, 3) [px], and its place (4, 4) in the z-up world [m]."""

    intrinsics_px: np.ndarray
    world_from_cam: np.ndarray


def read_takes(path: Path) -> list[Action]:
    """All takes, by action and subaction.  NaN in a frame is kept; `usable_rows` finds it."""
    content = _read(path)
    takes = []
    with numbers.checked(path, _AGAIN):
        for action, of_action in _numbered(content, ""):
            if action not in ACTIONS:
                raise numbers.WrongContent(f"action {action} is none of Human3.6M's 2 to 16")
            for subaction, of_take in _numbered(of_action, f"[{action}]"):
                takes.append(_take(action, subaction, of_take))
        if not takes:
            raise numbers.WrongContent("holds no takes")
    return takes


def read_cameras(path: Path) -> dict[int, FixedCamera]:
    """The cameras of a subject by their numbers 1 to 4; errors as in `read_takes`."""
    content = _read(path)
    with numbers.checked(path, _AGAIN):
        return {n: _camera(values, f"[{n}]") for n, values in _numbered(content, "")}


def _read(path: Path) -> Any:
    numbers.check_file(path, LARGEST_FILE_BYTES, "Human3.6M")
    try:
        return read_json(path)
    except BadRecord as error:
        raise BadSequence(str(error).replace("make it again", _AGAIN)) from None


def _numbered(value: Any, place: str) -> list[tuple[int, Any]]:
    """Items of an object whose keys are whole numbers, in their order."""
    _require_object(value, place or "the file")
    if not all(_WHOLE_NUMBER.fullmatch(key) for key in value):
        raise numbers.WrongContent(f"{place or 'the file'} has keys that are no whole numbers")
    return [(int(key), value[key]) for key in sorted(value, key=int)]


def _require_object(value: Any, place: str) -> None:
    if not isinstance(value, dict):
        raise numbers.WrongContent(f"{place} is {numbers.kind_of(value)}, not an object")


def _take(action: int, subaction: int, value: Any) -> Action:
    place = f"[{action}][{subaction}]"
    rows = _numbered(value, place)
    if not rows:
        raise numbers.WrongContent(f"{place} has no frames")
    frames = np.array([frame for frame, _ in rows], dtype=np.int64)
    if frames[-1] >= MOST_FRAMES:
        raise numbers.WrongContent(f"{place} has a frame {frames[-1]}, which no video has")
    poses_rad, shapes, trans_m = (
        np.stack([_flat(row, f"{place}[{n}]", key, size) for n, row in rows])
        for key, size in (("pose", 72), ("shape", 10), ("trans", 3))
    )
    return Action(action, subaction, frames, poses_rad, shapes, trans_m)


def _flat(row: Any, place: str, key: str, size: int) -> np.ndarray:
    """Numbers that stand in one list or in a list of one list, as `trans` does."""
    _require_object(row, place)
    value = row.get(key)
    while isinstance(value, list) and len(value) == 1 and size > 1:
        value = value[0]
    return numbers.floats_of(value, f"{place}.{key}", (size,))


def _camera(value: Any, place: str) -> FixedCamera:
    t_mm, focal_px, centre_px = (
        _flat(value, place, key, size) for key, size in (("t", 3), ("f", 2), ("c", 2))
    )
    rotmat = numbers.floats_of(value.get("R"), f"{place}.R", (3, 3))
    if not are_rotations(rotmat):
        raise numbers.WrongContent(f"{place}.R is no rotation")
    finite = numbers.usable_rows(t_mm[None], focal_px[None], centre_px[None]).all()
    if not (finite and focal_px.min() > 0):
        raise numbers.WrongContent(f"{place} has no finite t, f and c with f > 0")
    intrinsics_px = np.diag([*focal_px, 1.0])
    intrinsics_px[:2, 2] = centre_px
    return FixedCamera(intrinsics_px, invert(rigid(rotmat, t_mm / 1000.0)))
