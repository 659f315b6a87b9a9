"""Stage: cameras up to scale from frames, masks and intrinsics, in a geometry that fits."""

import shutil
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras import files
from gmrdata.cameras.frames import Frames, reduced
from gmrdata.cameras.match.tracks import TRACKS_FILE, Tracks, save_tracks
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.read.frames import read_frames
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadRecipe, NoReconstruction
from gmrdata.values.lens import bent
from gmrdata.values.records import Config


class _SfmRecipe(Config):
    """What the stage's record holds: the recipe, and the intrinsics that it was given."""

    sfm: SfmConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial_k1: float


def reconstruct(
    images_dir: Path,
    masks_dir: Path | None,
    intrinsics_px: np.ndarray,
    out_dir: Path,
    config: SfmConfig,
    *,
    radial_k1: float = 0.0,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Find the camera of every frame, up to one similarity of the world.

    Args:
        images_dir: Frames with consecutive numbers, but for those left out, all of one size.
        masks_dir: Masks (255 = dynamic), one per frame; None to use whole frames.  Inside a mask
            only points count that other frames show outside of theirs.
        intrinsics_px: (3, 3) calibration matrix, without skew, kept fixed [px].
        out_dir: Folder to make: `cameras.npz`, `points.npz`, `tracks.npz`, `quality.json`.
        radial_k1: Known distortion: a point at r, in units of the focal length, is seen at
            r + k1 r^3.  Cameras are sought in frames as a pinhole would show them.
        left_out: Numbers of images that are known to be unusable and get no camera and no row.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        NoReconstruction: no camera path can be had from these frames; the message says why.
    """
    matrix = _checked(intrinsics_px)
    rows = tuple(tuple(row) for row in matrix.tolist())
    recipe = _SfmRecipe(sfm=config, intrinsics_px=rows, radial_k1=radial_k1)

    def work(partial: Path) -> None:
        read = read_frames(images_dir, left_out)
        given = Frames(list(read.paths), masks_dir, matrix, read.size_px)
        try:
            _leave_cameras(partial, given, radial_k1, config)
        except NoReconstruction as error:
            # The reduced frames are gone when somebody reads this.
            raise error.of(images_dir) from None

    inputs = {"images": images_dir} | ({} if masks_dir is None else {"masks": masks_dir})
    return run_stage("sfm", out_dir, recipe, inputs, work, run=run)


def _leave_cameras(folder: Path, given: Frames, radial_k1: float, config: SfmConfig) -> None:
    """Find the cameras of frames, and write them and what holds them into the stage's folder."""
    from gmrdata.cameras.geometry import solve

    # COLMAP's files lie in the unfinished folder: a killed run leaves nothing elsewhere.
    work_dir = folder / "colmap"
    work_dir.mkdir()
    frames = reduced(given, config.max_image_size_px, work_dir / "reduced", radial_k1)
    solution, quality = solve(frames, work_dir, config)
    shutil.rmtree(work_dir)
    cameras, matrix = solution.world_from_cam, given.intrinsics_px
    path = CameraPath(matrix, *given.size_px, cameras, solution.has_camera)
    filled = np.isin(np.arange(len(cameras)), quality.interpolated)
    found = files.SfmCameras(path, solution.geometry, given.numbers, filled)
    files.save_cameras(folder / files.CAMERAS_FILE, found)
    files.save_points(folder / files.POINTS_FILE, solution.points, solution.track_lengths)
    tracks = _tracks_in(solution.tracks, given, frames)
    if radial_k1:
        tracks = replace(tracks, image_px=_seen_px(tracks.image_px, matrix, radial_k1))
        quality = quality.model_copy(update={"lens": _whole_lens(radial_k1, quality.lens)})
    save_tracks(folder / TRACKS_FILE, tracks)
    quality.write(folder / files.QUALITY_FILE)


def known_radial_k1(sfm_dir: Path) -> float:
    """The distortion that a reconstruction was given; 0 where an older version made it."""
    return float(str(StageRecord.of(sfm_dir).config.get("radial_k1", 0.0)))


def _seen_px(pinhole_px: np.ndarray, intrinsics_px: np.ndarray, radial_k1: float) -> np.ndarray:
    """Where the given frames show what was found in those without distortion, (M, 2) [px]."""
    focal_px, centre_px = np.diag(intrinsics_px)[:2], intrinsics_px[:2, 2]
    return np.asarray(bent((pinhole_px - centre_px) / focal_px, radial_k1) * focal_px + centre_px)


def _whole_lens(radial_k1: float, left: files.Lens | None) -> files.Lens:
    """The known distortion, and what was found beside it, as one: to the fifth power of r."""
    if left is None:
        return files.Lens(radial_k1, 0.0, 0.0)
    k2 = left.k2 + 3 * radial_k1 * left.k1
    return files.Lens(radial_k1 + left.k1, k2, left.explains)


def _tracks_in(tracks: Tracks | None, given: Frames, worked_on: Frames) -> Tracks:
    """Tracks in the pixels of the given frames; without observations where there are none."""
    names = tuple(image.name for image in given.images)
    if tracks is None:
        nothing, n_frames = np.zeros(0, dtype=np.int64), len(names)
        return Tracks(nothing, nothing, np.zeros((0, 2)), np.zeros(n_frames, dtype=bool), names)
    larger = np.divide(given.size_px, worked_on.size_px)
    return replace(tracks, image_px=tracks.image_px * larger, image_names=names)


def _checked(intrinsics_px: np.ndarray) -> np.ndarray:
    matrix = np.asarray(intrinsics_px, dtype=np.float64)
    if matrix.shape == (3, 3) and np.isfinite(matrix).all():
        fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        if min(fx, fy) > 0 and np.array_equal(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
            return matrix
    raise BadRecipe(
        f"intrinsics {matrix.tolist()}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]"
    )
