"""Cameras of frames that no mapper placed, against points that are known already."""

from collections.abc import Iterable

import numpy as np

from gmrdata.geometry import transforms
from gmrdata.sfm.colmap import pycolmap
from gmrdata.sfm.matches import Matches, pinhole_params

MIN_PNP_INLIERS = 20

SeenPoints = dict[int, dict[int, np.ndarray]]
"""By frame and feature: the point (3,) that is seen there, in the unit of the reconstruction."""


def place_frames(
    rows: Iterable[int],
    world_from_cam: np.ndarray,
    observations: np.ndarray,
    seen: SeenPoints,
    matches: Matches,
    intrinsics_px: np.ndarray,
) -> int:
    """Place frames by the points that their matched neighbours see.

    Args:
        rows: The frames without a camera.
        world_from_cam: (T, 4, 4); filled in place.
        observations: (T,) points per frame; filled in place.
        seen: Points of the frames that have a camera; those of placed frames are added.
        matches: Matches of all T frames.
        intrinsics_px: (3, 3) calibration matrix [px].

    Returns:
        How many frames got a camera.
    """
    camera = pycolmap.Camera(
        model="PINHOLE",
        width=round(2 * intrinsics_px[0, 2]),
        height=round(2 * intrinsics_px[1, 2]),
        params=list(pinhole_params(intrinsics_px)),
    )
    placed = 0
    for row, points in _points_of(set(rows), seen, matches).items():
        if len(points) < MIN_PNP_INLIERS:
            continue
        answer = pycolmap.estimate_and_refine_absolute_pose(
            matches.keypoints_px[row][list(points)], np.array(list(points.values())), camera
        )
        if answer is not None and answer["num_inliers"] >= MIN_PNP_INLIERS:
            matrix = np.asarray(answer["cam_from_world"].matrix())
            world_from_cam[row] = transforms.invert(transforms.rigid(matrix[:, :3], matrix[:, 3]))
            observations[row] = answer["num_inliers"]
            agree = zip(points.items(), answer["inlier_mask"], strict=True)
            seen[row] = {feature: point for (feature, point), inlier in agree if inlier}
            placed += 1
    return placed


def _points_of(rows: set[int], seen: SeenPoints, matches: Matches) -> SeenPoints:
    """Points behind the features of each row, through its matches with frames that see them."""
    found: SeenPoints = {row: {} for row in sorted(rows)}
    for pair in matches.pairs:
        for mine, other, column in ((pair.first, pair.second, 0), (pair.second, pair.first, 1)):
            if mine not in rows or other not in seen:
                continue
            points = seen[other]
            for features in pair.features:
                theirs = int(features[1 - column])
                if theirs in points:
                    found[mine][int(features[column])] = points[theirs]
    return found
