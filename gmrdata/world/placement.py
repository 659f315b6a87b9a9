"""Where a body stands before a camera, from its picture before the camera that somebody assumed.

The assumed camera tells which pixels each joint was put on.  These pixels are seen along rays of
the true camera, without the distortion of its lens; the body stands where its joints are nearest to
those rays.  For a pinhole of f instead of f0 that is a depth of z f / f0 and the pelvis on the ray
of its pixel, as far as a body is flat; the least squares differ from that by its own depth.
"""

from dataclasses import dataclass

import numpy as np

from gmrdata.read.camera_bodies import AssumedCamera, SeenPerson
from gmrdata.values.bodies import SMPL, shape_on
from gmrdata.values.body import SMPL_REST_PELVIS_M, BodyModel
from gmrdata.values.lens import straightened
from gmrdata.values.skinning import posed_joints_m


@dataclass(frozen=True, eq=False)
class TrueCamera:
    """The camera of a video's images."""

    intrinsics_px: np.ndarray  # (3, 3) [px]
    radial: tuple[float, float] = (0.0, 0.0)
    """k1 and k2: a point at r, in units of the focal length, is seen at r + k1 r^3 + k2 r^5."""

    def rays(self, image_px: np.ndarray) -> np.ndarray:
        """x / z and y / z (..., 2) of what is seen at pixels (..., 2)."""
        seen = (image_px - self.intrinsics_px[:2, 2]) / np.diag(self.intrinsics_px)[:2]
        return np.asarray(straightened(seen, *self.radial))


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A person before the true camera, over T rows."""

    root_rotmats: np.ndarray  # (T, 3, 3) cam_from_root
    pelvis_m: np.ndarray  # (T, 3)
    shape: np.ndarray  # (S,) of the body


def place_body(person: SeenPerson, body: BodyModel, camera: TrueCamera) -> PlacedBody:
    """The person on `body`, whose skeleton stands for the estimator's own."""
    shape, rest_pelves_m = _shape_and_rest(person, body)
    pelvis_m = person.transl_m + rest_pelves_m
    rotmats = np.concatenate([person.root_rotmats[:, None], person.local_rotmats], axis=1)
    if person.assumed is None:
        return PlacedBody(person.root_rotmats, pelvis_m, shape)
    joints_m, _ = posed_joints_m(body.rest_joints_m(shape), rotmats, pelvis_m)
    rays = camera.rays(_seen_px(joints_m, person.assumed))
    roots, offsets_m = person.root_rotmats, joints_m - pelvis_m[:, None]
    if person.crop_px is not None:
        cam_from_ray = _turns_to(camera.rays(person.crop_px))
        roots, offsets_m = cam_from_ray @ roots, offsets_m @ np.swapaxes(cam_from_ray, 1, 2)
    return PlacedBody(roots, _nearest_to_rays(offsets_m, rays), shape)


def _shape_and_rest(person: SeenPerson, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """(S,) the shape on this body, and J0 (T, 3) or (3,) of the estimator's own [m]."""
    shape, is_its = np.zeros(body.n_shape), body.name == f"{SMPL}neutral"
    if person.betas is None or not is_its:
        rest_m = SMPL_REST_PELVIS_M if person.rest_pelvis_m is None else person.rest_pelvis_m
        return shape, np.asarray(rest_m)
    shape = shape_on(body, person.betas.mean(axis=0))
    each = np.stack([shape_on(body, betas) for betas in person.betas])
    return shape, np.asarray(body.joints_template_m[0] + each @ body.joint_shape_dirs_m[0].T)


def _seen_px(joints_m: np.ndarray, assumed: AssumedCamera) -> np.ndarray:
    """Pixels (T, 24, 2) of joints (T, 24, 3) before the assumed camera."""
    over_depth = joints_m[..., :2] / np.maximum(joints_m[..., 2:], NEAREST_M)
    return assumed.focal_px[:, None, None] * over_depth + assumed.centre_px[:, None]


NEAREST_M = 0.05  # a joint is not behind the camera


def _turns_to(rays: np.ndarray) -> np.ndarray:
    """(T, 3, 3) smallest turns that take the z axis to rays (T, 2)."""
    x, y = rays.T
    length = np.sqrt(x**2 + y**2 + 1.0)
    x, y, z = x / length, y / length, 1.0 / length
    rows = [1 - x * x / (1 + z), -x * y / (1 + z), x, -x * y / (1 + z), 1 - y * y / (1 + z), y]
    return np.stack([*rows, -x, -y, z], axis=1).reshape(-1, 3, 3)


def _nearest_to_rays(offsets_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Places p (T, 3) for which offsets (T, J, 3) + p are nearest to rays (T, J, 2).

    Linear least squares of (x + px) - u (z + pz) = 0 and the same for y, all joints alike.
    """
    u, ones = rays, np.ones(rays.shape[:2])
    zeros = np.zeros_like(ones)
    by_x = np.stack([ones, zeros, -u[..., 0]], axis=-1)
    by_y = np.stack([zeros, ones, -u[..., 1]], axis=-1)
    design = np.concatenate([by_x, by_y], axis=1)
    off = u * offsets_m[..., 2:] - offsets_m[..., :2]
    target = np.concatenate([off[..., 0], off[..., 1]], axis=1)[..., None]
    normal = np.swapaxes(design, 1, 2)
    return np.asarray(np.linalg.solve(normal @ design, normal @ target)[..., 0])
