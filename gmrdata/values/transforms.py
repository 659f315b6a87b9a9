"""Rigid transforms as 4x4 arrays, `a_from_b`, which map coordinates in b to a; the best of them."""

import math
from typing import NamedTuple

import numpy as np

from gmrdata.values.shapes import Float

_ATAN2 = np.frompyfunc(math.atan2, 2, 1)
RIGID_TOLERANCE = 1e-3  # largest entry of R^T R - 1 of a rotation as files round it
_TURNED = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}
"""The axes that a rotation about one turns: the first towards the second."""


def rigid(
    rotmats: Float[np.ndarray, "*a 3 3"], translations: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*c 4 4"]:
    """Assemble transforms; batch dimensions broadcast."""
    batch = np.broadcast_shapes(rotmats.shape[:-2], translations.shape[:-1])
    a_from_b = np.zeros((*batch, 4, 4))
    a_from_b[..., :3, :3] = rotmats
    a_from_b[..., :3, 3] = translations
    a_from_b[..., 3, 3] = 1.0
    return a_from_b


def invert(a_from_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """b_from_a of rigid transforms, without a general matrix inverse."""
    rotmats = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    return rigid(rotmats, -np.einsum("...ij,...j->...i", rotmats, a_from_b[..., :3, 3]))


def are_rotations(rotmats: np.ndarray, most_off: float = RIGID_TOLERANCE) -> np.ndarray:
    """(...) bool: matrices (..., 3, 3) are proper rotations but for an entry of R^T R - 1."""
    near = np.abs(np.swapaxes(rotmats, -1, -2) @ rotmats - np.eye(3)).max((-1, -2)) <= most_off
    return np.asarray(near & (np.linalg.det(np.where(near[..., None, None], rotmats, 0.0)) > 0))


def apply(
    a_from_b: Float[np.ndarray, "*#batch 4 4"], points_b: Float[np.ndarray, "*#batch n 3"]
) -> Float[np.ndarray, "*#batch n 3"]:
    """Map points from b to a; one set of points may go through many transforms."""
    turned = np.einsum("...ij,...nj->...ni", a_from_b[..., :3, :3], points_b)
    return turned + a_from_b[..., None, :3, 3]


def euler_rotmats(
    axes: str, angles_deg: Float[np.ndarray, "*batch angles"]
) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotations by angles about axes named as in scipy: "XYZ" moving ones, "xyz" fixed ones.

    As scipy's but for the last digit, and ten times as fast.
    """
    if axes.islower():  # the same as about moving axes in the other order
        axes, angles_deg = axes[::-1].upper(), angles_deg[..., ::-1]
    angles_rad = np.deg2rad(np.moveaxis(angles_deg, -1, 0))
    columns: list[np.ndarray] = [
        column.reshape(3, *[1] * (angles_rad.ndim - 1)) for column in np.eye(3)
    ]
    for axis, cos, sin in zip(axes, np.cos(angles_rad), np.sin(angles_rad), strict=True):
        i, j = _TURNED[axis]
        turned = cos * columns[i] + sin * columns[j], cos * columns[j] - sin * columns[i]
        columns[i], columns[j] = turned
    rotmats = np.empty((*angles_rad.shape[1:], 3, 3))
    for k, column in enumerate(columns):
        rotmats[..., k] = np.moveaxis(column, 0, -1)
    return rotmats


def about_z(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """The rotation about the z axis, from x towards y."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def rotmats_from_rotvecs(rotvecs: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotations by an axis times an angle [rad].

    This and the next three are scipy's to the last bit, for Blender's environment, which has none.
    """
    rotvecs = np.asarray(rotvecs, dtype=np.float64)
    angles_rad = _lengths(rotvecs)
    small, squared = angles_rad <= 1e-3, angles_rad * angles_rad
    series = 0.5 - squared / 48 + squared * squared / 3840
    scales = np.where(small, series, np.sin(angles_rad / 2) / np.where(small, 1.0, angles_rad))
    return rotmats_from_quaternions(np.append(np.cos(angles_rad / 2), scales * rotvecs, axis=-1))


def rotmats_from_quaternions(
    quaternions: Float[np.ndarray, "*batch 4"],
) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotations of unit quaternions, real part first."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    rows = (
        (xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)),
        (2 * (xy + zw), -xx + yy - zz + ww, 2 * (yz - xw)),
        (2 * (xz - yw), 2 * (yz + xw), -xx - yy + zz + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_from_rotmats(
    rotmats: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 4"]:
    """Unit quaternions, real part first, of either sign, of the nearest rotations."""
    m = np.array(rotmats, dtype=np.float64).reshape(-1, 3, 3)
    skewed = ~np.isclose(m @ m.swapaxes(1, 2), np.eye(3), atol=1e-12).all(axis=(1, 2))
    if skewed.any():
        u, _, vt = np.linalg.svd(m[skewed])
        m[skewed] = u @ vt
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    x, y, z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    trace = xx + yy + zz
    by_largest = np.array(
        [
            (x, 1 - trace + 2 * xx, xy, xz),
            (y, xy, 1 - trace + 2 * yy, yz),
            (z, xz, yz, 1 - trace + 2 * zz),
            (1 + trace, x, y, z),
        ]
    )
    largest = np.argmax([xx, yy, zz, trace], axis=0)
    quaternions = by_largest[largest, :, np.arange(len(m))]
    w, x, y, z = quaternions.T
    lengths = np.sqrt(x * x + y * y + z * z + w * w)
    return np.asarray((quaternions / lengths[:, None]).reshape(*rotmats.shape[:-2], 4))


def rotvecs_from_rotmats(rotmats: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Axis times angle, up to pi [rad], of rotations."""
    quaternions = quaternions_from_rotmats(rotmats)
    firsts = np.take_along_axis(quaternions, (quaternions != 0).argmax(-1)[..., None], -1)
    quaternions = np.where(firsts < 0, -quaternions, quaternions)
    axes = quaternions[..., 1:]
    # The C library's, in whose last bit numpy's differs by the processor.
    angles_rad = 2 * _ATAN2(_lengths(axes), quaternions[..., :1]).astype(np.float64)
    small, squared = angles_rad <= 1e-3, angles_rad * angles_rad
    series = 2 + squared / 12 + 7 * squared * squared / 2880
    large = angles_rad / np.where(small, 1.0, np.sin(angles_rad / 2))
    return np.where(small, series, large) * axes


def _lengths(vectors: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.sqrt(x * x + y * y + z * z)[..., None]


def between(
    left: Float[np.ndarray, "3 3"],
    rotmats: Float[np.ndarray, "*batch 3 3"],
    right: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "*batch 3 3"]:
    """left @ R @ right of many R: two products of long matrices, as one for each R is slow."""
    rows = (rotmats.reshape(-1, 3) @ right).reshape(-1, 3, 3)
    turned = left @ rows.transpose(1, 0, 2).reshape(3, -1)
    return turned.reshape(3, -1, 3).transpose(1, 0, 2).reshape(rotmats.shape)


def angles_rad(rotmats: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n"]:
    """Angles in [0, pi] [rad], from sine and cosine: as accurate near 0 and pi as between."""
    skew = rotmats - np.swapaxes(rotmats, -1, -2)
    sines = 0.5 * np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    cosines = 0.5 * (np.trace(rotmats, axis1=-2, axis2=-1) - 1)
    return np.asarray(np.arctan2(sines, cosines))


def angles_deg(
    a: Float[np.ndarray, "*a 3"], b: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*batch"]:
    """Angles between directions of any length [degrees]."""
    sines = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(sines, (a * b).sum(axis=-1))))


def slerp(
    start: Float[np.ndarray, "n joints 3 3"],
    end: Float[np.ndarray, "n joints 3 3"],
    share: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n joints 3 3"]:
    """Rotations at a share of the shortest way from start to end."""
    steps = rotvecs_from_rotmats(start.swapaxes(-1, -2) @ end)
    return start @ rotmats_from_rotvecs(share[:, None, None] * steps)


class Similarity(NamedTuple):
    """a_from_b of points: p_a = scale * rotmat @ p_b + translation_m."""

    scale: float
    rotmat: np.ndarray
    translation_m: np.ndarray

    def apply(self, points_b_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Map points from b to a [m]."""
        turned_m = self.scale * np.asarray(points_b_m) @ self.rotmat.T
        return np.asarray(turned_m + self.translation_m)


def fit_similarity(
    points_a_m: Float[np.ndarray, "n 3"], points_b_m: Float[np.ndarray, "n 3"], *, scale: bool
) -> Similarity:
    """The a_from_b of least squares between paired points (Umeyama 1991, eqs. 40-42).

    Points on a line, or in one place, leave a part of the rotation open; one of the best is given.
    Where the scale is fitted, and not kept at 1, the points in b are not all in one place.
    """
    fits = fit_similarities(points_a_m[None], points_b_m[None], scale=scale)
    return Similarity(float(fits.scales[0]), fits.rotmats[0], fits.translations_m[0])


class Similarities(NamedTuple):
    """a_from_b of many sets of points, each as `Similarity`."""

    scales: Float[np.ndarray, " sets"]
    rotmats: Float[np.ndarray, "sets 3 3"]
    translations_m: Float[np.ndarray, "sets 3"]

    def apply(self, points_b_m: Float[np.ndarray, "sets n 3"]) -> Float[np.ndarray, "sets n 3"]:
        """Map each set of points from its b to its a [m]."""
        turned_m = points_b_m @ np.swapaxes(self.rotmats, -1, -2)
        return np.asarray(self.scales[:, None, None] * turned_m + self.translations_m[:, None])


def fit_similarities(
    points_a_m: Float[np.ndarray, "sets n 3"],
    points_b_m: Float[np.ndarray, "sets n 3"],
    *,
    scale: bool = True,
) -> Similarities:
    """`fit_similarity` for each of many sets of points."""
    mean_a, mean_b = points_a_m.mean(1), points_b_m.mean(1)
    centred_a, centred_b = points_a_m - mean_a[:, None], points_b_m - mean_b[:, None]
    covariances = np.swapaxes(centred_a, 1, 2) @ centred_b / points_a_m.shape[1]
    rotmats, singular = nearest_rotations(covariances)
    scales = singular.sum(1) / centred_b.var(1).sum(1) if scale else np.ones(len(mean_a))
    translations_m = mean_a - scales[:, None] * (rotmats @ mean_b[..., None])[..., 0]
    return Similarities(scales, rotmats, translations_m)


def cross_matrices(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Matrices of the cross product with vectors, from the left."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def smallest_rotation(
    from_vectors: Float[np.ndarray, "*n 3"], to_vectors: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3 3"]:
    """The rotations by the smallest angle that turn directions of any length into others."""
    a, b = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (from_vectors, to_vectors))
    axes, cosines = np.cross(a, b), (a * b).sum(-1, keepdims=True)
    sines = np.linalg.norm(axes, axis=-1, keepdims=True)
    angles_rad = np.arctan2(sines, cosines)
    if (alike := sines < 1e-12).any():  # or opposite: any axis across does
        across = np.cross(a, np.eye(3)[np.abs(a).argmin(-1)])
        axes = np.where(alike, across, axes)
        angles_rad = np.where(alike, np.pi * (cosines < 0.0), angles_rad)
    turns = axes / np.linalg.norm(axes, axis=-1, keepdims=True) * angles_rad
    return rotmats_from_rotvecs(turns)


def turns_to_rays(rays: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3 3"]:
    """The smallest rotations that turn the z axis into rays, x / z and y / z."""
    ends = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
    return smallest_rotation(np.broadcast_to(np.eye(3)[2], ends.shape), ends)


def mean_rotation(rotmats: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "3 3"]:
    """Chordal mean (Hartley et al. 2013, section 5.3)."""
    return nearest_rotations(rotmats.sum(0))[0]


def turns_about_mean_rad(rotmats: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, " n"]:
    """Angle of each rotation from the mean of them all."""
    return angles_rad(mean_rotation(rotmats).T @ rotmats)


def nearest_rotations(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotations nearest to matrices (..., 3, 3), and their signed singular values (..., 3)."""
    u, singular, vt = np.linalg.svd(matrix)
    signs = np.ones_like(singular)
    signs[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return (u * signs[..., None, :]) @ vt, singular * signs
