"""3DPW's people and camera as clips in the camera's frame and in our z-up world, and back.

3DPW's `trans` is not the pelvis.  A rigid transform (A, b) takes `trans` to A (J0 + trans) + b - J0
and the root rotation R to A R; with the pelvis = trans + J0 it is simply A pelvis + b.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.motion.resample import resample, valid_runs
from gmrdata.read.numbers import rigid_rows, smpl_rotmats, usable_rows
from gmrdata.read.threedpw import Sequence3DPW, ValidRule, unusable_reasons
from gmrdata.read.threedpw_files import FPS_HZ, IMU_HZ, SequenceArrays, ThreedpwPerson
from gmrdata.values.body import SMPL, SMPL_SHAPES, BodyModel, shape_on
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadBodyFile, BadSequence
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, invert, rigid, rotvecs_from_rotmats
from gmrdata.world.compose import moved

WORLD_FROM_3DPW = rigid(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
"""(4, 4): 3DPW's world is y-up, ours z-up."""
SAME_PELVIS_M = 0.02
"""Largest distance of a body's pelvis from that of `jointPositions` [m]; bodies of SMPL's family
differ by less, other bodies by much more."""


def camera_clip(
    sequence: Sequence3DPW,
    person_index: int,
    bodies: Sequence[BodyModel],
    rule: ValidRule = "campose_valid",
) -> Clip:
    """One person as the camera sees them: `cam_poses` applied to the person in the world.

    3DPW's drift is common to person and camera, so it is not in here.  Frames that can't be used
    are not `valid`; those without finite numbers are NaN.  The clip `<sequence>.p<person>` has the
    sequence's intrinsics and no camera poses; its image numbers are those of the files, -1 where
    the image can't be used.  BadBodyFile where no body fits the person.
    """
    clip, cam_from_world = _in_dataset_world(sequence, person_index, bodies, rule)
    nowhere = np.zeros(sequence.n_frames, dtype=bool)
    camera = _camera(sequence, np.full((sequence.n_frames, 4, 4), np.nan), nowhere)
    motion = moved(clip.motion, cam_from_world, "world", "camera")
    return replace(clip, motion=motion, camera=camera)


def world_clip(
    sequence: Sequence3DPW,
    person_index: int,
    bodies: Sequence[BodyModel],
    rule: ValidRule = "campose_valid",
) -> Clip:
    """One person and the camera in the dataset's own world, turned z-up: metric, and it drifts.

    Arguments and errors as in `camera_clip`.  A frame that is not valid for this person has no
    camera here either, since 3DPW aligns its cameras person by person.
    """
    clip, cam_from_world = _in_dataset_world(sequence, person_index, bodies, rule)
    world_from_cam = np.full((sequence.n_frames, 4, 4), np.nan)
    world_from_cam[clip.valid] = WORLD_FROM_3DPW @ invert(cam_from_world[clip.valid])
    turn = np.broadcast_to(WORLD_FROM_3DPW, world_from_cam.shape)
    motion = moved(clip.motion, turn, "world", "world")
    return replace(clip, motion=motion, camera=_camera(sequence, world_from_cam, clip.valid))


def _camera(
    sequence: Sequence3DPW, world_from_cam: np.ndarray, has_camera: np.ndarray
) -> CameraPath:
    size_px = sequence.images.width_px, sequence.images.height_px
    return CameraPath(sequence.arrays.intrinsics_px, *size_px, world_from_cam, has_camera)


def fitting_body(person: ThreedpwPerson, bodies: Sequence[BodyModel], where: str) -> BodyModel:
    """The body that a person's betas belong to.

    An SMPL body must be of the person's gender, since 3DPW's betas are; of other bodies (the twins'
    body) the first is taken, whose betas must not be fewer than the body has.  Where the file has
    joints, the body's pelvis must be at theirs: else BadBodyFile, which begins with `where`.
    """
    gendered = f"{SMPL}{person.gender}"
    fits = [body for body in bodies if body.name == gendered or not body.name.startswith(SMPL)]
    if not fits:
        names = ", ".join(body.name for body in bodies) or "none"
        what = f"needs SMPL's {person.gender} body, given: {names}"
        raise BadBodyFile(f"{where}: {what}; 3DPW's betas are those of the gendered bodies")
    body = fits[0]
    remedy = "give the body that the file was made with"
    if len(person.betas) < body.n_shape and not body.name.startswith(SMPL):
        what = f"has {len(person.betas)} betas, body {body.name} needs {body.n_shape}"
        raise BadBodyFile(f"{where}: {what}; {remedy}")
    off_m = _pelvis_off_m(person, body)
    if off_m > SAME_PELVIS_M:
        what = f"the pelvis of body {body.name} is {1000 * off_m:.0f} mm from that of"
        raise BadBodyFile(f"{where}: {what} jointPositions; {remedy}")
    return body


