"""Stage: local poses of people who were followed, from their landmarks.

`local_poses.json`, and `person_<n>.npz` of each person: poses, roots and places.  The lifter gives
the pose and the fit lays it onto the landmarks.  The place is where a body of usual size lies on
them without leaps: linear least squares, each landmark near its ray, as far as it is seen, and
small second differences of the pelvis's place; a landmark far from its ray counts less in a second
round.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import Field

from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.following import FOLLOWED_FILE, FollowedRecord, Sightings, load_tracks
from gmrdata.people.landmark_network import landmark_offsets_m, landmarks_on, tree_joints
from gmrdata.people.lifter import (
    WEIGHTS_FILE,
    LiftedPose,
    SeenLandmarks,
    landmark_weights,
    lift,
)
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.camera import Lens
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.people import POSES_FILE, LocalPoses, LocalPosesRecord, person_file
from gmrdata.values.records import Config

POSES_FOLDER = "poses"
Method = Literal["lifter", "fit", "lifter_fit"]
ACCELERATION = 6.0  # usual one of a pelvis before a camera that is held by hand [m/s2]
DEPTH_ACCELERATION = 3.0
ERROR_M = 0.04  # of a landmark
ALIKE = 12.0  # landmarks of a frame err together: so many of them tell as much as one
ROUNDS = 3
LEAST_DEPTH_M = 0.1


class LocalPosesConfig(Config):
    """How people's poses are made."""

    method: Method = "lifter_fit"
    """The network; the optimisation alone; or the optimisation from the network's poses."""
    fit: FitConfig = FitConfig()
    smooth_s: float = Field(default=0.03, ge=0)
    """Deviation of the weights in time by which poses are averaged [s]; 0: not at all."""


class _Recipe(Config):
    poses: LocalPosesConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial: tuple[float, float]
    frame_numbers: tuple[int, ...]
    fps_hz: float


