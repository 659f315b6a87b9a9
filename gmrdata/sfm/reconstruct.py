"""Stage: cameras up to scale from frames, masks and intrinsics, in a geometry that fits."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.config import Config
from gmrdata.errors import BadRecipe, NoReconstruction
from gmrdata.frames import check_images, image_number, list_images
from gmrdata.geometry import transforms
from gmrdata.geometry.camera import CameraPath
from gmrdata.sfm.cameras import (
    CAMERAS_FILE,
    POINTS_FILE,
    QUALITY_FILE,
    Geometry,
    SfmCameras,
    save_cameras,
    save_points,
)
from gmrdata.sfm.config import SfmConfig
from gmrdata.store import run_stage, write_json

PANORAMIC = ("PANORAMIC", "PLANAR_OR_PANORAMIC")


class _SfmRecipe(Config):
    """What the stage's record holds: the recipe, and the intrinsics that it was given."""

    sfm: SfmConfig
    """The recipe."""
    intrinsics_px: tuple[tuple[float, float, float], ...]
    """Calibration matrix [px]."""


@dataclass(frozen=True, eq=False)
class _Solution:
    """One geometry's answer, ready to be written."""

    geometry: Geometry
    world_from_cam: np.ndarray
    has_camera: np.ndarray
    points: np.ndarray
    track_lengths: np.ndarray
    quality: dict[str, Any]


def reconstruct(
    images_dir: Path,
    masks_dir: Path | None,
    intrinsics_px: np.ndarray,
    out_dir: Path,
    config: SfmConfig,
    *,
    redo: bool = False,
) -> Path:
    """Find the camera of every frame, up to one similarity of the world.

    Args:
        images_dir: Frames with consecutive numbers, all of one size.
        masks_dir: Masks (255 = dynamic, not used), one per frame; None to use whole frames.
        intrinsics_px: (3, 3) calibration matrix, without skew, kept fixed [px].
        out_dir: Folder to make: `cameras.npz`, `points.npz`, `quality.json`.
        config: The recipe.
        redo: Replace a folder that another recipe made.

    Returns:
        `out_dir`.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        BadRecipe: the intrinsics are not a calibration matrix.
        NoReconstruction: no camera path can be had from these frames; the message says why.
    """
    matrix = _checked(intrinsics_px)
    recipe = _SfmRecipe(sfm=config, intrinsics_px=tuple(tuple(row) for row in matrix.tolist()))

    def work(partial: Path) -> None:
        images = list_images(images_dir)
        size_px = check_images(images)
        solution = _solve(images, masks_dir, matrix, size_px, config)
        numbers = np.array([image_number(image) for image in images])
        path = CameraPath(matrix, *size_px, solution.world_from_cam, solution.has_camera)
        save_cameras(partial / CAMERAS_FILE, SfmCameras(path, solution.geometry, numbers))
        save_points(partial / POINTS_FILE, solution.points, solution.track_lengths)
        write_json(partial / QUALITY_FILE, solution.quality)

    inputs = {"images": images_dir} | ({} if masks_dir is None else {"masks": masks_dir})
    return run_stage("sfm", out_dir, recipe, inputs, work, redo=redo)


def _checked(intrinsics_px: np.ndarray) -> np.ndarray:
    matrix = np.asarray(intrinsics_px, dtype=np.float64)
    expected_zero = [(0, 1), (1, 0), (2, 0), (2, 1)]
    if (
        matrix.shape != (3, 3)
        or not np.isfinite(matrix).all()
        or any(matrix[at] != 0 for at in expected_zero)
        or matrix[2, 2] != 1
        or min(matrix[0, 0], matrix[1, 1]) <= 0
    ):
        raise BadRecipe(
            f"intrinsics {matrix.tolist()}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]"
        )
    return matrix


