"""One geometry's answer, as it is written: cameras, points and the figures behind them.

Cameras of frames that nothing placed, between placed ones that are close.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import krogh_interpolate
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.cameras.evidence import Evidence, figure
from gmrdata.cameras.files import Geometry
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.timeline import Timeline
from gmrdata.values import transforms

if TYPE_CHECKING:
    from gmrdata.cameras.focal import FreedFocal
    from gmrdata.cameras.mapping import Mapped
    from gmrdata.cameras.rotation_only import RotationOnly


def fill_short_gaps(
    world_from_cam: np.ndarray, has_camera: np.ndarray, timeline: Timeline, max_gap_frames: int
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate cameras over short gaps; ends, longer gaps and cuts stay as they are.

    Places follow the cubic through the two placed frames on either side, or a polynomial of lower
    degree where fewer are within reach; rotations are slerped.

    Args:
        world_from_cam: (T, 4, 4); NaN where `has_camera` is False.
        has_camera: (T,) bool.
        timeline: Of the T frames.
        max_gap_frames: Frames in a gap at most, left-out images among them.

    Returns:
        World_from_cam (T, 4, 4) with the gaps filled, and which frames were filled (T,) bool.
    """
    filled, interpolated = world_from_cam.copy(), np.zeros(len(has_camera), dtype=bool)
    numbers, placed = timeline.image_numbers, np.flatnonzero(has_camera)
    near = timeline.near(placed, max_gap_frames)
    for gap in np.flatnonzero(near & (np.diff(placed) > 1)):
        between = np.arange(placed[gap] + 1, placed[gap + 1])
        first = gap - 1 if gap > 0 and near[gap - 1] else gap
        last = gap + 2 if gap + 1 < len(near) and near[gap + 1] else gap + 1
        knots, ends = placed[first : last + 1], placed[gap : gap + 2]
        centres = krogh_interpolate(numbers[knots], world_from_cam[knots, :3, 3], numbers[between])
        turn = Slerp(numbers[ends], Rotation.from_matrix(world_from_cam[ends, :3, :3]))
        filled[between] = transforms.rigid(turn(numbers[between]).as_matrix(), centres)
        interpolated[between] = True
    return filled, interpolated


@dataclass(frozen=True, eq=False)
class Solution:
    """Cameras of T frames up to a similarity, in the geometry that was chosen."""

    geometry: Geometry
    """"full", "rotation_only" or "static"."""
    world_from_cam: np.ndarray
    """(T, 4, 4); NaN where `has_camera` is False."""
    has_camera: np.ndarray
    """(T,) bool."""
    points: np.ndarray
    """(N, 3) background points [unit of length of the cameras]; none but for "full"."""
    track_lengths: np.ndarray
    """(N,) frames that see each point."""
    interpolated: np.ndarray
    """(T,) bool: frames whose camera was interpolated."""
    quality: dict[str, Any]
    """The figures, as plain JSON."""


def turning_solution(
    turning: RotationOnly,
    evidence: Evidence,
    focal_px: float,
    config: SfmConfig,
    freed: FreedFocal | None = None,
) -> Solution:
    """A camera at the origin that only turns, or does not move at all."""
    turn_rad = _largest_turn_rad(turning)
    static = focal_px * turn_rad <= config.static_px
    geometry: Geometry = "static" if static else "rotation_only"
    rotmats = np.tile(np.eye(3), (len(turning.has_camera), 1, 1))
    if not static:
        rotmats = turning.world_from_cam_rotmats
    world_from_cam = transforms.rigid(rotmats, np.zeros(3))
    world_from_cam[~turning.has_camera] = np.nan
    agree = turning.residuals_px < config.rotation_only_inlier_px
    rows = turning.pairs_rows[turning.pair_of_residual[agree]]
    inliers = np.bincount(rows.ravel(), minlength=len(turning.has_camera))
    quality = _quality(geometry, turning.has_camera, turning.residuals_px[agree], inliers, evidence)
    quality |= {
        "mapper": "rotation_only",
        "models": [],
        "resected_frames": 0,
        "largest_turn_deg": figure(np.rad2deg(turn_rad)),
    }
    quality |= _focal_figures(freed)
    no_points, no_tracks = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    has_camera, none = turning.has_camera, np.zeros_like(turning.has_camera)
    return Solution(geometry, world_from_cam, has_camera, no_points, no_tracks, none, quality)


def _largest_turn_rad(turning: RotationOnly) -> float:
    """Largest angle between a frame's orientation and the mean of all [rad]."""
    rotations = Rotation.from_matrix(turning.world_from_cam_rotmats[turning.has_camera])
    return float((rotations.mean().inv() * rotations).magnitude().max())


def mapped_solution(mapped: Mapped, evidence: Evidence) -> Solution:
    """A camera with six degrees of freedom."""
    quality = _quality("full", mapped.has_camera, mapped.errors_px, mapped.observations, evidence)
    quality |= {
        "mapper": mapped.mapper,
        "models": [asdict(record) for record in mapped.models],
        "resected_frames": mapped.n_resected,
        "points": len(mapped.points),
        "median_track_length": figure(np.median(mapped.track_lengths)),
    }
    quality |= _focal_figures(mapped.focal)
    return Solution(
        "full",
        mapped.world_from_cam,
        mapped.has_camera,
        mapped.points,
        mapped.track_lengths,
        np.zeros_like(mapped.has_camera),
        quality,
    )


def _focal_figures(freed: FreedFocal | None) -> dict[str, Any]:
    """The focal length that the background asks for, over the given one; None where it doesn't."""
    if freed is None or freed.sigma is None:
        return {"focal_factor": None, "focal_sigma": None}
    return {"focal_factor": figure(freed.factor), "focal_sigma": figure(freed.sigma)}


def with_short_gaps_filled(solution: Solution, timeline: Timeline, max_gap_frames: int) -> Solution:
    """The solution with cameras interpolated over short gaps, marked, and named in the figures.

    The other figures are about the cameras that were found.
    """
    filled, interpolated = fill_short_gaps(
        solution.world_from_cam, solution.has_camera, timeline, max_gap_frames
    )
    return replace(
        solution,
        world_from_cam=filled,
        has_camera=solution.has_camera | interpolated,
        interpolated=interpolated,
        quality=solution.quality | {"interpolated": np.flatnonzero(interpolated).tolist()},
    )


def _quality(
    geometry: Geometry,
    has_camera: np.ndarray,
    errors_px: np.ndarray,
    inliers: np.ndarray,
    evidence: Evidence,
) -> dict[str, Any]:
    return {
        "geometry": geometry,
        "frames": len(has_camera),
        "frames_with_camera": int(has_camera.sum()),
        "registered_share": figure(has_camera.mean()),
        "mean_reprojection_px": figure(errors_px.mean()),
        "median_reprojection_px": figure(np.median(errors_px)),
        "inliers_per_frame": [int(count) for count in inliers],
        "evidence": asdict(evidence),
    }
