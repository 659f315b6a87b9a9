"""Where a body stands before a camera, from its picture before the camera that a system assumed.

The assumed camera tells which pixels each joint was put on.  These pixels are seen along rays of
the true camera, without the distortion of its lens; the body stands where its joints are nearest to
those rays.  For a pinhole of f instead of f0 that is a depth of z f / f0 and the pelvis on the ray
of its pixel, as far as a body is flat; the least squares differ from that by its own depth.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.read.systems import vibe
from gmrdata.read.systems.entries import AGAIN
from gmrdata.values.body import SMPL_REST_PELVIS_M, BodyModel, shape_on
from gmrdata.values.camera import Lens
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import Crop, EstimatedPerson, InCamera, Pinhole
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import turns_to_rays

CROP_FOCAL_PX = 5000.0
"""Focal length of HMR and those after it, in a crop of their own size [px]."""
LARGEST_SIDE_ERROR_PX = 2.0  # by which twice a principal point may differ from the picture's size


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A person before the true camera, over T rows."""

    root_rotmats: np.ndarray  # (T, 3, 3) cam_from_root
    pelvis_m: np.ndarray  # (T, 3)
    shape: np.ndarray  # (S,) of the body
    assumed_depths_m: np.ndarray  # (T,) of SMPL's origin before the system's own camera


@dataclass(frozen=True, eq=False)
class AssumedPlace:
    """Where a system put a person before which camera, over T rows, in the video's pixels."""

    transl_m: np.ndarray  # (T, 3) SMPL's transl: pelvis = transl + J0
    camera: Pinhole | None  # None where that is the video's own
    along_ray: bool = False  # whether the root is as seen along the ray of the camera's centre


def place_body(
    person: EstimatedPerson, body: BodyModel, lens: Lens, size_px: tuple[int, int], path: Path
) -> PlacedBody:
    """The person on `body`, whose skeleton stands for the system's own.

    `size_px` is the (width, height) of the video's pictures, `path` the person's file.

    Raises:
        BadMotionFile: the file is of pictures of another shape.
    """
    assert person.in_camera is not None
    place, roots = assumed_place(person.in_camera, size_px, path), person.in_camera.root_rotmats
    shape, rest_pelves_m = _shape_and_rest(person, body)
    pelvis_m, depths_m = place.transl_m + rest_pelves_m, place.transl_m[:, 2]
    if place.camera is None:
        return PlacedBody(roots, pelvis_m, shape, depths_m)
    rotmats = np.concatenate([roots[:, None], person.local_rotmats], axis=1)
    joints_m, _ = posed_joints_m(body.rest_joints_m(shape), rotmats, pelvis_m)
    rays, offsets_m = lens.rays(_seen_px(joints_m, place.camera)), joints_m - pelvis_m[:, None]
    if place.along_ray:
        cam_from_ray = turns_to_rays(lens.rays(place.camera.centre_px))
        roots, offsets_m = cam_from_ray @ roots, offsets_m @ np.swapaxes(cam_from_ray, 1, 2)
    return PlacedBody(roots, _nearest_to_rays(offsets_m, rays), shape, depths_m)


def assumed_place(seen: InCamera, size_px: tuple[int, int], path: Path) -> AssumedPlace:
    """The place before the camera that a system assumed, in pictures of the video's size.

    A file of pictures of the same shape at another size is brought to these pixels; BadMotionFile
    where it is of another shape.
    """
    match seen.camera:
        case Crop() as crop:
            factor = _scale_to(seen.size_px, size_px, path)
            middle_px, side_px = factor * crop.middle_px, factor * crop.side_px
            return _before_crop(crop.weak, middle_px, side_px, crop.network_px)
        case "picture":
            assert seen.in_picture is not None
            return _before_picture(seen.in_picture, size_px)
    assert seen.transl_m is not None
    match seen.camera:
        case Pinhole(focal_px, centre_px):
            factor = _scale_to(seen.size_px, size_px, path, LARGEST_SIDE_ERROR_PX)
            return AssumedPlace(seen.transl_m, Pinhole(factor * focal_px, factor * centre_px))
        case "diagonal":
            focal_px = np.full(len(seen.transl_m), float(np.hypot(*size_px)))
            centre_px = np.tile(np.divide(size_px, 2.0), (len(focal_px), 1))
            return AssumedPlace(seen.transl_m, Pinhole(focal_px, centre_px))
    if seen.size_px is not None and seen.size_px != size_px:
        raise _other_video(seen.size_px, size_px, path)
    return AssumedPlace(seen.transl_m, None)


