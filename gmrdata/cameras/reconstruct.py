"""Stage: cameras up to scale from frames, masks and intrinsics, in a geometry that fits."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras import files
from gmrdata.cameras.frames import Frames, reduced
from gmrdata.cameras.match.tracks import TRACKS_FILE, Tracks, save_tracks
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.errors import BadRecipe, NoReconstruction
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import Config


class _SfmRecipe(Config):
    """What the stage's record holds: the recipe, and the intrinsics that it was given."""

    sfm: SfmConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial_k1: float


def reconstruct(
    frames: FrameSet,
    masks_dir: Path | None,
    lens: Lens,
    out_dir: Path,
    config: SfmConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Find the camera of every frame, up to one similarity of the world.

    Args:
        masks_dir: Masks (255 = dynamic), one per frame; None to use whole frames.  Inside a mask
            only points count that other frames show outside of theirs.
        lens: Kept fixed.  Where it has distortion, by one term, cameras are sought in frames as a
            pinhole would show them.
        out_dir: Folder to make: `cameras.npz`, `points.npz`, `tracks.npz`, `quality.json`.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        NoReconstruction: no camera path can be had from these frames; the message says why.
    """
    _require_usable(lens, frames)
    rows = tuple(tuple(row) for row in lens.matrix_px.tolist())
    recipe = _SfmRecipe(sfm=config, intrinsics_px=rows, radial_k1=lens.radial[0])

    def work(partial: Path) -> None:
        given = Frames(list(frames.paths), masks_dir, lens.matrix_px, lens.size_px)
        try:
            _leave_cameras(partial, given, lens, config)
        except NoReconstruction as error:
            # The reduced frames are gone when somebody reads this.
            raise error.of(frames.folder) from None

    inputs = {"images": frames.folder} | ({} if masks_dir is None else {"masks": masks_dir})
    return run_stage("sfm", out_dir, recipe, inputs, work, run=run)


def _leave_cameras(folder: Path, given: Frames, lens: Lens, config: SfmConfig) -> None:
    """Find the cameras of frames, and write them and what holds them into the stage's folder."""
    from gmrdata.cameras.geometry import solve

    # COLMAP's files lie in the unfinished folder: a killed run leaves nothing elsewhere.
    work_dir = folder / "colmap"
    work_dir.mkdir()
    k1 = lens.radial[0]
    frames = reduced(given, config.max_image_size_px, work_dir / "reduced", k1)
    solution, quality = solve(frames, work_dir, config)
    shutil.rmtree(work_dir)
    cameras = solution.world_from_cam
    path = CameraPath(lens.matrix_px, *lens.size_px, cameras, solution.has_camera)
    filled = np.isin(np.arange(len(cameras)), quality.interpolated)
    found = files.SfmCameras(path, solution.geometry, given.numbers, filled)
    files.save_cameras(folder / files.CAMERAS_FILE, found)
    files.save_points(folder / files.POINTS_FILE, solution.points, solution.track_lengths)
    tracks = _tracks_in(solution.tracks, given, frames)
    if k1:
        tracks = replace(tracks, image_px=lens.seen_px(tracks.image_px))
        quality = quality.model_copy(update={"lens": _whole_distortion(k1, quality.lens)})
    save_tracks(folder / TRACKS_FILE, tracks)
    quality.write(folder / files.QUALITY_FILE)


def known_radial_k1(sfm_dir: Path) -> float:
    """The distortion that a reconstruction was given; 0 where an older version made it."""
    return float(str(StageRecord.of(sfm_dir).config.get("radial_k1", 0.0)))


def _whole_distortion(radial_k1: float, left: files.Distortion | None) -> files.Distortion:
    """The known distortion, and what was found beside it, as one: to the fifth power of r."""
    if left is None:
        return files.Distortion(radial_k1, 0.0, 0.0)
    k2 = left.k2 + 3 * radial_k1 * left.k1
    return files.Distortion(radial_k1 + left.k1, k2, left.explains)


def _tracks_in(tracks: Tracks | None, given: Frames, worked_on: Frames) -> Tracks:
    """Tracks in the pixels of the given frames; without observations where there are none."""
    names = tuple(image.name for image in given.images)
    if tracks is None:
        nothing, n_frames = np.zeros(0, dtype=np.int64), len(names)
        return Tracks(nothing, nothing, np.zeros((0, 2)), np.zeros(n_frames, dtype=bool), names)
    larger = np.divide(given.size_px, worked_on.size_px)
    return replace(tracks, image_px=tracks.image_px * larger, image_names=names)


def _require_usable(lens: Lens, frames: FrameSet) -> None:
    if not np.isfinite(lens.matrix_px).all() or min(lens.focal_px) <= 0:
        raise BadRecipe(f"intrinsics {lens.matrix_px.tolist()}: no lens has these [px]")
    if lens.size_px != frames.size_px or lens.radial[1]:
        what = f"a lens of {lens.size_px} px with distortion {lens.radial}"
        raise BadRecipe(f"{frames.folder}: {what}; give that of these frames, with one term")
