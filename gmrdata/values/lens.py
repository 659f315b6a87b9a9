"""Lens: how a camera of one picture size shows directions as pixels, and who says so."""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self

import numpy as np

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
    edge, steepest = _turning_points(k1, k2)
    most = np.minimum(edge, WIDEST * size)
    # Newton's method, begun where every step comes nearer.
    r = np.minimum(size, min(edge, steepest))
    for _ in range(STRAIGHTEN_STEPS):
        step = (r + k1 * r**3 + k2 * r**5 - size) / (1 + 3 * k1 * r**2 + 5 * k2 * r**4)
        r = np.clip(r - step, 0, most)
    return seen * np.where(size > 0, r / np.where(size > 0, size, 1.0), 1.0)


def _turning_points(k1: float, k2: float) -> tuple[float, float]:
    """Radii r below which r + k1 r^3 + k2 r^5 grows, and where it grows fastest if k1 > 0."""
    under_root = 9 * k1**2 - 20 * k2
    over = float(np.sqrt(under_root)) - 3 * k1 if under_root >= 0 else 0.0
    edge = float(np.sqrt(2 / over)) * (1 - 1e-6) if over > 0 else np.inf
    steepest = float(np.sqrt(-0.3 * k1 / k2)) if k1 > 0 > k2 else np.inf
    return edge, steepest


WIDEST = 2.25  # most that a radius is of a pinhole over that of a lens
STRAIGHTEN_STEPS = 12