def pelvis_3dpw_m(person: ThreedpwPerson, body: BodyModel) -> np.ndarray:
    """(N, 3) pelvis in the dataset's y-up world [m]: `trans` + J0(betas)."""
    return person.trans_m + body.rest_pelvis_m(shape_on(body, person.betas))


def _in_dataset_world(
    sequence: Sequence3DPW, person_index: int, bodies: Sequence[BodyModel], rule: ValidRule
) -> tuple[Clip, np.ndarray]:
    """The person in the dataset's y-up world, and cam_from_world; NaN where not usable."""
    person = sequence.arrays.people[person_index]
    body = fitting_body(person, bodies, f"{sequence.files.pickle_path}: person {person_index}")
    valid = np.array(unusable_reasons(sequence, person_index, rule)) == ""
    has_image = np.array(sequence.images.faults) == ""
    rotmats = smpl_rotmats(person.poses_rad)
    pelvis_m = pelvis_3dpw_m(person, body)
    pelvis_m[~usable_rows(person.trans_m)] = np.nan
    motion = Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=pelvis_m,
        shape=shape_on(body, person.betas),
        fps_hz=FPS_HZ,
        body=body.name,
        gender=person.gender,
        frame="world",
        source=f"3DPW {sequence.files.split}/{sequence.name}, person {person_index}, "
        f"valid by {rule}",
    )
    image_numbers = np.where(has_image, np.arange(sequence.n_frames), -1)
    clip = Clip(f"{sequence.name}.p{person_index}", motion, valid, image_numbers, None)
    cam_from_world = sequence.arrays.cam_from_world
    return clip, np.where(rigid_rows(cam_from_world)[:, None, None], cam_from_world, np.nan)


def _pelvis_off_m(person: ThreedpwPerson, body: BodyModel) -> float:
    """Median distance of the body's pelvis from the file's; 0 where the file has no joints."""
    if person.joints_world_m is None:
        return 0.0
    between_m = person.joints_world_m[:, 0] - pelvis_3dpw_m(person, body)
    off_m = np.linalg.norm(between_m[usable_rows(between_m)], axis=1)
    return float(np.median(off_m)) if len(off_m) else 0.0


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
    both = [(arrays.n_frames, [one.gender for one in arrays.people])]
    both += [(original.n_frames, [one.gender for one in original.people])]
    if both[0] != both[1]:
        texts = [f"{n} frames of {', '.join(genders)}" for n, genders in both]
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
            fault = f"is in the {clip.motion.frame} frame at {clip.motion.fps_hz:g} Hz"
            needed = f"a sequence needs the world frame at {FPS_HZ:g} Hz"
            raise BadSequence(f"{name}: clip {clip.id} {fault}; {needed}")
        same_path = np.array_equal(camera.world_from_cam, first.world_from_cam, equal_nan=True)
        if not (same_path and np.array_equal(camera.intrinsics_px, first.intrinsics_px)):
            fault = f"has another camera than {clips[0].id}"
            needed = "people of a sequence share one camera"
            raise BadSequence(f"{name}: clip {clip.id} {fault}; {needed}")


def _person(
    clip: Clip, body: BodyModel, gender: str, poses2d_px: np.ndarray, camera: CameraPath
) -> ThreedpwPerson:
    from gmrdata.values.skinning import motion_joints_m

    motion = clip.motion
    shape = np.asarray(motion.shape, dtype=np.float64)
    betas = np.pad(shape, (0, max(0, SMPL_SHAPES - len(shape))))
    poses_60hz_rad, trans_60hz_m = _at_60hz(motion, body.rest_pelvis_m(shape))
    to_3dpw = np.broadcast_to(_3DPW_FROM_WORLD, (motion.n_frames, 4, 4))
    return ThreedpwPerson(
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
    trans_m = motion.pelvis_m @ to_3dpw.T - rest_pelvis_m
    return rotvecs_from_rotmats(rotmats).reshape(-1, 72), trans_m
