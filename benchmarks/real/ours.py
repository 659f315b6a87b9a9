"""Our camera stage on a sequence, and the verdict on its cameras."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from real.sequences import RealSequence

from gmrdata.cameras.files import CamerasQuality, load_cameras, load_points, load_quality
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import read_frames
from gmrdata.stage.store import stage_seconds
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.clip import Clip
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import invert
from gmrdata.world.judge import SolvedCameras, judge
from gmrdata.world.recipe import Doubts, VerdictConfig


@dataclass(frozen=True, eq=False)
class Solved:
    """What the stage found, and what is said of it."""

    world_from_cam: np.ndarray
    """(T, 4, 4); NaN where there is no camera."""
    kept: np.ndarray
    """(T,) bool: frames that the verdict keeps."""
    accepted: bool
    reasons: tuple[str, ...]
    seconds: float | None
    """Time of the stage, without masks; None where it found nothing."""
    quality: CamerasQuality | None
    distance: float | None
    """Median distance of the background [unit of the cameras]."""


def solve(given: RealSequence, out_dir: Path, seed: int) -> Solved:
    """Run the stage and judge its cameras."""
    n = len(given.takes)
    config = SfmConfig(seed=seed)
    try:
        frames = read_frames(given.images_dir)
        lens = Lens.of_matrix(given.intrinsics_px, frames.size_px)
        reconstruct(frames, given.masks_dir, lens, out_dir, config)
    except NoReconstruction as error:
        nothing, none = np.full((n, 4, 4), np.nan), np.zeros(n, dtype=bool)
        return Solved(nothing, none, False, (error.why,), None, None, None)
    cameras, quality = load_cameras(out_dir).path, load_quality(out_dir)
    solved = SolvedCameras(cameras, "full", np.zeros((0, 3)), quality, np.arange(n))
    no_doubts = Doubts(frames=(n * ("",),), sequence=())
    thresholds = VerdictConfig(max_speed_m_per_s=given.max_speed_m_per_s)
    verdict = judge(_clip(cameras, given), solved, thresholds, no_doubts)
    return Solved(
        world_from_cam=cameras.world_from_cam,
        kept=verdict.kept & cameras.has_camera,
        accepted=verdict.accepted,
        reasons=verdict.reasons,
        seconds=stage_seconds(out_dir),
        quality=quality,
        distance=_distance(cameras, load_points(out_dir)),
    )


def _clip(cameras: CameraPath, given: RealSequence) -> Clip:
    """The cameras with a body that stands still: the verdict asks for one.

    Metres, which else come from the person, are those of the true path's spread.
    """
    n, factor = cameras.n_frames, _spread_ratio(cameras, given)
    world_from_cam = cameras.world_from_cam.copy()
    world_from_cam[:, :3, 3] *= factor
    motion = Motion(
        local_rotmats=np.tile(np.eye(3), (n, 23, 1, 1)),
        root_rotmats=np.tile(np.eye(3), (n, 1, 1)),
        pelvis_m=np.zeros((n, 3)),
        shape=np.zeros(10),
        fps_hz=given.fps_hz,
        body="none",
        gender="neutral",
        frame="world",
        source="a benchmark of cameras",
    )
    path = CameraPath(
        cameras.intrinsics_px,
        cameras.width_px,
        cameras.height_px,
        world_from_cam,
        cameras.has_camera,
    )
    return Clip("cameras", motion, np.ones(n, dtype=bool), np.arange(n), path)


def _spread_ratio(cameras: CameraPath, given: RealSequence) -> float:
    """Metres per unit of the cameras; 0, by which nothing is too fast, where that is not known."""
    known = cameras.has_camera & np.isfinite(given.world_from_cam[:, 0, 0])
    if given.still or not known.any() or np.ptp(given.takes):
        return 0.0
    spread = cameras.world_from_cam[known, :3, 3].std(axis=0)
    true_m = given.world_from_cam[known, :3, 3].std(axis=0)
    length = float(np.linalg.norm(spread))
    return float(np.linalg.norm(true_m)) / length if length > 0 else 0.0


def _distance(cameras: CameraPath, points: np.ndarray) -> float | None:
    rows = np.flatnonzero(cameras.has_camera)
    if not len(points) or not len(rows):
        return None
    cam_from_world = invert(cameras.world_from_cam[rows[len(rows) // 2]])
    depths = points @ cam_from_world[2, :3] + cam_from_world[2, 3]
    return float(np.median(np.abs(depths)))
