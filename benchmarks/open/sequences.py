"""Motions through the files of data sets and other systems: written, and read by the readers.

Those layouts have no frame rate of their own, or always 30 Hz, so frames are counted as theirs and
get their rate back.  What a layout has no place for is taken over from the motion and said here.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.motion.emdb import sequence_clip
from gmrdata.read.emdb import FPS_HZ, read_emdb
from gmrdata.read.systems.result import read_system
from gmrdata.read.threedpw import Sequence3DPW, SequenceImages
from gmrdata.read.threedpw_files import SequenceFiles, read_sequence_file
from gmrdata.threedpw.clips import sequence_arrays, world_clip
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion
from gmrdata.values.people import EstimatedPerson
from gmrdata.write.emdb import emdb_sequence, write_emdb
from gmrdata.write.systems import TrackedPerson, gvhmr_bytes, wham_bytes
from gmrdata.write.threedpw import sequence_bytes

WIDTH_PX, HEIGHT_PX = 640, 480


def threedpw(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    """3DPW's bodies are female or male; another one is called female on the way."""
    gender = motion.gender if motion.gender != "neutral" else "female"
    named = replace(body, name=f"smpl-{gender}")
    clip = _filmed(replace(motion, body=named.name))
    unseen = [np.zeros((motion.n_frames, 18, 3))]
    arrays = sequence_arrays("walk", [clip], [named], [gender], unseen)
    path = folder / "walk.pkl"
    write_bytes(path, sequence_bytes(arrays))
    images = SequenceImages((), WIDTH_PX, HEIGHT_PX, ("",) * motion.n_frames, ())
    files = SequenceFiles(folder, "walk", "test")
    sequence = Sequence3DPW(files, read_sequence_file(path), images, ())
    return _as(motion, world_clip(sequence, 0, [named]).motion)


def emdb(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    """EMDB has ten shape coefficients: of more, the others are taken over."""
    ten = np.where(np.arange(len(motion.shape)) < 10, motion.shape, 0.0)
    clip = _filmed(replace(motion, shape=ten))
    sequence = emdb_sequence("P0_walk", clip, body, (True, True))
    nothing_px = np.full((motion.n_frames, 24, 2), np.nan)
    write_emdb(folder / "walk_data.pkl", sequence, nothing_px, nothing_px[:, :2].reshape(-1, 4))
    found = sequence_clip("walk", read_emdb(folder / "walk_data.pkl"), body).motion
    return _as(motion, replace(found, shape=motion.shape))


def wham(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    write_bytes(folder / "wham_output.pkl", wham_bytes([_tracked(motion, body)]))
    return _of_result(folder / "wham_output.pkl", motion, body)


def gvhmr(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    """SMPL-X's body has no two hand joints: these are taken over."""
    write_bytes(folder / "hmr4d_results.pt", gvhmr_bytes(_tracked(motion, body)))
    found = _of_result(folder / "hmr4d_results.pt", motion, body)
    local_rotmats = np.concatenate(
        [found.local_rotmats[:, :21], motion.local_rotmats[:, 21:]], axis=1
    )
    return replace(found, local_rotmats=local_rotmats)


def _filmed(motion: Motion) -> Clip:
    """The motion at 30 Hz, and a camera 50 m south of where it begins, which looks north."""
    n, motion = motion.n_frames, replace(motion, fps_hz=FPS_HZ)
    world_from_cam = np.eye(4)
    world_from_cam[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    world_from_cam[:3, 3] = motion.pelvis_m[0] - [0, 50.0, 0]
    intrinsics_px = intrinsics_from_fov(60.0, WIDTH_PX, HEIGHT_PX)
    path = np.tile(world_from_cam, (n, 1, 1))
    camera = CameraPath(intrinsics_px, WIDTH_PX, HEIGHT_PX, path, np.ones(n, dtype=bool))
    return Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n), camera)


def _tracked(motion: Motion, body: BodyModel) -> TrackedPerson:
    n = motion.n_frames
    rest_pelvis_m = body.rest_pelvis_m(motion.shape)
    return TrackedPerson(motion, rest_pelvis_m, np.ones(n, dtype=bool), np.arange(n))


def _of_result(path: Path, motion: Motion, body: BodyModel) -> Motion:
    """The result's only person in the z-up world, with the motion's own shape."""
    (person,) = read_system(path, "world").people
    world = person.in_world
    assert world is not None
    turns = world.z_up_from_file[:, :3, :3]
    pelvis_m = world.transl_m + _rest_pelvis_m(person, body)
    return replace(
        motion,
        local_rotmats=person.local_rotmats,
        root_rotmats=turns @ world.root_rotmats,
        pelvis_m=(turns @ pelvis_m[..., None])[..., 0],
    )


def _rest_pelvis_m(person: EstimatedPerson, body: BodyModel) -> np.ndarray:
    if person.rest_pelvis_m is not None:
        return person.rest_pelvis_m
    assert person.betas is not None and person.betas_body == body.name
    return body.rest_pelvis_m(person.betas[0, : body.n_shape])


def _as(motion: Motion, found: Motion) -> Motion:
    """A motion that was read, with the frame rate and the names of the one that was written."""
    return replace(found, fps_hz=motion.fps_hz, body=motion.body, gender=motion.gender)