def local_poses(
    followed_dir: Path,
    frames: FrameSet,
    lens: Lens,
    body_path: Path,
    out_dir: Path,
    config: LocalPosesConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Poses of whom `follow_people` left, which `read_system` reads.  A video in which
    nobody is seen leaves poses without people.  MissingInput and BadBodyFile name the file."""
    recipe = _Recipe(
        poses=config,
        intrinsics_px=tuple(tuple(row) for row in lens.matrix_px.tolist()),
        radial=lens.radial,
        frame_numbers=tuple(frames.frame_numbers.tolist()),
        fps_hz=frames.rate_hz,
    )

    def work(partial: Path) -> None:
        followed = FollowedRecord.read(followed_dir / FOLLOWED_FILE)
        numbers = np.array(followed.images, dtype=np.int64)
        body = read_body(body_path)
        people = load_tracks(followed_dir)
        for n, track in enumerate(with_bar(people, "poses")):
            seen = seen_landmarks(track, numbers, frames, lens)
            rows = np.searchsorted(numbers, track.image_numbers)
            poses = poses_of(seen, frames.frame_numbers[rows], body, config)
            poses.write(partial / person_file(n))
        LocalPosesRecord(
            people=len(people),
            images=len(numbers),
            frames=int(frames.frame_numbers[-1]) + 1,
            size_px=followed.size_px,
            body=body.name,
            method=config.method,
        ).write(partial / POSES_FILE)

    inputs = {"followed": followed_dir, "body": body_path, "lifter": WEIGHTS_FILE}
    return run_stage("local_poses", out_dir, recipe, inputs, work, run=run)


def seen_landmarks(
    track: Sightings, numbers: np.ndarray, frames: FrameSet, lens: Lens
) -> SeenLandmarks:
    """A track's landmarks as rays without distortion, at its times."""
    rows = np.searchsorted(numbers, track.image_numbers)
    per_image = float(np.median(np.diff(frames.frame_numbers))) if len(numbers) > 1 else 1.0
    return SeenLandmarks(
        times_s=frames.frame_numbers[rows] / (per_image * frames.rate_hz),
        rays=lens.rays(track.image_px),
        world_m=track.world_m,
        visibility=track.visibility,
    )


def poses_of(
    seen: SeenLandmarks, frame_numbers: np.ndarray, body: BodyModel, config: LocalPosesConfig
) -> LocalPoses:
    """One person's poses and places on a body of mean shape."""
    rest_joints_m = body.rest_joints_m(np.zeros(body.n_shape))
    start = None if config.method == "fit" else smoothed(lift(seen), seen.times_s, config.smooth_s)
    rotmats = start.rotmats if start is not None else None
    if config.method != "lifter":
        rotmats = fit(seen, rest_joints_m, config.fit, start).rotmats
    assert rotmats is not None
    return LocalPoses(
        frame_numbers=frame_numbers,
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=place(seen, rotmats, rest_joints_m),
    )


def smoothed(pose: LiftedPose, times_s: np.ndarray, deviation_s: float) -> LiftedPose:
    """Rotations averaged with their neighbours in time (chordal means)."""
    if deviation_s == 0:
        return pose
    apart = (times_s[:, None] - times_s) / deviation_s
    weights = np.exp(-0.5 * apart**2) * (np.abs(apart) < 4)
    sums = np.einsum("ts,sjab->tjab", weights, pose.rotmats)
    u, _, vt = np.linalg.svd(sums)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return LiftedPose(u @ vt, pose.leg_m)


def place(seen: SeenLandmarks, rotmats: np.ndarray, rest_joints_m: np.ndarray) -> np.ndarray:
    """The pelvis (T, 3) [m] of a body with rest joints (24, 3) and rotations (T, 24, 3, 3)."""
    about_m = landmarks_about(rotmats, rest_joints_m)
    weights = landmark_weights(torch.as_tensor(seen.visibility)).numpy()
    factors = np.ones_like(weights)
    pelvis_m = np.zeros((len(rotmats), 3))
    for _ in range(ROUNDS):
        pelvis_m = _solve(about_m, seen.rays, weights * factors, seen.times_s)
        placed_m = about_m + pelvis_m[:, None]
        depth_m = np.maximum(placed_m[..., 2:], LEAST_DEPTH_M)
        off_m = np.linalg.norm((placed_m[..., :2] / depth_m - seen.rays) * depth_m, axis=-1)
        factors = 1 / (1 + (off_m / (2 * ERROR_M)) ** 2)
    return pelvis_m


def landmarks_about(rotmats: np.ndarray, rest_joints_m: np.ndarray) -> np.ndarray:
    """Landmarks (T, 33, 3) from the pelvis [m]."""
    joints_m, turned = tree_joints(torch.as_tensor(rest_joints_m), torch.as_tensor(rotmats))
    leg_m = torch.full((len(rotmats),), leg_length_m(rest_joints_m), dtype=torch.float64)
    return landmarks_on(joints_m, turned, leg_m, torch.as_tensor(landmark_offsets_m())).numpy()


def _solve(
    about_m: np.ndarray, rays: np.ndarray, weights: np.ndarray, times_s: np.ndarray
) -> np.ndarray:
    """The pelvis (T, 3) of weighted least squares, all frames at once."""
    from scipy.sparse import block_diag, diags, eye, kron
    from scipy.sparse.linalg import spsolve

    n = len(about_m)
    u = rays
    ones, zeros = np.ones(u.shape[:2]), np.zeros(u.shape[:2])
    by_x = np.stack([ones, zeros, -u[..., 0]], axis=-1)
    by_y = np.stack([zeros, ones, -u[..., 1]], axis=-1)
    design = np.concatenate([by_x, by_y], axis=1)
    off_m = u * about_m[..., 2:] - about_m[..., :2]
    target_m = np.concatenate([off_m[..., 0], off_m[..., 1]], axis=1)
    both = np.concatenate([weights, weights], axis=1) / (ALIKE * ERROR_M**2)
    normal = np.einsum("tn,tni,tnj->tij", both, design, design)
    right = np.einsum("tn,tni,tn->ti", both, design, target_m)
    whole = block_diag(list(normal), format="csc")
    if n > 2:
        usual = np.tile([1 / ACCELERATION, 1 / ACCELERATION, 1 / DEPTH_ACCELERATION], n - 2)
        each = kron(_second_differences(times_s), eye(3))
        whole = whole + each.T @ diags(usual**2) @ each
    return np.asarray(spsolve(whole.tocsc(), right.ravel())).reshape(n, 3)


def _second_differences(times_s: np.ndarray) -> Any:
    """Sparse (T - 2, T), from values to their second differences per second squared."""
    from scipy.sparse import diags

    steps_s = np.diff(times_s)
    before, after = 1 / steps_s[:-1], 1 / steps_s[1:]
    between_s = (steps_s[1:] + steps_s[:-1]) / 2
    lines = [before / between_s, -(before + after) / between_s, after / between_s]
    return diags(lines, [0, 1, 2], shape=(len(times_s) - 2, len(times_s)))
