"""CameraPath, gaps in one, the pinhole projection, and whether the subject is in the picture."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gmrdata.values import transforms
from gmrdata.values.errors import BadRecipe
from gmrdata.values.lens import Lens


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A pinhole camera over T frames.

    The camera looks along +z with x right and y down (OpenCV); pixel (0, 0) is the outer corner of
    the top-left pixel (COLMAP), so the centre of an image of width w is at x = w / 2.
    """

    intrinsics_px: np.ndarray  # (3, 3) calibration matrix K [px], the same for all frames
    width_px: int
    height_px: int
    world_from_cam: np.ndarray  # (T, 4, 4) rigid transforms [m]; NaN where `has_camera` is False
    has_camera: np.ndarray  # (T,) bool: whether the camera of this frame is known

    @property
    def lens(self) -> Lens:
        """BadRecipe where the matrix is no pinhole's."""
        try:
            return Lens.of_matrix(self.intrinsics_px, (self.width_px, self.height_px))
        except (ValueError, IndexError):
            expected = "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]"
            raise BadRecipe(f"intrinsics {self.intrinsics_px.tolist()}: {expected}") from None

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return int(self.world_from_cam.shape[0])

    @property
    def centres_world_m(self) -> np.ndarray:
        """(T, 3) optical centres, world frame [m]."""
        return self.world_from_cam[:, :3, 3]

    def at_rows(self, rows: np.ndarray | slice) -> "CameraPath":
        """The same camera in some of its frames."""
        return replace(
            self, world_from_cam=self.world_from_cam[rows], has_camera=self.has_camera[rows]
        )


def fill_gaps(world_from_cam: np.ndarray, has_camera: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Fill all gaps of (T, 4, 4) by slerp and linear interpolation; the ends are held.

    `times` (T,) ascend, in any unit.  Where no frame has a camera, nothing is filled.
    """
    from scipy.spatial.transform import Rotation, Slerp

    rows = np.flatnonzero(has_camera)
    if len(rows) < 2:
        return world_from_cam[np.resize(rows, len(times))] if len(rows) else world_from_cam.copy()
    at, known = np.clip(times, times[rows[0]], times[rows[-1]]), world_from_cam[rows]
    rotmats = Slerp(times[rows], Rotation.from_matrix(known[:, :3, :3]))(at).as_matrix()
    centres = [np.interp(at, times[rows], known[:, axis, 3]) for axis in range(3)]
    filled = transforms.rigid(rotmats, np.stack(centres, axis=1))
    filled[rows] = known
    return filled


def intrinsics_from_fov(hfov_deg: float, width_px: int, height_px: int) -> np.ndarray:
    """Calibration matrix (3, 3) [px]: square pixels, principal point in the image centre."""
    focal_px = 0.5 * width_px / np.tan(np.deg2rad(hfov_deg) / 2)
    return np.array(
        [[focal_px, 0.0, width_px / 2], [0.0, focal_px, height_px / 2], [0.0, 0.0, 1.0]]
    )


def project_cam(points_cam_m: np.ndarray, intrinsics_px: np.ndarray) -> np.ndarray:
    """Project camera-frame points (..., 3) [m] to (..., 2) [px]; NaN for a depth of 0 or less."""
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


HEAD_ABOVE_PELVIS_M = 0.85
FEET_BELOW_PELVIS_M = 1.05
REACH_M = 0.4  # a standing adult of 1.9 m fits this box round the pelvis


def in_frame(
    camera: CameraPath, points_world_m: np.ndarray, margin_share: float = 0.0
) -> np.ndarray:
    """(T,) bool: frames with a camera that has all their points, (T, 3) or (T, N, 3), in view.

    A border of `margin_share` of the image's height does not count as inside.
    """
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
    side_m = (-REACH_M, REACH_M)
    corners_m = list(product(side_m, side_m, (-FEET_BELOW_PELVIS_M, HEAD_ABOVE_PELVIS_M)))
    return pelvis_world_m[:, None] + np.array(corners_m)
