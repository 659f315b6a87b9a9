"""Whether a sequence's 2D keypoints fit its intrinsics: the focal length that they ask for.

A joint at image point q from the principal point c, by the camera-frame body and K, is detected at
c + s + f q: f is the true focal length over K's, s the shift of the principal point.  Two things
in a sequence hold f: where people stand over the frames, and how large they are.  A detector's
joints are not the body's, though; OpenPose's hips and shoulders are some centimetres from SMPL's.
So each keypoint has an unknown place beside its joint, a constant vector in the pelvis' axes with a
prior (`joint_offset_m`), solved for together with f and s.  Size then counts only as far as it is
known, and the way that people go counts in full.
"""

from collections.abc import Sequence

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as part

from gmrdata.read.openpose import OPENPOSE_JOINTS
from gmrdata.read.threedpw import Sequence3DPW, ValidRule
from gmrdata.read.threedpw_files import FPS_HZ
from gmrdata.threedpw.clips import camera_clip, fitting_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import project_cam
from gmrdata.values.records import PART, Config
from gmrdata.values.skinning import motion_joints_m

NEAREST_M = 0.3
"""Joints closer to the camera than this are left out [m]: there a small error is many pixels."""
MARGIN_SHARE = 0.5
"""Joints that the body has further outside the image than this share of it are left out."""
FINEST_PX = 0.2  # no detector's error is smaller [px]; keeps exact input from dividing by zero
MAX_ITERATIONS = 50
SETTLED = 1e-7  # the fit ends where f changes by less


class IntrinsicsCheckConfig(Config):
    """How the intrinsics of a sequence are checked against its 2D keypoints."""

    max_focal_deviation: float = Field(default=0.1, gt=0, lt=1)
    """Difference of the focal length from K's, as a share of it, that is still right."""
    sigmas: float = Field(default=3.0, ge=0)
    """By how many standard errors it must be larger to be called wrong."""
    min_confidence: float = Field(default=0.3, ge=0, lt=1)
    """Keypoints of this confidence or less are not used."""
    min_keypoints: int = Field(default=300, ge=12)
    """With fewer keypoints nothing is said."""
    joint_offset_m: float = Field(default=0.04, gt=0)
    """Standard deviation of where a detector sees a joint beside the body's, per axis."""
    principal_point_share: float = Field(default=0.02, gt=0)
    """Standard deviation of the principal point's shift, as a share of the longer image side."""
    error_lasts_s: float = Field(default=2.0, gt=0)
    """Errors of poses change this slowly: a joint counts once in that time, not per frame."""


@part(frozen=True, config=PART)
class FocalEstimate:
    """The focal length that the keypoints ask for."""

    factor: float
    """Over that of the sequence's K; 1 where K is right."""
    sigma: float
    """Standard error of `factor`, the slow errors of poses and the place of joints included."""
    shift_px: tuple[float, float]
    """Of the principal point; little more than its prior where nobody goes across the image."""
    residual_px: float
    """Robust standard deviation of what is left per coordinate."""
    keypoints: int
    """Keypoints that were used, of all people and valid frames."""


def estimate_focal(
    sequence: Sequence3DPW,
    bodies: Sequence[BodyModel],
    config: IntrinsicsCheckConfig,
    rule: ValidRule = "campose_valid",
) -> FocalEstimate | None:
    """Fit focal length and principal point to all people's keypoints; None if they are too few.

    Linear least squares with Cauchy weights whose scale follows the residuals, so that keypoints of
    a passer-by, or left taken for right, count little.
    """
    people = range(len(sequence.arrays.people))
    parts = [_observed(sequence, index, bodies, config, rule) for index in people]
    design = np.concatenate([part[0] for part in parts])
    measured_px = np.concatenate([part[1] for part in parts])
    if len(measured_px) < config.min_keypoints:
        return None
    longer_px = max(sequence.images.width_px, sequence.images.height_px)
    prior = np.zeros(design.shape[2])
    prior[1:3] = (config.principal_point_share * longer_px) ** -2
    prior[3:] = config.joint_offset_m**-2
    rows_as_one = max(1.0, config.error_lasts_s * FPS_HZ)
    solution, covariance, scale_px = _fit(design, measured_px, prior, rows_as_one)
    return FocalEstimate(
        factor=float(solution[0]),
        sigma=float(np.sqrt(covariance[0, 0])),
        shift_px=(float(solution[1]), float(solution[2])),
        residual_px=scale_px,
        keypoints=len(measured_px),
    )