def _solve(
    images: list[Path],
    masks_dir: Path | None,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    config: SfmConfig,
) -> _Solution:
    """Match, try a pure rotation, and map with six degrees of freedom where that doesn't do."""
    from gmrdata.sfm.mapping import map_frames
    from gmrdata.sfm.matches import match_frames
    from gmrdata.sfm.rotation_only import solve_rotation_only

    with tempfile.TemporaryDirectory(prefix="gmrdata-sfm-") as folder:
        work_dir = Path(folder)
        matches = match_frames(images, masks_dir, intrinsics_px, size_px, work_dir, config)
        rng = np.random.default_rng(config.seed)
        turning = solve_rotation_only(matches, intrinsics_px, config.rotation_only_inlier_px, rng)
        medians_px = turning.pair_medians_px
        evidence: dict[str, Any] = {
            "rotation_only_median_px": _figure(np.median(turning.residuals_px)),
            "rotation_only_wide_median_px": _figure(np.percentile(medians_px, 90)),
            "rotation_only_share": _figure(
                np.mean(turning.residuals_px < config.rotation_only_inlier_px)
            ),
            "panoramic_pairs_share": _figure(
                np.mean([pair.configuration in PANORAMIC for pair in matches.pairs])
            ),
            "pairs": len(matches.pairs),
            "features_per_frame": _figure(np.median([len(k) for k in matches.keypoints_px])),
        }
        reason, is_turning = _choose(evidence, config)
        evidence["reason"] = reason
        if is_turning:
            return _turning_solution(turning, evidence, config)
        mapped = map_frames(work_dir / "database.db", images, matches, intrinsics_px, config)
        if mapped is None or mapped.has_camera.sum() < config.min_frames_registered:
            raise NoReconstruction(
                f"{images[0].parent}: {len(matches.pairs)} pairs of frames match, but no mapper "
                "could build a model; the parallax may be too small, the intrinsics wrong or the "
                "background moving"
            )
        return _mapped_solution(mapped, evidence)


def _choose(evidence: dict[str, Any], config: SfmConfig) -> tuple[str, bool]:
    """Whether a pure rotation explains the matches, in words and as a verdict."""
    median_px = evidence["rotation_only_median_px"]
    wide_px = evidence["rotation_only_wide_median_px"]
    share = evidence["rotation_only_share"]
    accepted = (
        median_px <= config.rotation_only_median_px
        and wide_px <= config.rotation_only_wide_median_px
        and share >= config.rotation_only_share
    )
    figures = (
        f"median residual {median_px} px (limit {config.rotation_only_median_px}), in the worst "
        f"tenth of the pairs {wide_px} px (limit {config.rotation_only_wide_median_px}), "
        f"{100 * share:.0f} % of the matches within {config.rotation_only_inlier_px} px "
        f"(limit {100 * config.rotation_only_share:.0f} %)"
    )
    verdict = "a pure rotation explains" if accepted else "a pure rotation does not explain"
    return f"{verdict} the matches: {figures}", accepted


def _turning_solution(turning: Any, evidence: dict[str, Any], config: SfmConfig) -> _Solution:
    n = len(turning.has_camera)
    world_from_cam = transforms.rigid(turning.world_from_cam_rotmats, np.zeros(3))
    world_from_cam[~turning.has_camera] = np.nan
    agree = turning.residuals_px < config.rotation_only_inlier_px
    rows = turning.pairs_rows[turning.pair_of_residual[agree]]
    quality = _quality(
        "rotation_only",
        turning.has_camera,
        turning.residuals_px[agree],
        np.bincount(rows.ravel(), minlength=n),
        evidence,
    )
    quality |= {"mapper": "rotation_only", "models": 1, "resected_frames": 0}
    return _Solution(
        "rotation_only",
        world_from_cam,
        turning.has_camera,
        np.zeros((0, 3)),
        np.zeros(0, dtype=np.int64),
        quality,
    )


def _mapped_solution(mapped: Any, evidence: dict[str, Any]) -> _Solution:
    quality = _quality("full", mapped.has_camera, mapped.errors_px, mapped.observations, evidence)
    quality |= {
        "mapper": mapped.mapper,
        "models": mapped.n_models,
        "resected_frames": mapped.n_resected,
        "points": len(mapped.points),
        "median_track_length": _figure(np.median(mapped.track_lengths)),
    }
    return _Solution(
        "full",
        mapped.world_from_cam,
        mapped.has_camera,
        mapped.points,
        mapped.track_lengths,
        quality,
    )


def _quality(
    geometry: Geometry,
    has_camera: np.ndarray,
    errors_px: np.ndarray,
    inliers: np.ndarray,
    evidence: dict[str, Any],
) -> dict[str, Any]:
    return {
        "geometry": geometry,
        "frames": len(has_camera),
        "frames_with_camera": int(has_camera.sum()),
        "registered_share": _figure(has_camera.mean()),
        "mean_reprojection_px": _figure(errors_px.mean()),
        "median_reprojection_px": _figure(np.median(errors_px)),
        "inliers_per_frame": [int(count) for count in inliers],
        "evidence": evidence,
    }


def _figure(value: float | np.floating[Any]) -> float:
    """A figure as it stands in records: six significant digits."""
    return float(f"{float(value):.6g}")
