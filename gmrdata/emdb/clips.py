"""A sequence of EMDB as a clip: person and camera in one z-up world."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.emdb.layout import FPS_HZ
from gmrdata.emdb.parse import EmdbSequence, rigid_rows
from gmrdata.errors import BadBodyFile
from gmrdata.geometry.camera import CameraPath
from gmrdata.geometry.transforms import apply, invert, rigid
from gmrdata.given_numbers import usable_rows
from gmrdata.motion.motion import Motion

WORLD_FROM_EMDB = rigid(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
"""(4, 4): EMDB's world is y-up, ours z-up."""


def sequence_clip(clip_id: str, sequence: EmdbSequence, body: BodyModel) -> Clip:
    """The person and the camera in the z-up world.

    A frame is valid where EMDB calls it good and pose and camera are finite and rigid; frames
    without finite numbers are NaN.

    Args:
        clip_id: The clip's name.
        sequence: The sequence.
        body: SMPL's body of its gender, see `body_of`.

    Returns:
        The clip; its image numbers are those of the files, from 0.
    """
    has_pose = usable_rows(sequence.poses_rad, sequence.trans_m)
    has_camera = rigid_rows(sequence.cam_from_world)
    n_frames = sequence.n_frames
    shape = sequence.betas[: body.n_shape].copy()
    rotmats = np.full((n_frames, 24, 3, 3), np.nan)
    if has_pose.any():
        rotvecs = sequence.poses_rad[has_pose].reshape(-1, 3)
        rotmats[has_pose] = Rotation.from_rotvec(rotvecs).as_matrix().reshape(-1, 24, 3, 3)
    pelvis_emdb_m = np.where(has_pose[:, None], sequence.trans_m, np.nan) + body.rest_pelvis_m(
        shape
    )
    world_from_cam = np.full((n_frames, 4, 4), np.nan)
    world_from_cam[has_camera] = WORLD_FROM_EMDB @ invert(sequence.cam_from_world[has_camera])
    motion = Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=WORLD_FROM_EMDB[:3, :3] @ rotmats[:, 0],
        pelvis_m=apply(WORLD_FROM_EMDB, pelvis_emdb_m),
        shape=shape,
        fps_hz=FPS_HZ,
        body=body.name,
        gender=sequence.gender,
        frame="world",
        source=f"EMDB {sequence.name}",
    )
    camera = CameraPath(
        sequence.intrinsics_px,
        sequence.width_px,
        sequence.height_px,
        world_from_cam,
        has_camera,
    )
    valid = sequence.good & has_pose & has_camera
    return Clip(clip_id, motion, valid, np.arange(n_frames), camera)


def dropped_reasons(sequence: EmdbSequence) -> list[str]:
    """Why each frame can't be used: (N,) texts, empty where it can."""
    has_pose = usable_rows(sequence.poses_rad, sequence.trans_m)
    has_camera = rigid_rows(sequence.cam_from_world)
    tests = (
        (sequence.good, "good_frames_mask is False"),
        (has_pose, "poses or trans is not finite"),
        (has_camera, "extrinsics is no rigid transform"),
    )
    reasons = [""] * sequence.n_frames
    for passed, why in tests:
        reasons = [old or ("" if good else why) for old, good in zip(reasons, passed, strict=True)]
    return reasons


def body_of(sequence: EmdbSequence, bodies: Sequence[BodyModel]) -> BodyModel:
    """SMPL's body of the sequence's gender.

    Raises:
        BadBodyFile: it is not among them, or has more shape coefficients than the file.
    """
    wanted = f"smpl-{sequence.gender}"
    fits = [b for b in bodies if b.name == wanted and b.n_shape <= len(sequence.betas)]
    if not fits:
        given = ", ".join(f"{b.name} with {b.n_shape} coefficients" for b in bodies) or "none"
        raise BadBodyFile(
            f"{sequence.name}: needs the body {wanted} with up to {len(sequence.betas)} shape"
            f" coefficients, given: {given}. Give --body a folder with SMPL's models"
        )
    return fits[0]


def tilt_deg(clip: Clip) -> float:
    """Angle of the body's mean own axis from straight up [deg]: what a wrong idea of where up is
    would show in; NaN without valid frames."""
    if not clip.valid.any():
        return float("nan")
    axis = clip.motion.root_rotmats[clip.valid, :, 1].mean(axis=0)
    return float(np.rad2deg(np.arccos(np.clip(axis[2] / np.linalg.norm(axis), -1.0, 1.0))))