def intrinsics_reason(estimate: FocalEstimate | None, config: IntrinsicsCheckConfig) -> str | None:
    """Why the intrinsics must be wrong, in words; None where nothing speaks against them."""
    if estimate is None:
        return None
    beyond = abs(estimate.factor - 1.0) - config.max_focal_deviation
    if not beyond > config.sigmas * estimate.sigma:
        return None
    return (
        f"the 2D keypoints ask for a focal length {estimate.factor:.2f} times that of "
        f"cam_intrinsics (standard error {estimate.sigma:.2f}, at most "
        f"{config.max_focal_deviation:.0%} off is right)"
    )


def _observed(
    sequence: Sequence3DPW,
    person_index: int,
    bodies: Sequence[BodyModel],
    config: IntrinsicsCheckConfig,
    rule: ValidRule,
) -> tuple[np.ndarray, np.ndarray]:
    """One person's M keypoints: design (M, 2, 3 + 3 J) and measured points from c (M, 2) [px].  The
    unknowns are f, s and an offset for each of the J keypoints."""
    person = sequence.arrays.people[person_index]
    clip = camera_clip(sequence, person_index, bodies, rule)
    body = fitting_body(person, bodies, str(sequence.files.pickle_path))
    rows = np.flatnonzero(clip.valid)
    motion = clip.motion.take(rows)
    joints_m = motion_joints_m(body, motion)[:, list(OPENPOSE_JOINTS.values())]
    points_px = person.poses2d_px[rows][:, list(OPENPOSE_JOINTS)]
    intrinsics_px = sequence.arrays.intrinsics_px
    size_px = np.array([sequence.images.width_px, sequence.images.height_px])
    seen = (points_px[..., 2] > config.min_confidence) & (joints_m[..., 2] > NEAREST_M)
    # A joint far outside the image isn't what was detected in it, and would outweigh all others.
    seen &= _inside(points_px[..., :2], size_px, 0.0)
    seen &= _inside(project_cam(joints_m, intrinsics_px), size_px, MARGIN_SHARE)
    frame, joint = np.nonzero(seen)
    slopes = _slopes(joints_m[seen], intrinsics_px) @ motion.root_rotmats[frame]
    design = np.zeros((len(frame), 2, 3 + 3 * len(OPENPOSE_JOINTS)))
    design[:, :, 0] = project_cam(joints_m[seen], intrinsics_px) - intrinsics_px[:2, 2]
    design[:, 0, 1] = design[:, 1, 2] = 1.0
    columns = 3 + 3 * joint[:, None] + np.arange(3)
    np.put_along_axis(design, np.broadcast_to(columns[:, None], slopes.shape), slopes, axis=2)
    return design, points_px[seen][:, :2] - intrinsics_px[:2, 2]


def _inside(points_px: np.ndarray, size_px: np.ndarray, margin_share: float) -> np.ndarray:
    """Whether points (..., 2) lie in the image and a margin of so many image sizes round it."""
    shares = points_px / size_px
    return np.asarray(((shares >= -margin_share) & (shares <= 1 + margin_share)).all(axis=-1))


def _slopes(points_m: np.ndarray, intrinsics_px: np.ndarray) -> np.ndarray:
    """(M, 2, 3) image points by points in the camera frame [px/m]."""
    depth_m = points_m[:, 2, None, None]
    slopes = np.zeros((len(points_m), 2, 3))
    slopes[:, :, :2] = np.eye(2)
    slopes[:, :, 2] = -points_m[:, :2] / depth_m[:, 0]
    return np.asarray(intrinsics_px[:2, :2] @ slopes / depth_m)


def _fit(
    design: np.ndarray, measured_px: np.ndarray, prior: np.ndarray, rows_as_one: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Solution (P,), its covariance (P, P) and the residuals' scale [px].

    `design` is (M, 2, P), for `measured_px` (M, 2); `prior` (P,) are inverse variances about 0; so
    many `rows_as_one`, one after the other in time, have one error.
    """
    weights = np.ones(len(measured_px))
    solution, covariance, scale_px = np.zeros(len(prior)), np.zeros((len(prior),) * 2), FINEST_PX
    for _ in range(MAX_ITERATIONS):
        weighted = design * weights[:, None, None]
        squares = np.einsum("mip,miq->pq", weighted, design, optimize=True)
        products = np.einsum("mip,mi->p", weighted, measured_px)
        variance = scale_px**2 * rows_as_one
        information = squares / variance + np.diag(prior)
        before = solution[0]
        solution = np.linalg.solve(information, products / variance)
        covariance = np.linalg.inv(information)
        residuals_px = measured_px - design @ solution
        scale_px = max(FINEST_PX, float(1.4826 * np.median(np.abs(residuals_px))))
        weights = 1.0 / (1.0 + (residuals_px**2).sum(axis=1) / (2.0 * scale_px) ** 2)
        if abs(solution[0] - before) < SETTLED:
            break
    return solution, covariance, scale_px
