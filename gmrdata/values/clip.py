"""Clip: what the manifest lists, the trainer trains on and the evaluator scores; and its file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gmrdata.values.bodies import on_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile, BadRecord
from gmrdata.values.files import read_npz, write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.records import ArrayShapes, check_shapes, require_tag

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


def camera_of(clip: Clip) -> CameraPath:
    """The clip's camera, for callers that can't do without."""
    if clip.camera is None:
        remedy = "Give a clip that was rendered or reconstructed"
        raise BadMotionFile(f"clip {clip.id} has no camera. {remedy}")
    return clip.camera


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
    `rest_pelvis_m` (3,) is J0 of the clip's body and shape, rest frame [m].
    """
    motion = clip.motion
    arrays: dict[str, ArrayLike] = {
        "format": CLIP_FORMAT,
        "poses": _rotvecs(motion.rotmats).reshape(motion.n_frames, 72),
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
    path = Path(path)
    _check(path, {key: np.asarray(value) for key, value in arrays.items()})
    write_npz(path, arrays)


def load_clip(path: str | Path) -> Clip:
    """Read a clip that `save_clip` wrote; BadMotionFile where the file is not a whole such clip."""
    from scipy.spatial.transform import Rotation  # slow to load; who starts Blender needs none

    path = Path(path)
    arrays = read_npz(path)
    _check(path, arrays)
    rotmats = Rotation.from_rotvec(arrays["poses"].reshape(-1, 3)).as_matrix()
    rotmats = rotmats.reshape(-1, 24, 3, 3)
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


def _rotvecs(rotmats: np.ndarray) -> np.ndarray:
    """Axis-angle of rotation matrices (..., 3, 3); NaN where a frame without a motion has NaN."""
    from scipy.spatial.transform import Rotation

    flat = rotmats.reshape(-1, 3, 3)
    known = np.isfinite(flat).all(axis=(1, 2))
    rotvecs = np.full((len(flat), 3), np.nan)
    if known.any():
        rotvecs[known] = Rotation.from_matrix(flat[known]).as_rotvec()
    return rotvecs.reshape(*rotmats.shape[:-1])
