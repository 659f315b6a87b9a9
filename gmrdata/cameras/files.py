"""The files of a reconstruction: cameras up to scale, points, and the figures behind them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np

from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import read_json, read_npz, write_npz

CAMERAS_FILE = "cameras.npz"
POINTS_FILE = "points.npz"
QUALITY_FILE = "quality.json"

Geometry = Literal["full", "rotation_only", "static"]


@dataclass(frozen=True, eq=False)
class SfmCameras:
    """Cameras that structure from motion found."""

    path: CameraPath
    """Translations are in an arbitrary unit; all zero but for "full"."""
    geometry: Geometry
    """"full": six degrees of freedom up to scale.  "rotation_only": the centre is fixed.
    "static": so is the orientation."""
    image_numbers: np.ndarray
    """(T,) int: number in the image's file name for each row."""
    interpolated: np.ndarray
    """(T,) bool: rows whose camera was not found in the image but between its neighbours'."""


def save_cameras(path: Path, cameras: SfmCameras) -> None:
    """Write cameras as an .npz of plain arrays."""
    arrays = {
        "camera_intrinsics_px": cameras.path.intrinsics_px,
        "camera_size_px": np.array([cameras.path.width_px, cameras.path.height_px]),
        "world_from_cam": cameras.path.world_from_cam,
        "has_camera": cameras.path.has_camera,
        "geometry": np.array(cameras.geometry),
        "image_numbers": cameras.image_numbers,
        "interpolated": cameras.interpolated,
    }
    write_npz(path, arrays)


def load_cameras(sfm_dir: Path) -> SfmCameras:
    """Read `cameras.npz` of a reconstruction's folder.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: truncated, or not cameras of this kind.
    """
    path = sfm_dir / CAMERAS_FILE
    arrays = read_npz(path)
    try:
        width_px, height_px = (int(size) for size in arrays["camera_size_px"])
        camera_path = CameraPath(
            arrays["camera_intrinsics_px"],
            width_px,
            height_px,
            arrays["world_from_cam"],
            arrays["has_camera"],
        )
        geometry = str(arrays["geometry"])
        if geometry not in get_args(Geometry):
            raise ValueError(f"unknown geometry {geometry!r}")
        numbers = arrays["image_numbers"]
        # Files of before this mark hold no interpolated cameras.
        interpolated = arrays.get("interpolated", np.zeros(len(numbers), dtype=bool))
        return SfmCameras(camera_path, cast("Geometry", geometry), numbers, interpolated)
    except (KeyError, ValueError) as error:
        raise BadMotionFile(f"{path}: not cameras of gmrdata ({error}); run sfm again") from None


def load_quality(sfm_dir: Path) -> dict[str, Any]:
    """The figures of a reconstruction (`quality.json`)."""
    return dict(read_json(sfm_dir / QUALITY_FILE))


def save_points(path: Path, points: np.ndarray, track_lengths: np.ndarray) -> None:
    """Write background points (N, 3), in the cameras' unit, and the frames that see each (N,)."""
    write_npz(path, {"xyz": points, "track_lengths": track_lengths})


def load_points(sfm_dir: Path) -> np.ndarray:
    """Background points (N, 3) of a reconstruction's folder, in the cameras' unit.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: truncated, or not points.
    """
    path = sfm_dir / POINTS_FILE
    points = read_npz(path).get("xyz")
    if points is None or points.ndim != 2 or points.shape[1] != 3:
        raise BadMotionFile(f"{path}: not points of gmrdata; run sfm again")
    return points
