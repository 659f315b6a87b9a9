"""Is the subject in the picture?"""

import numpy as np

from gmrdata.geometry.camera import CameraPath, project

HEAD_ABOVE_PELVIS_M = 0.85
FEET_BELOW_PELVIS_M = 1.05
REACH_M = 0.4
"""A standing adult of 1.9 m fits this box round the pelvis."""


def in_frame_share(
    camera: CameraPath, points_world_m: np.ndarray, margin_share: float = 0.0
) -> float:
    """Share of the frames with all points in front of the camera and inside the image.

    Args:
        camera: Camera over T frames.
        points_world_m: (T, 3) or (T, N, 3) points per frame, world [m].
        margin_share: Border that does not count as inside, as a share of the image's height.

    Returns:
        0 to 1.  A frame without a camera counts as out of frame.
    """
    return float(in_frame(camera, points_world_m, margin_share).mean())


def in_frame(
    camera: CameraPath, points_world_m: np.ndarray, margin_share: float = 0.0
) -> np.ndarray:
    """(T,) bool: frames with all points in view; `in_frame_share` has the arguments."""
    points = np.asarray(points_world_m, dtype=np.float64)
    points = points[:, None] if points.ndim == 2 else points
    points_px = project(camera.world_from_cam, points, camera.intrinsics_px)
    border_px = margin_share * camera.height_px
    size_px = np.array([camera.width_px, camera.height_px])
    # Comparisons with NaN are False: points behind the camera and frames without one drop out here.
    inside = (points_px >= border_px) & (points_px <= size_px - border_px)
    return np.asarray(inside.all(axis=(1, 2)))


def person_box(pelvis_world_m: np.ndarray) -> np.ndarray:
    """Corners (T, 8, 3) of a box that holds a standing person, from pelvis positions (T, 3) [m]."""
    corners = [
        (x, y, z)
        for x in (-REACH_M, REACH_M)
        for y in (-REACH_M, REACH_M)
        for z in (-FEET_BELOW_PELVIS_M, HEAD_ABOVE_PELVIS_M)
    ]
    return pelvis_world_m[:, None] + np.array(corners)
