"""Clip: what the manifest lists, the trainer trains on and the evaluator scores; and its file.

Beside it runs of rows that share a text, as reasons of dropped frames are; and the truth beside a
rendered clip, row by row: places of joints, and a character's residual.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from gmrdata.values.body import N_JOINTS, BodyModel, on_body, require_local
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile, BadRecord
from gmrdata.values.files import read_npz, write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.records import ArrayShapes, check_shapes, require_tag
from gmrdata.values.transforms import are_rotations, rotmats_from_rotvecs, rotvecs_from_rotmats

CLIP_FORMAT = "gmrdata-clip/1"

_SHAPES: ArrayShapes = {  # the arrays of a clip of T frames and S shape coefficients
    "format": ("U", ()),
    "poses": ("f", ("T", 72)),
    "trans": ("f", ("T", 3)),
    "betas": ("f", ("S",)),
    "rest_pelvis_m": ("f", (3,)),
    "mocap_framerate": ("fi", ()),
    "valid": ("b", ("T",)),
    "image_numbers": ("iu", ("T",)),
    "body": ("U", ()),
    "gender": ("U", ()),
    "frame": ("U", ()),
    "source": ("U", ()),
    "id": ("U", ()),
}

_CAMERA_SHAPES: ArrayShapes = {  # those that a clip with a camera has beside them
    "camera_intrinsics_px": ("f", (3, 3)),
    "camera_size_px": ("iu", (2,)),
    "world_from_cam": ("f", ("T", 4, 4)),
    "has_camera": ("b", ("T",)),
}


@dataclass(frozen=True, eq=False)
class Clip:
    """One person in one take, over T frames."""

    id: str  # unique within a manifest; letters, digits, `_`, `-` and `.`
    motion: Motion
    valid: np.ndarray  # (T,) bool: frames whose motion can be used
    image_numbers: np.ndarray  # (T,) int: number in the file name of each row's image; -1 for none
    camera: CameraPath | None  # None for a training motion

    def take(self, rows: slice | np.ndarray, fps_hz: float | None = None) -> Self:
        """Some frames, as they are; `fps_hz` is the rate that they then have [Hz], if another."""
        return replace(
            self,
            motion=self.motion.take(rows, fps_hz),
            valid=self.valid[rows],
            image_numbers=self.image_numbers[rows],
            camera=None if self.camera is None else self.camera.at_rows(rows),
        )


def camera_of(clip: Clip) -> CameraPath:
    """The clip's camera, for callers that can't do without."""
    if clip.camera is None:
        remedy = "Give a clip that was rendered or reconstructed"
        raise BadMotionFile(f"clip {clip.id} has no camera. {remedy}")
    return clip.camera


def load_camera_clip(path: Path) -> Clip:
    """A clip before its camera, with that; BadMotionFile for another."""
    clip = load_clip(path)
    if clip.motion.frame != "camera" or clip.camera is None:
        what = "no camera-frame motion with intrinsics"
        raise BadMotionFile(f"{path}: {what}. Give a clip as in bodies/ of `gmrdata video`")
    return clip


def clip_on_body(clip: Clip, body: BodyModel) -> Clip:
    """A clip with as many shape coefficients as its body has, see `on_body`."""
    return replace(clip, motion=on_body(clip.motion, body))


def rows_of_numbers(numbers: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows (T,) of wanted image numbers (T,) among those of N rows (N,); -1 where nowhere."""
    row_of_number = {int(number): row for row, number in enumerate(numbers) if number >= 0}
    return np.array([row_of_number.get(int(n), -1) for n in wanted], dtype=np.int64)


def save_clip(path: str | Path, clip: Clip, rest_pelvis_m: np.ndarray) -> None:
    """Write a clip as an .npz with AMASS's keys, camera keys beside them, and no pickled objects.

    AMASS's `trans` is not the pelvis: pelvis = trans + J0.  It is converted here and back in
    `load_clip`, and J0 travels in the file, so no body model is needed to read it.
    `rest_pelvis_m` (3,) is J0 of the clip's body and shape, rest frame [m].  BadMotionFile for
    arrays that do not fit, and for matrices that are no rotations; rows of NaN are kept.
    """
    path, motion = Path(path), clip.motion
    require_local(motion)
    arrays: dict[str, ArrayLike] = {
        "format": CLIP_FORMAT,
        "poses": _rotvecs(path, motion.rotmats).reshape(motion.n_frames, 72),
        "trans": np.asarray(motion.pelvis_m - rest_pelvis_m, dtype=np.float64),
        "betas": np.asarray(motion.shape, dtype=np.float64),
        "gender": motion.gender,
        "mocap_framerate": float(motion.fps_hz),
        "rest_pelvis_m": np.asarray(rest_pelvis_m, dtype=np.float64),
        "body": motion.body,
        "frame": motion.frame,
        "source": motion.source,
        "id": clip.id,
        "valid": clip.valid,
        "image_numbers": clip.image_numbers,
    }
    if clip.camera is not None:
        arrays |= {
            "camera_intrinsics_px": clip.camera.intrinsics_px,
            "camera_size_px": np.array([clip.camera.width_px, clip.camera.height_px]),
            "world_from_cam": clip.camera.world_from_cam,
            "has_camera": clip.camera.has_camera,
        }
    _check(path, {key: np.asarray(value) for key, value in arrays.items()})
    write_npz(path, arrays)


