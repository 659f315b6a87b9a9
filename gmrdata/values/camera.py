"""Lens and CameraPath, gaps in one, the pinhole projection, and whether the subject is in view."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, NamedTuple, Self

import numpy as np

from gmrdata.values import transforms
from gmrdata.values.errors import BadRecipe

Source = Literal["given", "metadata", "self_calibrated", "prior"]
"""Somebody gave it, the camera noted it, the frames show it, or it is assumed."""


class Origin(NamedTuple):
    """Where a figure of a lens comes from."""

    source: Source
    sigma: float | None = None
    """Its standard error; None where nobody measured it."""


GIVEN, ASSUMED = Origin("given"), Origin("prior")


@dataclass(frozen=True)
class Lens:
    """A pinhole with square or oblong pixels and radial distortion; pixel (0, 0) is the outer
    corner of the first pixel, as in COLMAP."""

    focal_px: tuple[float, float]
    """Along x and y."""
    centre_px: tuple[float, float]
    """Principal point."""
    size_px: tuple[int, int]
    """(width, height) of the picture."""
    radial: tuple[float, float] = (0.0, 0.0)
    """k1 and k2: a point at r, in units of the focal length, is seen at r + k1 r^3 + k2 r^5."""
    focal_from: Origin = GIVEN
    """The standard error is a share of the focal length."""
    centre_from: Origin = GIVEN
    """The standard error is in pixels."""
    radial_from: Origin = GIVEN
    """The standard error is that of k1."""

    @classmethod
    def of_matrix(
        cls, matrix_px: np.ndarray, size_px: tuple[int, int], radial: tuple[float, float] = (0, 0)
    ) -> Self:
        """That of a calibration matrix (3, 3) [px]; ValueError for what is none, or has skew."""
        fx, fy, cx, cy = matrix_px[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        if not np.allclose(matrix_px, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], atol=1e-6):
            raise ValueError("no matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        return cls((fx, fy), (cx, cy), size_px, radial)

    @classmethod
    def centred(cls, focal_px: float, size_px: tuple[int, int], focal_from: Origin = GIVEN) -> Self:
        """Square pixels, no distortion, and the principal point in the picture's middle."""
        middle_px = size_px[0] / 2, size_px[1] / 2
        return cls(
            (focal_px, focal_px),
            middle_px,
            size_px,
            focal_from=focal_from,
            centre_from=ASSUMED,
            radial_from=ASSUMED,
        )

    @property
    def matrix_px(self) -> np.ndarray:
        """(3, 3) calibration matrix [px]."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def is_pinhole(self) -> bool:
        return self.radial == (0.0, 0.0)

    @property
    def corner_radius(self) -> float:
        """How far the farthest corner is from the principal point, in focal lengths."""
        away_px = np.maximum(self.centre_px, np.subtract(self.size_px, self.centre_px))
        return float(np.linalg.norm(away_px / self.focal_px))

    @property
    def folds(self) -> bool:
        """Whether the picture's corners are further out than its distortion shows anything."""
        k1, k2 = self.radial
        edge, _ = turning_points(k1, k2)
        return bool(np.isfinite(edge) and self.corner_radius > edge + k1 * edge**3 + k2 * edge**5)

    def at_size(self, size_px: tuple[int, int]) -> "Lens":
        """The same lens for the picture at another size; pixels scale as lengths do."""
        right, down = np.divide(size_px, self.size_px).tolist()
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return replace(
            self,
            focal_px=(right * fx, down * fy),
            centre_px=(right * cx, down * cy),
            size_px=size_px,
        )

    def rays(self, seen_px: np.ndarray) -> np.ndarray:
        """x / z and y / z (..., 2) of what is seen at pixels (..., 2)."""
        return straightened((seen_px - np.array(self.centre_px)) / self.focal_px, *self.radial)

    def seen_px(self, pinhole_px: np.ndarray) -> np.ndarray:
        """Where the picture shows what a pinhole would show at pixels (..., 2) [px]."""
        if self.is_pinhole:
            return np.asarray(pinhole_px, dtype=np.float64)
        focal_px, centre_px = np.array(self.focal_px), np.array(self.centre_px)
        return np.asarray(
            centre_px + focal_px * bent((pinhole_px - centre_px) / focal_px, *self.radial)
        )

    def pinhole_px(self, seen_px: np.ndarray) -> np.ndarray:
        """Where a pinhole would show what is seen at pixels (..., 2) [px]."""
        if self.is_pinhole:
            return np.asarray(seen_px, dtype=np.float64)
        return np.asarray(np.array(self.centre_px) + self.focal_px * self.rays(seen_px))


def bent(straight: np.ndarray, radial_k1: float, radial_k2: float = 0.0) -> np.ndarray:
    """Where a lens shows image points (..., 2) of a pinhole: r (1 + k1 r^2 + k2 r^4).

    Points are from the principal point, in units of the focal length.
    """
    r2 = (straight**2).sum(axis=-1, keepdims=True)
    return straight * (1 + radial_k1 * r2 + radial_k2 * r2**2)


def straightened(seen: np.ndarray, radial_k1: float, radial_k2: float = 0.0) -> np.ndarray:
    """Where a pinhole shows image points (..., 2) that a lens shows there: the reverse of `bent`.

    Beyond the largest radius that a lens which folds the picture shows, points go to its edge.
    """
    k1, k2 = radial_k1, radial_k2
    if k1 == k2 == 0:
        return seen
    size = np.sqrt((seen**2).sum(axis=-1, keepdims=True))
    edge, steepest = turning_points(k1, k2)
    most = np.minimum(edge, WIDEST * size)
    # Newton's method, begun where every step comes nearer.
    r = np.minimum(size, min(edge, steepest))
    for _ in range(STRAIGHTEN_STEPS):
        step = (r + k1 * r**3 + k2 * r**5 - size) / (1 + 3 * k1 * r**2 + 5 * k2 * r**4)
        r = np.clip(r - step, 0, most)
    return seen * np.where(size > 0, r / np.where(size > 0, size, 1.0), 1.0)


def turning_points(k1: float, k2: float) -> tuple[float, float]:
    """Radii r below which r + k1 r^3 + k2 r^5 grows, and where it grows fastest if k1 > 0."""
    under_root = 9 * k1**2 - 20 * k2
    over = float(np.sqrt(under_root)) - 3 * k1 if under_root >= 0 else 0.0
    edge = float(np.sqrt(2 / over)) * (1 - 1e-6) if over > 0 else np.inf
    steepest = float(np.sqrt(-0.3 * k1 / k2)) if k1 > 0 > k2 else np.inf
    return edge, steepest


WIDEST = 2.25  # most that a radius is of a pinhole over that of a lens
STRAIGHTEN_STEPS = 12


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A pinhole camera over T frames.

    The camera looks along +z with x right and y down (OpenCV).  Pixel (0, 0) is the outer corner of
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
    return Lens.centred(focal_px, (width_px, height_px)).matrix_px


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
