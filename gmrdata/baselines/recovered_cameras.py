"""Cameras that structure from motion found for clips, in metres, on the clips' rows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.baselines.still_camera import LEVEL_FROM_CAM
from gmrdata.clip import Clip
from gmrdata.errors import BadMotionFile, BadRecord, MissingInput
from gmrdata.geometry.transforms import invert
from gmrdata.pseudogt.compose import metric_cameras
from gmrdata.sfm.cameras import CAMERAS_FILE, QUALITY_FILE, SfmCameras, load_cameras
from gmrdata.store import read_json


@dataclass(frozen=True)
class CameraFiles:
    """Where one clip's recovered cameras lie."""

    cameras_path: Path
    """`cameras.npz` of a reconstruction."""
    quality_path: Path | None
    """`quality.json` of the pseudo ground truth, which states the scale; None where there is
    none."""

    def inputs(self, clip_id: str) -> dict[str, Path]:
        """The files by role, for a stage's record."""
        found = {f"cameras_{clip_id}": self.cameras_path}
        return found | (
            {} if self.quality_path is None else {f"scale_{clip_id}": self.quality_path}
        )


def find_cameras(folder: Path, clip_id: str) -> CameraFiles:
    """The cameras of a clip: `folder/<clip id>/` as `gmrdata sfm` made it, or `cameras.npz` there.

    Raises:
        MissingInput: neither is there.
    """
    made = folder / clip_id
    for path in (made / "sfm" / CAMERAS_FILE, made / CAMERAS_FILE):
        if path.is_file():
            quality_path = made / "pseudo_gt" / QUALITY_FILE
            return CameraFiles(path, quality_path if quality_path.is_file() else None)
    raise MissingInput(
        f"{made}: no sfm/{CAMERAS_FILE} and no {CAMERAS_FILE} there. Run gmrdata sfm with"
        f" --out {made}, or leave the clip out of the manifest"
    )


def recovered_cameras(clip: Clip, files: CameraFiles) -> tuple[np.ndarray, np.ndarray]:
    """Recovered cameras of a clip's rows, matched by the images' numbers.

    The world is that of the first camera, held level.

    Returns:
        world_from_cam (T, 4, 4) in metres, NaN where there is none, and (T,) bool rows that have
        one.

    Raises:
        MissingInput: a file is not there.
        BadMotionFile: the cameras are of other images, or up to a scale that nobody states.
        BadRecord: the record of the scale is broken.
    """
    cameras = load_cameras(files.cameras_path.parent)
    row_of_number = {int(number): row for row, number in enumerate(cameras.image_numbers)}
    rows = np.array([row_of_number.get(int(number), -1) for number in clip.image_numbers])
    known = (rows >= 0) & cameras.path.has_camera[rows]
    if not known.any():
        raise BadMotionFile(
            f"{files.cameras_path}: has a camera for none of the images of clip {clip.id}. Give"
            " cameras of its own images"
        )
    metric = metric_cameras(cameras.path.world_from_cam, _scale(cameras, files))
    level_from_world = LEVEL_FROM_CAM @ invert(metric[rows[known][0]])
    world_from_cam = np.full((len(rows), 4, 4), np.nan)
    world_from_cam[known] = level_from_world @ metric[rows[known]]
    return world_from_cam, known


def _scale(cameras: SfmCameras, files: CameraFiles) -> float:
    """Metres per unit; 1 for cameras that do not travel, which need none."""
    if cameras.geometry != "full":
        return 1.0
    if files.quality_path is None:
        raise BadMotionFile(
            f"{files.cameras_path}: cameras up to scale, and no pseudo_gt/{QUALITY_FILE} states it."
            " Give the output folder of gmrdata sfm"
        )
    record = read_json(files.quality_path)
    scale = record.get("scale") if isinstance(record, dict) else None
    if not isinstance(scale, int | float) or isinstance(scale, bool) or not scale > 0:
        raise BadRecord(f"{files.quality_path}: states no scale above zero. Run gmrdata sfm again")
    return float(scale)
