"""Up as a phone felt it, before each frame's camera, from what recording apps leave beside a video.

Cameras look along +z with y down, as everywhere here; ARKit's world has y up along gravity.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.safe_pickle import BROKEN
from gmrdata.values.errors import BadIntrinsics, MissingInput
from gmrdata.values.files import parse_json
from gmrdata.values.frame_set import FrameSet

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
ARKIT_UP = np.array([0.0, 1.0, 0.0])
ODOMETRY = ("frame", "qx", "qy", "qz", "qw")
PLAIN = ("frame", "x", "y", "z")
TAKEN = (
    "record3d's metadata, Stray Scanner's odometry.csv, or a .csv with the columns frame, x, y, z: "
    "where gravity pulls in the camera's axes (x right, y down, z forward)"
)


def read_gravity(path: Path, frames: FrameSet) -> np.ndarray:
    """Unit directions (T, 3) that are up in the camera's axes, at T frames by their numbers; NaN
    where the file has none.

    Sources: record3d's `metadata` (poses as qx qy qz qw x y z in OpenGL's axes, from the first
    frame, whose own place in ARKit's world is `initPose`); Stray Scanner's `odometry.csv` (in
    OpenCV's axes, docs/format.md of StrayRobots/scanner); or plain directions of gravity.

    Raises:
        MissingInput, BadIntrinsics: there is no file, it is none of these, or of other frames.
    """
    ups = ups_by_frame(path)
    nowhere = np.full(3, np.nan)
    directions = np.array([ups.get(int(number), nowhere) for number in frames.frame_numbers])
    if np.isfinite(directions[:, 0]).sum() < 2:
        numbers = f"{frames.frame_numbers[0]}-{frames.frame_numbers[-1]}"
        what = f"has gravity of hardly any of the video's frames {numbers}"
        raise BadIntrinsics(f"{path}: {what}; give the video's own file")
    # Images out of a longer recording are counted from 0, and would get the gravity of its start.
    # One number more is a last pose without a picture.
    if frames.n_frames is not None and max(ups) > frames.n_frames:
        what = f"has gravity up to frame {max(ups)}, and there are {frames.n_frames} frames"
        remedy = "give the whole video with --from and --to, or a .csv whose frame 0 is the first"
        raise BadIntrinsics(f"{path}: {what}; {remedy}")
    return directions


def ups_by_frame(path: Path) -> dict[int, np.ndarray]:
    """All that a file has, (3,) by the number of the frame; errors as of `read_gravity`."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such file of gravity; give {TAKEN}")
    try:
        text = path.read_bytes().decode("utf-8-sig")
        return dict(_record3d(parse_json(text)) if text.lstrip()[:1] == "{" else _rows(text))
    except (*BROKEN, csv.Error) as error:
        raise BadIntrinsics(f"{path}: no gravity can be read ({error}); give {TAKEN}") from None


def _record3d(values: Mapping[str, Any]) -> Iterator[tuple[int, np.ndarray]]:
    if "initPose" not in values:
        raise ValueError("no initPose, without which poses are from the first frame alone")
    first = Rotation.from_quat(_quaternions([values["initPose"]]))[0]
    poses = Rotation.from_quat(_quaternions(values["poses"]))
    up = (first * poses).inv().apply(ARKIT_UP) @ OPENCV_FROM_OPENGL
    return enumerate(up)


def _quaternions(poses: Sequence[Sequence[float]]) -> np.ndarray:
    rows = np.array(poses, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 7 or not np.isfinite(rows).all():
        raise ValueError("poses are not seven numbers each")
    return rows[:, :4]


def _rows(text: str) -> Iterator[tuple[int, np.ndarray]]:
    """By the columns of a table: ARKit's rotations, or directions of gravity."""
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    names = [name.strip() for name in rows.fieldnames or ()]
    rows.fieldnames = names
    if set(ODOMETRY) <= set(names):
        columns: tuple[str, ...] = ODOMETRY
    elif set(PLAIN) == set(names):
        columns = PLAIN
    else:
        raise ValueError(f"columns {', '.join(names[:9])}")
    table = np.array([[float(row[name]) for name in columns] for row in rows])
    if not len(table) or not np.isfinite(table).all():
        raise ValueError("no rows of finite numbers")
    numbers, values = table[:, 0], table[:, 1:]
    if (numbers != numbers.round()).any() or len(np.unique(numbers)) < len(numbers):
        raise ValueError("frames are not counted by whole numbers, each once")
    lengths = np.linalg.norm(values, axis=1)
    if not lengths.all():
        raise ValueError("a row of zeros")
    if columns is PLAIN:
        ups = -values / lengths[:, None]
    else:
        ups = Rotation.from_quat(values).inv().apply(ARKIT_UP)
    return zip(numbers.astype(int).tolist(), ups, strict=True)
