"""Landmarks of motions that are known, as a network without errors would see them."""

from dataclasses import replace

import numpy as np

from gmrdata.people.landmark_body import SeenLandmarks, from_hips, landmarks_about
from gmrdata.score.metrics import aligned_errors_mm
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import fit_similarities


def landmarks_of(motion: Motion, body: BodyModel) -> np.ndarray:
    """True landmarks (T, 33, 3) of a motion before the camera [m]."""
    about_m = landmarks_about(motion.rotmats, body.rest_joints_m(motion.shape))
    return np.asarray(about_m + motion.pelvis_m[:, None])


def seen_exactly(motion: Motion, body: BodyModel) -> SeenLandmarks:
    """What a network without errors would see."""
    true_m = landmarks_of(motion, body)
    rays = true_m[..., :2] / true_m[..., 2:]
    times_s = np.arange(motion.n_frames) / motion.fps_hz
    seen = SeenLandmarks(times_s, rays, true_m, np.ones(rays.shape[:2]))
    along_ray_m = true_m @ seen.cam_from_ray
    along_ray_m[..., 2] = np.linalg.norm(true_m, axis=-1)
    return replace(seen, world_m=from_hips(along_ray_m))


def aligned_mm(motion: Motion, body: BodyModel, rotmats: np.ndarray) -> float:
    """PA-MPJPE of poses (T, 24, 3, 3) against a motion's, on the motion's own body [mm]."""
    rest_joints_m, origin = body.rest_joints_m(motion.shape), np.zeros((motion.n_frames, 3))
    true_m, _ = posed_joints_m(rest_joints_m, motion.rotmats, origin)
    found_m, _ = posed_joints_m(rest_joints_m, rotmats, origin)
    return float(aligned_errors_mm(found_m, true_m, fit_similarities(true_m, found_m)).mean())
