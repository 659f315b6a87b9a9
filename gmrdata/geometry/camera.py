"""CameraPath and the pinhole projection."""

from dataclasses import dataclass

import numpy as np

from gmrdata.geometry import transforms


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A pinhole camera over T frames.

    The camera looks along +z with x right and y down (OpenCV); pixel (0, 0) is the outer corner of
    the top-left pixel (COLMAP), so the centre of an image of width w is at x = w / 2.
    """

    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix K [px], the same for all frames."""
    width_px: int
    """Image width [px]."""
    height_px: int
    """Image height [px]."""
    world_from_cam: np.ndarray
    """(T, 4, 4) rigid transforms [m]; NaN where `has_camera` is False."""
    has_camera: np.ndarray
    """(T,) bool: whether the camera of this frame is known."""

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return int(self.world_from_cam.shape[0])

    @property
    def centres_world_m(self) -> np.ndarray:
        """(T, 3) optical centres, world frame [m]."""
        return self.world_from_cam[:, :3, 3]


def intrinsics_from_fov(hfov_deg: float, width_px: int, height_px: int) -> np.ndarray:
    """Calibration matrix (3, 3) [px]: square pixels, principal point in the image centre."""
    focal_px = 0.5 * width_px / np.tan(np.deg2rad(hfov_deg) / 2)
    return np.array(
        [[focal_px, 0.0, width_px / 2], [0.0, focal_px, height_px / 2], [0.0, 0.0, 1.0]]
    )


def project_cam(points_cam_m: np.ndarray, intrinsics_px: np.ndarray) -> np.ndarray:
    """Project points (..., 3) in the camera frame [m] to (..., 2) image points [px].

    Points with depth <= 0 are behind the camera; their image points are NaN.
    """
    depth_m = points_cam_m[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        rays = np.where(depth_m > 0, points_cam_m / depth_m, np.nan)
    return (rays @ intrinsics_px.T)[..., :2]


def project(
    world_from_cam: np.ndarray, points_world_m: np.ndarray, intrinsics_px: np.ndarray
) -> np.ndarray:
    """Project world points (..., N, 3) [m] through cameras (..., 4, 4) to (..., N, 2) [px]."""
    return project_cam(
        transforms.apply(transforms.invert(world_from_cam), points_world_m), intrinsics_px
    )
