"""Stage: world-frame pseudo ground truth from recovered cameras and a camera-frame body."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, load_clip, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadMotionFile, NoReconstruction
from gmrdata.geometry import transforms
from gmrdata.geometry.camera import CameraPath
from gmrdata.motion.motion import Motion
from gmrdata.pseudogt.compose import metric_cameras, world_motion
from gmrdata.pseudogt.level import level_from_world
from gmrdata.sfm.cameras import (
    QUALITY_FILE,
    Geometry,
    SfmCameras,
    load_cameras,
    load_points,
    load_quality,
)
from gmrdata.sfm.cues import ScaleConfig
from gmrdata.sfm.feet import SOLE_POINTS, foot_points_m, standing
from gmrdata.sfm.scale import ScaleEstimate, estimate_scale
from gmrdata.store import run_stage, write_json

CLIP_FILE = "clip.npz"


class PseudoGtConfig(Config):
    """Metric world poses from cameras up to scale.  Nothing is smoothed."""

    scale: ScaleConfig = Field(default=ScaleConfig())
    """How metric scale is found."""


def make_pseudo_gt(
    sfm_dir: Path,
    camera_clip_path: Path,
    body_path: Path,
    out_dir: Path,
    config: PseudoGtConfig,
    *,
    redo: bool = False,
) -> Path:
    """Compose camera-frame poses with recovered cameras (eqs. 6-8) into a metric, level world.

    Frames without a camera keep an interpolated pose, so that every array is finite, and are not
    valid; their `world_from_cam` is NaN.

    Args:
        sfm_dir: Folder that `gmrdata.sfm.reconstruct.reconstruct` made.
        camera_clip_path: Clip with the person in the camera frame, and image numbers.
        body_path: The clip's body model.
        out_dir: Folder to make: `clip.npz` and `quality.json`.
        config: The recipe.
        redo: Replace a folder that another recipe made.

    Returns:
        `out_dir`.

    Raises:
        BadMotionFile: the clip is not in the camera frame.
        NoReconstruction: no frame of the clip has a camera, or no scale can be found.
    """

    def work(partial: Path) -> None:
        from gmrdata.body.load import load_body

        camera_clip = load_clip(camera_clip_path)
        if camera_clip.motion.frame != "camera":
            raise BadMotionFile(f"{camera_clip_path}: the motion is not in the camera frame")
        cameras = load_cameras(sfm_dir)
        body = load_body(str(body_path))
        path = _cameras_of_rows(cameras, camera_clip)
        usable = path.has_camera & camera_clip.valid
        if usable.sum() < 2:
            raise NoReconstruction(f"{camera_clip.id}: {usable.sum()} frames have pose and camera")
        clip, estimate = compose_clip(
            camera_clip, path, cameras.geometry, load_points(sfm_dir), body, config
        )
        rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
        save_clip(partial / CLIP_FILE, clip, rest_pelvis_m)
        write_json(partial / QUALITY_FILE, _quality(clip, estimate, load_quality(sfm_dir)))

    inputs = {"sfm": sfm_dir, "clip": camera_clip_path, "body": body_path}
    return run_stage("pseudo_gt", out_dir, config, inputs, work, redo=redo)


def compose_clip(
    camera_clip: Clip,
    path: CameraPath,
    geometry: Geometry,
    points: np.ndarray,
    body: BodyModel,
    config: PseudoGtConfig,
) -> tuple[Clip, ScaleEstimate]:
    """The clip in a metric, level world, and the scale that made it metric.

    Args:
        camera_clip: T frames with the person in the camera frame.
        path: Cameras of the same T frames, up to scale.
        geometry: What the reconstruction found the camera to do.
        points: (N, 3) its background points, in the cameras' unit.
        body: The clip's body.
        config: The recipe.
    """
    usable = path.has_camera & camera_clip.valid
    known = replace(path, world_from_cam=_blanked(path.world_from_cam, usable))
    estimate = estimate_scale(
        known, camera_clip.motion, body, geometry, config.scale, points=points
    )
    scale = 1.0 if estimate.scale is None else estimate.scale
    metric = metric_cameras(path.world_from_cam, scale)
    filled = fill_gaps(metric, path.has_camera)
    motion = world_motion(camera_clip.motion, filled)
    level = _level(motion, filled, usable, body, config)
    levelled = world_motion(camera_clip.motion, level @ filled)
    camera = replace(path, world_from_cam=_blanked(level @ filled, path.has_camera))
    return Clip(camera_clip.id, levelled, usable, camera_clip.image_numbers, camera), estimate


def fill_gaps(world_from_cam: np.ndarray, has_camera: np.ndarray) -> np.ndarray:
    """Cameras (T, 4, 4) with gaps filled by slerp and linear interpolation; ends are held.

    At least one frame must have a camera.
    """
    rows = np.flatnonzero(has_camera)
    if len(rows) == 1:
        return np.tile(world_from_cam[rows[0]], (len(has_camera), 1, 1))
    at = np.clip(np.arange(len(has_camera)), rows[0], rows[-1])
    known = world_from_cam[rows]
    rotmats = Slerp(rows, Rotation.from_matrix(known[:, :3, :3]))(at).as_matrix()
    centres = np.stack([np.interp(at, rows, known[:, axis, 3]) for axis in range(3)], axis=1)
    filled = transforms.rigid(rotmats, centres)
    filled[rows] = known
    return filled


def _cameras_of_rows(cameras: SfmCameras, clip: Clip) -> CameraPath:
    """The camera of each row of the clip, found by the image's number."""
    row_of_number = {int(number): row for row, number in enumerate(cameras.image_numbers)}
    n = clip.motion.n_frames
    world_from_cam, has_camera = np.full((n, 4, 4), np.nan), np.zeros(n, dtype=bool)
    for row, number in enumerate(clip.image_numbers):
        source = row_of_number.get(int(number))
        if source is not None and cameras.path.has_camera[source]:
            world_from_cam[row] = cameras.path.world_from_cam[source]
            has_camera[row] = True
    return replace(cameras.path, world_from_cam=world_from_cam, has_camera=has_camera)


