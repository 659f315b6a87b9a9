"""Stage: cameras up to scale from frames, masks and intrinsics, in a geometry that fits."""

import shutil
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras.evidence import explains_better, is_bent, weigh
from gmrdata.cameras.files import (
    CAMERAS_FILE,
    POINTS_FILE,
    QUALITY_FILE,
    CamerasQuality,
    Evidence,
    SfmCameras,
    save_cameras,
    save_points,
)
from gmrdata.cameras.frames import Frames, Timeline, cuts_in_words, reduced
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.solution import Solution, fill_short_gaps, quality_of, turning_solution
from gmrdata.read.frames import check_images, list_images
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadRecipe, NoReconstruction
from gmrdata.values.records import Config


class _SfmRecipe(Config):
    """What the stage's record holds: the recipe, and the intrinsics that it was given."""

    sfm: SfmConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]


def reconstruct(
    images_dir: Path,
    masks_dir: Path | None,
    intrinsics_px: np.ndarray,
    out_dir: Path,
    config: SfmConfig,
    *,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Find the camera of every frame, up to one similarity of the world.

    Args:
        images_dir: Frames with consecutive numbers, but for those left out, all of one size.
        masks_dir: Masks (255 = dynamic, not used), one per frame; None to use whole frames.
        intrinsics_px: (3, 3) calibration matrix, without skew, kept fixed [px].
        out_dir: Folder to make: `cameras.npz`, `points.npz`, `quality.json`.
        left_out: Numbers of images that are known to be unusable and get no camera and no row.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        BadRecipe: the intrinsics are not a calibration matrix.
        NoReconstruction: no camera path can be had from these frames; the message says why.
    """
    matrix = _checked(intrinsics_px)
    recipe = _SfmRecipe(sfm=config, intrinsics_px=tuple(tuple(row) for row in matrix.tolist()))

    def work(partial: Path) -> None:
        images = list_images(images_dir, left_out)
        size_px = check_images(images)
        # COLMAP's files lie in the unfinished folder: a killed run leaves nothing elsewhere.
        work_dir = partial / "colmap"
        work_dir.mkdir()
        given = Frames(images, masks_dir, matrix, size_px)
        frames = reduced(given, config.max_image_size_px, work_dir / "reduced")
        try:
            solution, quality = _solve(work_dir, frames, config)
        except NoReconstruction as error:
            # The reduced frames are gone when somebody reads this.
            said = str(error).replace(str(frames.images[0].parent), str(images_dir))
            raise NoReconstruction(said) from None
        shutil.rmtree(work_dir)
        path = CameraPath(matrix, *size_px, solution.world_from_cam, solution.has_camera)
        cameras = SfmCameras(path, solution.geometry, given.numbers, solution.interpolated)
        save_cameras(partial / CAMERAS_FILE, cameras)
        save_points(partial / POINTS_FILE, solution.points, solution.track_lengths)
        quality.write(partial / QUALITY_FILE)

    inputs = {"images": images_dir} | ({} if masks_dir is None else {"masks": masks_dir})
    return run_stage("sfm", out_dir, recipe, inputs, work, run=run)


def _checked(intrinsics_px: np.ndarray) -> np.ndarray:
    matrix = np.asarray(intrinsics_px, dtype=np.float64)
    if matrix.shape == (3, 3) and np.isfinite(matrix).all():
        fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        if min(fx, fy) > 0 and np.array_equal(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
            return matrix
    raise BadRecipe(
        f"intrinsics {matrix.tolist()}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]"
    )


def _solve(work_dir: Path, frames: Frames, config: SfmConfig) -> tuple[Solution, CamerasQuality]:
    """Choose keyframes, solve, fill short gaps; a cut is named where nothing can be solved."""
    from gmrdata.cameras.keyframes import choose_keyframes

    keys = choose_keyframes(frames, config)
    timeline = Timeline(frames.numbers, keys.cuts)
    try:
        solution, evidence, bent = _solve_keyframes(keys.rows, timeline, work_dir, frames, config)
    except NoReconstruction as error:
        raise NoReconstruction(f"{error}{cuts_in_words(keys.cuts)}") from None
    filled, marks = fill_short_gaps(solution.world_from_cam, timeline, config.max_gap_frames)
    solution = replace(solution, world_from_cam=filled, interpolated=marks)
    return solution, quality_of(
        solution, evidence, keys, bent_model_set_aside=bent, size_px=frames.size_px
    )


def _solve_keyframes(
    key_rows: np.ndarray, timeline: Timeline, work_dir: Path, frames: Frames, config: SfmConfig
) -> tuple[Solution, Evidence, bool]:
    """Solve keyframes, as a pure rotation where that does, then all frames.

    Also returned: the evidence for the geometry, and whether a bent model was set aside.
    """
    from gmrdata.cameras.focal import turning_focal
    from gmrdata.cameras.keyframes import with_frames_between
    from gmrdata.cameras.mapping import map_frames, place_between
    from gmrdata.cameras.matches import Matches, match_frames
    from gmrdata.cameras.rotation_only import RotationOnly, solve_rotation_only
    from gmrdata.cameras.smoothing import refine_mapped, refine_turning

    keys = replace(frames, images=[frames.images[row] for row in key_rows])
    intrinsics_px = frames.intrinsics_px
    matches = match_frames(keys, work_dir, config)

    def turn(of: Matches) -> RotationOnly:
        rng = np.random.default_rng(config.seed)
        return solve_rotation_only(of, intrinsics_px, config.rotation_only_inlier_px, rng)

    turning = turn(matches)
    evidence = weigh(turning, matches, config)
    turns, unsure = evidence.verdict == "rotation_only", evidence.verdict == "either"
    mapped = None if turns else map_frames(keys, matches, work_dir, config)
    bent = mapped is not None and is_bent(mapped, turning, config)
    everything = with_frames_between(matches, key_rows, frames, config)
    if turns or bent or (unsure and not explains_better(mapped, turning, config)):
        focal = turning_focal(turning, matches, intrinsics_px)
        refined, smoothing = refine_turning(turn(everything), timeline, config)
        focal_px = float(intrinsics_px[0, 0])
        return turning_solution(refined, smoothing, focal, focal_px, config), evidence, bent
    if mapped is None or mapped.has_camera.sum() < config.min_frames_registered:
        raise NoReconstruction(
            f"{frames.images[0].parent}: {len(matches.pairs)} pairs of frames match, but no mapper "
            "could build a model; the parallax may be too small, the intrinsics wrong or the "
            "background moving"
        )
    placed = place_between(mapped, key_rows, everything, intrinsics_px)
    return refine_mapped(placed, everything, intrinsics_px, timeline, config), evidence, bent
