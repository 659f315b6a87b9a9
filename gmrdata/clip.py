"""Clip: what the manifest lists, the trainer trains on and the evaluator scores; and its file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.errors import BadMotionFile, MissingInput
from gmrdata.geometry.camera import CameraPath
from gmrdata.motion.motion import Motion
from gmrdata.store import atomic_path


@dataclass(frozen=True, eq=False)
class Clip:
    """One person in one take, over T frames."""

    id: str
    """Unique within a manifest; letters, digits, `_`, `-` and `.`."""
    motion: Motion
    """The person."""
    valid: np.ndarray
    """(T,) bool: frames whose motion can be used."""
    image_numbers: np.ndarray
    """(T,) int: number in the image's file name for each row; -1 where the clip has no image."""
    camera: CameraPath | None
    """The camera, or None for a training motion."""


def camera_of(clip: Clip) -> CameraPath:
    """The clip's camera, for callers that can't do without.

    Raises:
        BadMotionFile: the clip has none.
    """
    if clip.camera is None:
        raise BadMotionFile(
            f"clip {clip.id} has no camera. Give a clip that was rendered or reconstructed"
        )
    return clip.camera


def save_clip(path: Path, clip: Clip, rest_pelvis_m: np.ndarray) -> None:
    """Write a clip as an .npz with AMASS's keys, camera keys beside them, and no pickled objects.

    AMASS's `trans` is not the pelvis: pelvis = trans + J0.  It is converted here and back in
    `load_clip`, and J0 travels in the file, so no body model is needed to read it.

    Args:
        path: The file.
        clip: The clip.
        rest_pelvis_m: (3,) J0 of the clip's body and shape, rest frame [m].
    """
    motion = clip.motion
    rotmats = np.concatenate([motion.root_rotmats[:, None], motion.local_rotmats], axis=1)
    arrays: dict[str, Any] = {
        "poses": Rotation.from_matrix(rotmats.reshape(-1, 3, 3))
        .as_rotvec()
        .reshape(motion.n_frames, 72),
        "trans": motion.pelvis_m - rest_pelvis_m,
        "betas": motion.shape,
        "gender": motion.gender,
        "mocap_framerate": motion.fps_hz,
        "rest_pelvis_m": rest_pelvis_m,
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
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)


def load_clip(path: Path) -> Clip:
    """Read a clip that `save_clip` wrote.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: the file is truncated, lacks a key, or its arrays do not fit together.
    """
    arrays = read_npz(path)
    try:
        n_frames = len(arrays["poses"])
        rotmats = (
            Rotation.from_rotvec(arrays["poses"].reshape(-1, 3))
            .as_matrix()
            .reshape(n_frames, 24, 3, 3)
        )
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
            width_px, height_px = (int(size) for size in arrays["camera_size_px"])
            camera = CameraPath(
                arrays["camera_intrinsics_px"],
                width_px,
                height_px,
                arrays["world_from_cam"],
                arrays["has_camera"],
            )
        return Clip(str(arrays["id"]), motion, arrays["valid"], arrays["image_numbers"], camera)
    except KeyError as missing:
        raise BadMotionFile(f"{path}: not a clip file, it has no array {missing}") from None
    except ValueError as error:
        raise BadMotionFile(f"{path}: arrays do not fit together: {error}") from None


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an .npz, without unpickling anything.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: not an .npz, truncated, or with pickled objects inside.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except (BadZipFile, ValueError, OSError, EOFError, AttributeError) as error:
        raise BadMotionFile(f"{path}: not a readable .npz of plain arrays ({error})") from None
