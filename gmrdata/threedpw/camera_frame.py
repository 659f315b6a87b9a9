"""People of a sequence as Clips: as the camera sees them, and in the dataset's own world.

3DPW's `trans` is not the pelvis.  A rigid transform (A, b) takes `trans` to A (J0 + trans) + b - J0
and the root rotation R to A R; with the pelvis = trans + J0 it is simply A pelvis + b.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.numbers import rigid_rows, smpl_rotmats, usable_rows
from gmrdata.read.threedpw import Sequence3DPW, ValidRule, unusable_reasons
from gmrdata.read.threedpw_arrays import FPS_HZ, Person
from gmrdata.values.body import SMPL, BodyModel, shape_on
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, invert, rigid

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
    return replace(clip, motion=_moved(clip.motion, cam_from_world, "camera"), camera=camera)


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
    motion = _moved(clip.motion, np.broadcast_to(WORLD_FROM_3DPW, world_from_cam.shape), "world")
    return replace(clip, motion=motion, camera=_camera(sequence, world_from_cam, clip.valid))


def _camera(
    sequence: Sequence3DPW, world_from_cam: np.ndarray, has_camera: np.ndarray
) -> CameraPath:
    size_px = sequence.images.width_px, sequence.images.height_px
    return CameraPath(sequence.arrays.intrinsics_px, *size_px, world_from_cam, has_camera)


def fitting_body(person: Person, bodies: Sequence[BodyModel], where: str) -> BodyModel:
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


def shape_of(person: Person, body: BodyModel) -> np.ndarray:
    """(S,) the betas that the body has; longer ones are cut, as every reader of 3DPW does."""
    return shape_on(body, person.betas)


def pelvis_3dpw_m(person: Person, body: BodyModel) -> np.ndarray:
    """(N, 3) pelvis in the dataset's y-up world [m]: `trans` + J0(betas)."""
    return person.trans_m + body.rest_pelvis_m(shape_of(person, body))


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
        shape=shape_of(person, body),
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


def _moved(motion: Motion, a_from_b: np.ndarray, frame: Literal["world", "camera"]) -> Motion:
    with np.errstate(invalid="ignore"):
        return replace(
            motion,
            root_rotmats=a_from_b[:, :3, :3] @ motion.root_rotmats,
            pelvis_m=apply(a_from_b, motion.pelvis_m[:, None])[:, 0],
            frame=frame,
        )


def _pelvis_off_m(person: Person, body: BodyModel) -> float:
    """Median distance of the body's pelvis from the file's; 0 where the file has no joints."""
    if person.joints_world_m is None:
        return 0.0
    between_m = person.joints_world_m[:, 0] - pelvis_3dpw_m(person, body)
    off_m = np.linalg.norm(between_m[usable_rows(between_m)], axis=1)
    return float(np.median(off_m)) if len(off_m) else 0.0
