"""A take as a clip in the world, with one of the four cameras."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadBodyFile
from gmrdata.geometry.camera import CameraPath
from gmrdata.given_numbers import usable_rows
from gmrdata.human36m.layout import ACTIONS, SIZES_PX, VIDEO_HZ
from gmrdata.human36m.parse import FixedCamera, Take
from gmrdata.motion.motion import Motion


def take_clip(
    subject: int, take: Take, camera_number: int, camera: FixedCamera, body: BodyModel
) -> Clip:
    """A take at the rate of its frames: 10 Hz where, as published, each fifth frame was fitted.

    Frames without parameters, or with NaN, are rows that are not valid.  Each frame's pelvis is its
    `trans` + J0 of its own betas; the clip's shape is the mean of the betas of the valid frames.

    Args:
        subject: Number of the subject.
        take: The take.
        camera_number: Which camera, 1 to 4.
        camera: That camera.
        body: SMPL's neutral body.

    Returns:
        Clip `S<subject>.<action>.<subaction>`; image numbers count from 1, as the image files do.

    Raises:
        BadBodyFile: the body isn't SMPL's neutral one.
    """
    clip_id = clip_name(subject, take)
    if body.name != "smpl-neutral" or body.n_shape > take.shapes.shape[1]:
        raise BadBodyFile(
            f"{clip_id}: the betas are of SMPL's neutral body with {take.shapes.shape[1]}"
            f" coefficients, given: {body.name} with {body.n_shape}. Give --body SMPL_NEUTRAL.pkl"
        )
    step = _step(take.frames)
    on_grid = take.frames % step == _most_common(take.frames % step)
    numbers = np.arange(take.frames[on_grid][0], take.frames[on_grid][-1] + 1, step)
    n_rows = len(numbers)
    usable = on_grid & usable_rows(take.poses_rad, take.shapes, take.trans_m)
    rows = (take.frames[usable] - numbers[0]) // step
    valid = np.zeros(n_rows, dtype=bool)
    valid[rows] = True
    shapes = take.shapes[usable, : body.n_shape]
    rotmats = np.full((n_rows, 24, 3, 3), np.nan)
    pelvis_m = np.full((n_rows, 3), np.nan)
    if len(rows):
        rotvecs = take.poses_rad[usable].reshape(-1, 3)
        rotmats[rows] = Rotation.from_rotvec(rotvecs).as_matrix().reshape(-1, 24, 3, 3)
        rest_pelvis_m = body.joints_template_m[0] + shapes @ body.joint_shape_dirs_m[0].T
        pelvis_m[rows] = take.trans_m[usable] + rest_pelvis_m
    motion = Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=pelvis_m,
        shape=shapes.mean(axis=0) if len(rows) else np.zeros(body.n_shape),
        fps_hz=VIDEO_HZ / step,
        body=body.name,
        gender="neutral",
        frame="world",
        source=f"Human3.6M S{subject} {ACTIONS[take.action]} {take.subaction}: each"
        f" {step}. frame of the 50 Hz video, {n_rows - len(rows)} of {n_rows} without parameters,"
        f" {int((~on_grid).sum())} between them left out, camera {camera_number}",
    )
    width_px, height_px = SIZES_PX[camera_number]
    path = CameraPath(
        camera.intrinsics_px,
        width_px,
        height_px,
        np.tile(camera.world_from_cam, (n_rows, 1, 1)),
        np.ones(n_rows, dtype=bool),
    )
    return Clip(clip_id, motion, valid, numbers + 1, path)


def clip_name(subject: int, take: Take) -> str:
    """`S9.Directions.1`."""
    return f"S{subject}.{ACTIONS[take.action]}.{take.subaction}"


def _step(frames: np.ndarray) -> int:
    """Most common distance of neighbouring frames; 1 for a single frame."""
    return _most_common(np.diff(frames)) if len(frames) > 1 else 1


def _most_common(values: np.ndarray) -> int:
    return int(np.bincount(values).argmax())
