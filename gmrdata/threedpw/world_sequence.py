"""People and a camera in our z-up world as a sequence of 3DPW: what twins and exports write."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.motion.resample import resample, valid_runs
from gmrdata.read.numbers import usable_rows
from gmrdata.read.threedpw_arrays import FPS_HZ, IMU_HZ, SMPL_SHAPES, Person, SequenceArrays
from gmrdata.threedpw.camera_frame import WORLD_FROM_3DPW
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadSequence
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, invert

IMU_ROWS = round(IMU_HZ / FPS_HZ)
_3DPW_FROM_WORLD = invert(WORLD_FROM_3DPW)


def sequence_arrays(
    name: str,
    clips: Sequence[Clip],
    bodies: Sequence[BodyModel],
    genders: Sequence[str],
    poses2d_px: Sequence[np.ndarray],
) -> SequenceArrays:
    """Arrays of a sequence whose people and camera are given in our z-up world.

    The pelvis becomes SMPL's `trans` and the world y-up here; `camera_clip` and `world_clip` of the
    result are the clips again.  Clips, bodies, genders ("female" or "male") and keypoints
    (N, 18, 3) are one per person; clips are at 30 Hz with one camera.  Frames that are `valid` and
    have a camera are `campose_valid`; what is not known of the others is NaN.
    """
    _require_one_camera(name, clips)
    camera = camera_of(clips[0])
    people = zip(clips, bodies, genders, poses2d_px, strict=True)
    return SequenceArrays(
        name=name,
        intrinsics_px=camera.intrinsics_px.copy(),
        cam_from_world=invert(camera.world_from_cam) @ WORLD_FROM_3DPW,
        img_frame_ids=IMU_ROWS * np.arange(camera.n_frames),
        people=tuple(_person(*person, camera) for person in people),
    )


def with_original(arrays: SequenceArrays, original: SequenceArrays) -> SequenceArrays:
    """The same people with the 2D keypoints and the clothed templates of 3DPW's own file.

    BadSequence where that file has other frames or people.
    """
    found = [(arrays.n_frames, [one.gender for one in arrays.people])]
    found += [(original.n_frames, [one.gender for one in original.people])]
    if found[0] != found[1]:
        texts = [f"{n} frames of {', '.join(genders)}" for n, genders in found]
        raise BadSequence(f"{arrays.name}: {texts[0]}, but 3DPW's own file has {texts[1]}")
    people = (
        replace(
            person,
            poses2d_px=theirs.poses2d_px,
            betas_clothed=theirs.betas_clothed,
            template_clothed_m=theirs.template_clothed_m,
        )
        for person, theirs in zip(arrays.people, original.people, strict=True)
    )
    return replace(arrays, people=tuple(people))


def _require_one_camera(name: str, clips: Sequence[Clip]) -> None:
    first = camera_of(clips[0])
    for clip in clips:
        camera = camera_of(clip)
        if clip.motion.frame != "world" or clip.motion.fps_hz != FPS_HZ:
            found = f"is in the {clip.motion.frame} frame at {clip.motion.fps_hz:g} Hz"
            needed = f"a sequence needs the world frame at {FPS_HZ:g} Hz"
            raise BadSequence(f"{name}: clip {clip.id} {found}; {needed}")
        same_path = np.array_equal(camera.world_from_cam, first.world_from_cam, equal_nan=True)
        if not (same_path and np.array_equal(camera.intrinsics_px, first.intrinsics_px)):
            found = f"has another camera than {clips[0].id}"
            needed = "people of a sequence share one camera"
            raise BadSequence(f"{name}: clip {clip.id} {found}; {needed}")


def _person(
    clip: Clip, body: BodyModel, gender: str, poses2d_px: np.ndarray, camera: CameraPath
) -> Person:
    from gmrdata.values.skinning import motion_joints_m

    motion = clip.motion
    shape = np.asarray(motion.shape, dtype=np.float64)
    betas = np.pad(shape, (0, max(0, SMPL_SHAPES - len(shape))))
    poses_60hz_rad, trans_60hz_m = _at_60hz(motion, body.rest_pelvis_m(shape))
    to_3dpw = np.broadcast_to(_3DPW_FROM_WORLD, (motion.n_frames, 4, 4))
    return Person(
        poses_rad=poses_60hz_rad[::IMU_ROWS].copy(),
        trans_m=trans_60hz_m[::IMU_ROWS].copy(),
        betas=betas,
        gender=gender,
        campose_valid=clip.valid & camera.has_camera,
        poses2d_px=poses2d_px,
        poses_60hz_rad=poses_60hz_rad,
        trans_60hz_m=trans_60hz_m,
        joints_world_m=apply(to_3dpw, motion_joints_m(body, motion)),
        betas_clothed=betas.copy(),
        template_clothed_m=body.rest_vertices_m(shape),
    )


def _at_60hz(motion: Motion, rest_pelvis_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2N, 72) axis-angle and (2N, 3) `trans` in the y-up world, at the IMUs' rate.

    The last row of a run of known frames holds, as there is nothing after it; rows between are NaN.
    """
    poses_rad = np.full((IMU_ROWS * motion.n_frames, 72), np.nan)
    trans_m = np.full((IMU_ROWS * motion.n_frames, 3), np.nan)
    for start, stop in valid_runs(usable_rows(motion.rotmats, motion.pelvis_m)):
        between = resample(motion.take(slice(start, stop)), IMU_HZ)
        rows = np.arange(IMU_ROWS * (stop - start)).clip(max=between.n_frames - 1)
        at = slice(IMU_ROWS * start, IMU_ROWS * stop)
        poses_rad[at], trans_m[at] = _poses_and_trans(between.take(rows), rest_pelvis_m)
    return poses_rad, trans_m


def _poses_and_trans(motion: Motion, rest_pelvis_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, 72) axis-angle and (M, 3) `trans` in the y-up world."""
    to_3dpw = _3DPW_FROM_WORLD[:3, :3]
    rotmats = replace(motion, root_rotmats=to_3dpw @ motion.root_rotmats).rotmats
    rotvecs = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    trans_m = motion.pelvis_m @ to_3dpw.T - rest_pelvis_m
    return rotvecs.reshape(-1, 72), trans_m
