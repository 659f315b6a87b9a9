"""What a file for viewers shows: people, and the camera that films them, over the same frames."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion


class Performer(NamedTuple):
    """One person of a take."""

    name: str  # what the person is called in the file, such as "person" or "passer_by_1"
    motion: Motion  # in the z-up world, over the take's T frames
    body: BodyModel
    shown: np.ndarray  # (T,) bool: frames with a pose; in all others the person is hidden


@dataclass(frozen=True, eq=False)
class Take:
    """People and their camera over T frames of one rate, in one z-up world."""

    name: str  # such as "truth" or "result"
    people: tuple[Performer, ...]
    camera: CameraPath | None
    points_m: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) points of the place that the cameras were found with, world [m]."""

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return self.people[0].motion.n_frames

    @property
    def fps_hz(self) -> float:
        """Frame rate [Hz]."""
        return self.people[0].motion.fps_hz


def check_take(take: Take) -> None:
    """Refuse what could only be written wrongly; BadMotionFile names the person."""
    if not take.people:
        raise BadMotionFile(f"take {take.name}: nobody to write; give a clip with a person")
    names = [person.name for person in take.people]
    if len(set(names)) < len(names):
        raise BadMotionFile(f"take {take.name}: two people have one name: {', '.join(names)}")
    for person in take.people:
        _check_person(person, take)
    what, camera = f"take {take.name}", take.camera
    if camera is None:
        return
    if camera.n_frames != take.n_frames:
        raise BadMotionFile(f"{what}: {camera.n_frames} cameras for {take.n_frames} frames")
    known = camera.world_from_cam[camera.has_camera]
    if not (np.isfinite(known).all() and np.isfinite(camera.intrinsics_px).all()):
        raise BadMotionFile(f"{what}: NaN in a camera that is said to be known")
    if camera.intrinsics_px[0, 1]:
        skew = f"{camera.intrinsics_px[0, 1]:g} px"
        raise BadMotionFile(f"{what}: the camera's axes are skewed by {skew}, which no viewer has")


def _check_person(person: Performer, take: Take) -> None:
    motion, what = person.motion, f"clip {person.name}"
    if motion.frame != "world":
        remedy = "give a clip with cameras, so that it can be put in the world"
        raise BadMotionFile(f"{what}: is in the camera's frame; {remedy}")
    if (motion.n_frames, motion.fps_hz) != (take.n_frames, take.fps_hz):
        here = f"{motion.n_frames} frames at {motion.fps_hz:g} Hz"
        first = f"{take.n_frames} at {take.fps_hz:g} Hz"
        raise BadMotionFile(f"{what}: has {here}, {take.people[0].name} has {first}")
    if not person.shown.any():
        raise BadMotionFile(f"{what}: has no valid frame")
    if not finite_rows(motion)[person.shown].all():
        raise BadMotionFile(f"{what}: NaN in a frame that is said to be valid; make it again")


def quaternions_xyzw(rotmats: np.ndarray) -> np.ndarray:
    """(T, 24, 4) x, y, z, w of rotations (T, 24, 3, 3), whose signs never jump from one row to the
    next, so that players turn the short way."""
    from scipy.spatial.transform import Rotation

    quats = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_quat().reshape(*rotmats.shape[:2], 4)
    jumps = (quats[1:] * quats[:-1]).sum(-1, keepdims=True) < 0
    quats[1:] *= np.cumprod(np.where(jumps, -1.0, 1.0), axis=0)
    return np.asarray(quats)


def finite_rows(motion: Motion) -> np.ndarray:
    """(T,) bool: frames whose pose and place are known."""
    values = np.concatenate([motion.rotmats.reshape(motion.n_frames, -1), motion.pelvis_m], axis=1)
    return np.asarray(np.isfinite(values).all(axis=1))