def _blanked(world_from_cam: np.ndarray, keep: np.ndarray) -> np.ndarray:
    return np.where(keep[:, None, None], world_from_cam, np.nan)


def _level(
    motion: Motion,
    world_from_cam: np.ndarray,
    usable: np.ndarray,
    body: BodyModel,
    config: PseudoGtConfig,
) -> np.ndarray:
    soles_m = foot_points_m(body, motion)[:, :, SOLE_POINTS]
    soles_m = np.where(usable[:, None, None, None], soles_m, np.nan)
    slip_m = config.scale.slip_floor_m + config.scale.slip_m_per_s / motion.fps_hz
    planted_m = soles_m[standing(soles_m, slip_m)]
    first = int(np.flatnonzero(usable)[0])
    return level_from_world(
        motion.root_rotmats[usable],
        motion.pelvis_m[usable],
        planted_m,
        world_from_cam[first, :3, 2],
    )


def _quality(clip: Clip, estimate: ScaleEstimate, sfm_quality: dict[str, Any]) -> dict[str, Any]:
    """The reconstruction's figures, and those of the scale, as plain JSON."""
    return sfm_quality | {
        "clip_frames": clip.motion.n_frames,
        "valid_frames": int(clip.valid.sum()),
        "scale": _figure(estimate.scale),
        "scale_sigma": _figure(estimate.sigma),
        "scale_disagreement": _figure(estimate.disagreement),
        "scale_cues": [
            {key: _figure(v) if isinstance(v, float) else v for key, v in asdict(cue).items()}
            for cue in estimate.cues
        ],
    }


def _figure(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")