def load_clip(path: str | Path) -> Clip:
    """Read a clip that `save_clip` wrote; BadMotionFile where the file is not a whole such clip."""
    path = Path(path)
    arrays = read_npz(path)
    _check(path, arrays)
    rotmats = rotmats_from_rotvecs(arrays["poses"].reshape(-1, 24, 3))
    motion = Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=arrays["trans"] + arrays["rest_pelvis_m"],
        shape=arrays["betas"],
        fps_hz=float(arrays["mocap_framerate"]),
        body=str(arrays["body"]),
        gender=str(arrays["gender"]),
        frame="camera" if str(arrays["frame"]) == "camera" else "world",
        source=str(arrays["source"]),
    )
    camera = None
    if "world_from_cam" in arrays:
        intrinsics_px, size_px, world_from_cam, known = (arrays[key] for key in _CAMERA_SHAPES)
        width_px, height_px = map(int, size_px)
        camera = CameraPath(intrinsics_px, width_px, height_px, world_from_cam, known)
    return Clip(str(arrays["id"]), motion, arrays["valid"], arrays["image_numbers"], camera)


def _check(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Check that all arrays of a clip are there and fit together."""
    shapes = {**_SHAPES, **(_CAMERA_SHAPES if arrays.keys() & _CAMERA_SHAPES.keys() else {})}
    try:
        require_tag(path, arrays.get("format"), CLIP_FORMAT)
        check_shapes(path, arrays, shapes)
    except BadRecord as error:
        raise BadMotionFile(f"{error}") from None
    if not len(arrays["poses"]):
        raise BadMotionFile(f"{path}: the clip has no frames")
    if str(arrays["frame"]) not in ("world", "camera"):
        raise BadMotionFile(f"{path}: frame is {str(arrays['frame'])!r}, not 'world' or 'camera'")
    if not (np.isfinite(arrays["mocap_framerate"]) and arrays["mocap_framerate"] > 0):
        raise BadMotionFile(f"{path}: the frame rate is {arrays['mocap_framerate']} Hz")
    if not np.isfinite(arrays["rest_pelvis_m"]).all():
        raise BadMotionFile(f"{path}: rest_pelvis_m holds NaN or infinite numbers")


def _rotvecs(path: Path, rotmats: np.ndarray) -> np.ndarray:
    """Axis-angle of rotation matrices (T, 24, 3, 3); NaN where a frame without a motion has NaN."""
    known = np.isfinite(rotmats).all(axis=(2, 3))
    if not (proper := are_rotations(rotmats[known])).all():
        row, joint = np.argwhere(known)[~proper][0]
        what = f"the matrix of joint {joint} in row {row} is no rotation"
        raise BadMotionFile(f"{path}: {what}. Give it rows of unit length and a determinant of 1")
    rotvecs = np.full(rotmats.shape[:-1], np.nan)
    rotvecs[known] = rotvecs_from_rotmats(rotmats[known])
    return rotvecs


def file_name(clip_id: str) -> str:
    """A clip's id as a name that leads nowhere; ids of manifests stay as they are."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", clip_id).lstrip(".-")[:200] or "clip"


def text_runs(texts: Iterable[str]) -> list[tuple[int, int, str]]:
    """All runs of neighbouring rows with one text: (start, one past the last row, text)."""
    runs, start = [], 0
    for text, group in groupby(texts):
        stop = start + len(list(group))
        runs.append((start, stop, text))
        start = stop
    return runs


def dropped_ranges(reasons: Iterable[str]) -> list[tuple[int, int, str]]:
    """Those of the frames that have a reason."""
    return [run for run in text_runs(reasons) if run[2]]


def texts_of(runs: Iterable[tuple[int, int, str]], n_rows: int) -> list[str]:
    """(n_rows,) the text of each row; empty outside the runs."""
    texts = [""] * n_rows
    for start, stop, text in runs:
        texts[start:stop] = [text] * (stop - start)
    return texts


def first_reasons(reasons: Iterable[str], tests: Iterable[tuple[Iterable[bool], str]]) -> list[str]:
    """(N,) why each row can't be used: its own reason, or that of the first test (N,) it fails."""
    why = list(reasons)
    for passed, reason in tests:
        why = [old or ("" if good else reason) for old, good in zip(why, passed, strict=True)]
    return why


CHARACTER_FILE = "character.npz"
T = -1  # stands for the number of frames in `TruthShapes`
TruthShapes = Mapping[str, tuple[str, tuple[int, ...]]]
JOINT_ARRAYS: TruthShapes = {
    "joints_world_m": ("f", (T, N_JOINTS, 3)),
    "joints_camera_m": ("f", (T, N_JOINTS, 3)),
    "joints_px": ("f", (T, N_JOINTS, 2)),
    "in_frame": ("b", (T, N_JOINTS)),
    "visible": ("b", (T, N_JOINTS)),
}
"""The fields of `Joints2d`, as they are called in its file."""


@dataclass(frozen=True, eq=False)
class Joints2d:
    """Joints of T frames, in the order of `gmrdata.values.body.JOINT_NAMES`."""

    world_m: np.ndarray  # (T, 24, 3) places in the world [m]
    camera_m: np.ndarray  # (T, 24, 3) places in the camera's OpenCV axes [m]
    image_px: np.ndarray  # (T, 24, 2) image points; NaN behind the camera
    in_frame: np.ndarray  # (T, 24) bool: in front of the camera and inside the image
    visible: np.ndarray
    """(T, 24) bool: in the frame, and neither the scene nor another part of the body hides it."""


def save_joints(path: Path, joints: Joints2d) -> None:
    """Write `joints.npz`; FORMAT.md describes it."""
    write_npz(path, dict(zip(JOINT_ARRAYS, vars(joints).values(), strict=True)))


def load_joints(path: Path) -> Joints2d:
    """Read a file by `save_joints`; errors as of `read_truth`."""
    return Joints2d(*read_truth(path, JOINT_ARRAYS, frames_of="joints_px"))


def read_truth(path: Path, shapes: TruthShapes, frames_of: str) -> list[np.ndarray]:
    """The arrays of a file of truth, in the order of `shapes`: kind (numpy's letter) and shape.
    The first axis of the array `frames_of` tells the number of frames."""
    arrays = read_npz(path)
    n_frames = len(np.atleast_1d(arrays.get(frames_of, ())))
    for key, (kind, shape) in shapes.items():
        array = arrays.get(key)
        wanted = tuple(n_frames if length == T else length for length in shape)
        if array is None or array.dtype.kind != kind or array.shape != wanted:
            raise BadMotionFile(f"{path}: no array {key!r} of shape {wanted}; render it again")
    return [arrays[key] for key in shapes]


@dataclass(frozen=True, eq=False)
class CharacterRecord:
    """What a render with a character knows beside the truth; T frames."""

    joints_world_m: np.ndarray  # (T, 24, 3) heads of the bones, world [m]; NaN without a bone
    residual_m: np.ndarray  # (T, 24, 3) the same less the body's joints, world axes [m]
    in_frame: np.ndarray  # (T,) bool: the whole character is inside the image
    bones: tuple[str, ...]  # 24 names, empty for a joint without a bone
    scale: float  # by how much the character's file was enlarged


def save_character(path: Path, record: CharacterRecord) -> None:
    """Write `character.npz`; FORMAT.md describes it."""
    write_npz(path, vars(record) | {"bones": np.array(record.bones)})


def load_character(path: Path) -> CharacterRecord:
    """Read a file by `save_character`; errors as of `read_truth`."""
    shapes: TruthShapes = {
        "joints_world_m": ("f", (T, N_JOINTS, 3)),
        "residual_m": ("f", (T, N_JOINTS, 3)),
        "in_frame": ("b", (T,)),
        "bones": ("U", (N_JOINTS,)),
        "scale": ("f", ()),
    }
    joints_m, residual_m, in_frame, bones, scale = read_truth(path, shapes, frames_of="in_frame")
    return CharacterRecord(joints_m, residual_m, in_frame, tuple(bones.tolist()), float(scale))