def _before_crop(
    weak: np.ndarray, middle_px: np.ndarray, side_px: np.ndarray, network_px: float
) -> AssumedPlace:
    """Before the camera round a crop, from s, tx, ty (T, 3)."""
    depths_m = 2.0 * CROP_FOCAL_PX / (network_px * weak[:, 0])
    transl_m = np.column_stack([weak[:, 1], weak[:, 2], depths_m])
    return AssumedPlace(transl_m, Pinhole(CROP_FOCAL_PX * side_px / network_px, middle_px), True)


def _before_picture(in_picture: np.ndarray, size_px: tuple[int, int]) -> AssumedPlace:
    """The same for a crop as wide as the picture round the person, whose own shift is not known."""
    n_rows, middle_px = len(in_picture), np.divide(size_px, 2.0)
    middle_px = middle_px * (1.0 + in_picture[:, :2] * in_picture[:, 2:])
    weak = np.column_stack([in_picture[:, 0] / vibe.CROP_OVER_BOX, np.zeros((n_rows, 2))])
    side_px = np.full(n_rows, vibe.CROP_OVER_BOX * size_px[0])
    return _before_crop(weak, middle_px, side_px, vibe.NETWORK_PX)


def _scale_to(
    own_px: tuple[float, float] | None, size_px: tuple[int, int], path: Path, error_px: float = 0.0
) -> float:
    """Pixels of the video for one of the file's pictures, which have its shape."""
    if own_px is None:
        return 1.0
    factors = np.divide(size_px, np.maximum(own_px, 1e-9))
    if min(own_px) <= 0 or abs(factors[0] / factors[1] - 1.0) * min(own_px) > 1.0 + error_px:
        raise _other_video(own_px, size_px, path)
    return float(factors[0])


def _other_video(
    own_px: tuple[float, float], size_px: tuple[int, int], path: Path
) -> BadMotionFile:
    what = f"is of images of {own_px[0]:.0f}x{own_px[1]:.0f} px"
    what += f", and the video's are {size_px[0]}x{size_px[1]} px"
    return BadMotionFile(f"{path}: {what}: it is another video's, or a turned one's. {AGAIN}")


def _shape_and_rest(person: EstimatedPerson, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """(S,) the shape on this body, and J0 (T, 3) or (3,) of the system's own [m]."""
    shape = np.zeros(body.n_shape)
    if person.betas is None or not person.has_betas_of(body.name):
        rest_m = SMPL_REST_PELVIS_M if person.rest_pelvis_m is None else person.rest_pelvis_m
        return shape, np.asarray(rest_m)
    shape = shape_on(body, person.betas.mean(axis=0))
    each = np.stack([shape_on(body, betas) for betas in person.betas])
    return shape, np.asarray(body.joints_template_m[0] + each @ body.joint_shape_dirs_m[0].T)


def _seen_px(joints_m: np.ndarray, assumed: Pinhole) -> np.ndarray:
    """Pixels (T, 24, 2) of joints (T, 24, 3) before the assumed camera."""
    over_depth = joints_m[..., :2] / np.maximum(joints_m[..., 2:], NEAREST_M)
    return assumed.focal_px[:, None, None] * over_depth + assumed.centre_px[:, None]


NEAREST_M = 0.05  # a joint is not behind the camera


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
