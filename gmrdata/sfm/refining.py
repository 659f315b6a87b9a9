"""The frames of either geometry refined together, by `smoothing`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gmrdata.geometry import transforms
from gmrdata.sfm.config import SfmConfig
from gmrdata.sfm.information import camera_information
from gmrdata.sfm.smoothing import smooth_cameras
from gmrdata.sfm.timeline import Timeline

if TYPE_CHECKING:  # these load pycolmap
    from gmrdata.sfm.mapping import Mapped
    from gmrdata.sfm.matches import Matches
    from gmrdata.sfm.rotation_only import RotationOnly


def refine_mapped(
    mapped: Mapped,
    matches: Matches,
    intrinsics_px: np.ndarray,
    timeline: Timeline,
    config: SfmConfig,
) -> tuple[Mapped, dict[str, Any]]:
    """Cameras with six degrees of freedom, on their points; and the figures."""
    cameras, seen_px, seen_points = mapped.world_from_cam, {}, {}
    for row, seen in sorted(mapped.seen.items()):
        seen_px[row] = matches.keypoints_px[row][list(seen)]
        seen_points[row] = np.array(list(seen.values()))
    information, slope = camera_information(cameras, seen_px, seen_points, intrinsics_px)
    distances = [
        np.median(np.linalg.norm(points - cameras[row, :3, 3], axis=1))
        for row, points in seen_points.items()
    ]
    unit = float(np.median(distances))
    refined, figures = smooth_cameras(cameras, information, slope, timeline, unit, config)
    return replace(mapped, world_from_cam=refined), figures


def refine_turning(
    turning: RotationOnly, timeline: Timeline, config: SfmConfig
) -> tuple[RotationOnly, dict[str, Any]]:
    """Cameras that only turn, on their matches; and the figures."""
    cameras = transforms.rigid(turning.world_from_cam_rotmats, np.zeros(3))
    cameras[~turning.has_camera] = np.nan
    # The rotations are at their matches' optimum, so the slope is zero.
    slope = np.zeros(3 * len(cameras))
    refined, figures = smooth_cameras(cameras, turning.information, slope, timeline, 1.0, config)
    refined[~turning.has_camera] = np.eye(4)
    return replace(turning, world_from_cam_rotmats=refined[:, :3, :3]), figures
