"""From world-frame Clips of one camera to the arrays of a sequence file."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, camera_of
from gmrdata.errors import BadSequence
from gmrdata.geometry.transforms import apply, invert
from gmrdata.motion.motion import Motion
from gmrdata.motion.resample import resample
from gmrdata.threedpw.arrays import FPS_HZ, IMU_HZ, Person, SequenceArrays
from gmrdata.threedpw.camera_frame import WORLD_FROM_3DPW

IMU_ROWS = round(IMU_HZ / FPS_HZ)
_3DPW_FROM_WORLD = invert(WORLD_FROM_3DPW)


def sequence_arrays(
    name: str,
    clips: Sequence[Clip],
    body: BodyModel,
    genders: Sequence[str],
    poses2d_px: Sequence[np.ndarray],
) -> SequenceArrays:
    """Arrays of a sequence whose people and camera are given in our z-up world.

    The pelvis becomes SMPL's `trans` and the world y-up here; `camera_clip` and `world_clip` of the
    result are the clips again.

    Args:
        name: Name of the sequence.
        clips: One clip per person, `frame` "world", 30 Hz, with the same camera for every frame.
            `valid` becomes `campose_valid`.
        body: The body of all clips.
        genders: "female" or "male" per person, which a 3DPW file can't do without.
        poses2d_px: (N, 18, 3) keypoints per person.

    Raises:
        BadSequence: the clips have not one camera, rate and length, or are not in the world.
    """
    camera = camera_of(clips[0])
    _require_one_camera(name, clips)
    n_frames = camera.n_frames
    people = zip(clips, genders, poses2d_px, strict=True)
    return SequenceArrays(
        name=name,
        intrinsics_px=camera.intrinsics_px.copy(),
        cam_from_world=invert(camera.world_from_cam) @ WORLD_FROM_3DPW,
        img_frame_ids=IMU_ROWS * np.arange(n_frames),
        people=tuple(_person(clip, body, gender, points) for clip, gender, points in people),
    )


def _require_one_camera(name: str, clips: Sequence[Clip]) -> None:
    first = camera_of(clips[0])
    for clip in clips:
        camera = camera_of(clip)
        if clip.motion.frame != "world" or clip.motion.fps_hz != FPS_HZ:
            raise BadSequence(
                f"{name}: clip {clip.id} is in the {clip.motion.frame} frame at "
                f"{clip.motion.fps_hz:g} Hz; a sequence needs the world frame at {FPS_HZ:g} Hz"
            )
        same = np.array_equal(camera.world_from_cam, first.world_from_cam) and np.array_equal(
            camera.intrinsics_px, first.intrinsics_px
        )
        if not same or not camera.has_camera.all():
            raise BadSequence(
                f"{name}: clip {clip.id} has another camera than {clips[0].id}, or frames without; "
                "people of a sequence share one camera"
            )


def _person(clip: Clip, body: BodyModel, gender: str, poses2d_px: np.ndarray) -> Person:
    from gmrdata.body.skin import motion_joints_m  # torch; reading needs none

    motion = clip.motion
    rest_pelvis_m = body.rest_pelvis_m(motion.shape)
    poses_60hz_rad, trans_60hz_m = _poses_and_trans(_at_60hz(motion), rest_pelvis_m)
    joints_m = motion_joints_m(body, motion)
    n_frames = motion.n_frames
    return Person(
        poses_rad=poses_60hz_rad[::IMU_ROWS].copy(),
        trans_m=trans_60hz_m[::IMU_ROWS].copy(),
        betas=np.asarray(motion.shape, dtype=np.float64),
        gender=gender,
        campose_valid=clip.valid.copy(),
        poses2d_px=poses2d_px,
        poses_60hz_rad=poses_60hz_rad,
        trans_60hz_m=trans_60hz_m,
        joints_world_m=apply(np.broadcast_to(_3DPW_FROM_WORLD, (n_frames, 4, 4)), joints_m),
        betas_clothed=np.asarray(motion.shape, dtype=np.float64),
        template_clothed_m=body.template_m + body.shape_dirs_m @ motion.shape,
    )


def _at_60hz(motion: Motion) -> Motion:
    """The motion at the IMUs' rate, 2N rows: the last one holds, as there is nothing after it."""
    between = resample(motion, IMU_HZ)
    rows = np.minimum(np.arange(IMU_ROWS * motion.n_frames), between.n_frames - 1)
    return Motion(
        local_rotmats=between.local_rotmats[rows],
        root_rotmats=between.root_rotmats[rows],
        pelvis_m=between.pelvis_m[rows],
        shape=motion.shape,
        fps_hz=IMU_HZ,
        body=motion.body,
        gender=motion.gender,
        frame=motion.frame,
        source=motion.source,
    )


def _poses_and_trans(motion: Motion, rest_pelvis_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, 72) axis-angle and (M, 3) `trans` in the y-up world."""
    to_3dpw = _3DPW_FROM_WORLD[:3, :3]
    rotmats = np.concatenate(
        [(to_3dpw @ motion.root_rotmats)[:, None], motion.local_rotmats], axis=1
    )
    rotvecs = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    trans_m = motion.pelvis_m @ to_3dpw.T - rest_pelvis_m
    return rotvecs.reshape(-1, 72), trans_m
