"""What extras have to keep clear of and be seen by: the subject's path and the cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.camera import CameraPath
from gmrdata.geometry.framing import in_frame

PEOPLE_APART_M = 0.8
"""Between the pelvises of two people, on the ground; a person is about half a metre wide."""
FROM_CAMERA_M = 1.3
HALF_TRUNK_M = 0.25


@dataclass(frozen=True, eq=False)
class Shot:
    """Clips that share one place, all with T frames."""

    fps_hz: float
    """Frame rate [Hz]."""
    subjects_m: tuple[np.ndarray, ...]
    """(T, 3) pelvis path for each clip, world [m]."""
    cameras: tuple[CameraPath, ...]
    """Camera for each clip."""

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return len(self.subjects_m[0])


def shot_of(clips: Sequence[Clip]) -> Shot:
    """The shot of clips with cameras; one that is shorter than the longest rests at its end.

    Raises:
        BadMotionFile: a clip has no camera.
    """
    n_frames = max(clip.motion.n_frames for clip in clips)
    rows = [np.minimum(np.arange(n_frames), clip.motion.n_frames - 1) for clip in clips]
    pairs = list(zip(clips, rows, strict=True))
    return Shot(
        clips[0].motion.fps_hz,
        tuple(clip.motion.pelvis_m[row] for clip, row in pairs),
        tuple(_camera_at(camera_of(clip), row) for clip, row in pairs),
    )


def _camera_at(camera: CameraPath, rows: np.ndarray) -> CameraPath:
    return replace(
        camera, world_from_cam=camera.world_from_cam[rows], has_camera=camera.has_camera[rows]
    )


def seen_share(shot: Shot, path_m: np.ndarray) -> float:
    """Share of the frames with a moving point (T, 3) [m] in the image and not behind the subject.

    The worst camera counts.  In less than a second nobody gets out from behind another, so there it
    doesn't matter: a dry run probes two frames.
    """
    shares = []
    for camera, subject_m in zip(shot.cameras, shot.subjects_m, strict=True):
        seen = in_frame(camera, path_m)
        if shot.n_frames >= shot.fps_hz:
            seen &= ~_is_behind(path_m, subject_m, camera)
        shares.append(float(seen.mean()))
    return min(shares)


def _is_behind(path_m: np.ndarray, subject_m: np.ndarray, camera: CameraPath) -> np.ndarray:
    """(T,) bool: seen from above, the subject's trunk is in the line of sight to a point."""
    sight_m = (path_m - camera.centres_world_m)[:, :2]
    to_subject_m = (subject_m - camera.centres_world_m)[:, :2]
    far_m = np.maximum(np.linalg.norm(sight_m, axis=1), 1e-9)
    along_m = (to_subject_m * sight_m).sum(axis=1) / far_m
    left_m = np.c_[-sight_m[:, 1], sight_m[:, 0]]
    aside_m = np.abs((to_subject_m * left_m).sum(axis=1)) / far_m
    return np.asarray((along_m > 0) & (along_m < far_m) & (aside_m < HALF_TRUNK_M))


def enough_seen(shot: Shot, share: float, seconds: float) -> float:
    """A share of the frames, but no more of them than a time [s] has."""
    return min(share, seconds * shot.fps_hz / shot.n_frames)


def apart_m(path_m: np.ndarray, other_m: np.ndarray) -> float:
    """Least distance on the ground between two paths (T, 2 or 3) at the same time [m]."""
    return float(np.linalg.norm(path_m[:, :2] - other_m[:, :2], axis=1).min())


def place_in_sight(
    shot: Shot,
    row: int,
    near_m: float,
    room_m: float,
    reach_m: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, float]:
    """A place (2,) [m] in line with the first camera and its subject, and the line's angle [rad].

    It is in front of the subject as often as behind, where there is room in front.

    Args:
        shot: The shot.
        row: The frame.
        near_m: Least distance to the camera [m].
        room_m: Least distance to the subject [m].
        reach_m: How much farther than that the place may be behind the subject [m].
        rng: Chooses.
    """
    camera_m = shot.cameras[0].centres_world_m[row, :2]
    sight_m = shot.subjects_m[0][row, :2] - camera_m
    distance_m, angle_rad = float(np.linalg.norm(sight_m)), float(np.arctan2(*sight_m[::-1]))
    in_front, share = rng.random() < 0.5, rng.random()
    if in_front and near_m < distance_m - room_m:
        along_m = near_m + share * (distance_m - room_m - near_m)
    else:
        along_m = distance_m + room_m + share * reach_m
    return camera_m + along_m * np.array([np.cos(angle_rad), np.sin(angle_rad)]), angle_rad
