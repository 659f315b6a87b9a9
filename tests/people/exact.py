"""Landmarks of motions that are known, as a network without errors would see them."""

import numpy as np
import torch

from gmrdata.people.landmark_network import (
    from_hips,
    landmark_offsets_m,
    landmarks_on,
    tree_joints,
)
from gmrdata.people.lifter import SeenLandmarks, views_of
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import fit_similarities


def landmarks_of(motion: Motion, body: BodyModel) -> np.ndarray:
    """True landmarks (T, 33, 3) of a motion before the camera [m]."""
    rest_joints_m = body.rest_joints_m(motion.shape)
    joints_m, turned = tree_joints(torch.as_tensor(rest_joints_m), torch.as_tensor(motion.rotmats))
    leg_m = torch.full((motion.n_frames,), leg_length_m(rest_joints_m), dtype=torch.float64)
    about_m = landmarks_on(joints_m, turned, leg_m, torch.as_tensor(landmark_offsets_m()))
    return about_m.numpy() + motion.pelvis_m[:, None]


def seen_exactly(motion: Motion, body: BodyModel) -> SeenLandmarks:
    """What a network without errors would see."""
    true_m = torch.as_tensor(landmarks_of(motion, body))
    rays = true_m[..., :2] / true_m[..., 2:]
    along = from_hips(true_m @ views_of(rays).cam_from_ray)
    times_s = np.arange(motion.n_frames) / motion.fps_hz
    return SeenLandmarks(times_s, rays.numpy(), along.numpy(), np.ones(rays.shape[:2]))


def some_of(seen: SeenLandmarks, rows: slice | np.ndarray) -> SeenLandmarks:
    """Some frames of a track."""
    arrays = (seen.times_s, seen.rays, seen.world_m, seen.visibility)
    return SeenLandmarks(*(array[rows] for array in arrays))


def aligned_mm(motion: Motion, body: BodyModel, rotmats: np.ndarray) -> float:
    """PA-MPJPE of poses (T, 24, 3, 3) against a motion's, on the motion's own body [mm]."""
    rest_joints_m, origin = body.rest_joints_m(motion.shape), np.zeros((motion.n_frames, 3))
    true_m, _ = posed_joints_m(rest_joints_m, motion.rotmats, origin)
    found_m, _ = posed_joints_m(rest_joints_m, rotmats, origin)
    off_m = fit_similarities(true_m, found_m).apply(found_m) - true_m
    return float(1000 * np.linalg.norm(off_m, axis=-1).mean())
