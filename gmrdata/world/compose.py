"""Eqs. 6-8 of the paper, from the camera's frame to the world's and back.

The body's translation is the pelvis throughout.  With SMPL's `trans` in its place eq. 8 is wrong by
(R_col,i+1 - R_col,i) J0 per frame: 11.8 mm at 10 fps for a camera that tilts at 30 degrees/s.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.cameras import files
from gmrdata.cameras.match.tracks import Tracks, load_tracks
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of, rows_of_numbers
from gmrdata.values.errors import BadMotionFile, BadRecord
from gmrdata.values.motion import Motion
from gmrdata.values.records import MAKE_AGAIN
from gmrdata.values.transforms import Similarity


def motion_in_world(seen: Motion, world_from_cam: np.ndarray, scale: float = 1.0) -> Motion:
    """R_w = R_col R_c and T_w = R_col T_c + s T_col (eqs. 7, 8), s metres per unit of T_col."""
    return moved(seen, metric_cameras(world_from_cam, scale), "camera", "world")


def motion_in_camera(motion: Motion, world_from_cam: np.ndarray) -> Motion:
    """The person as each metric camera (T, 4, 4) sees it, by a motion in the world: the inverse of
    `motion_in_world`.  BadMotionFile for a motion in the camera's frame, or of other frames."""
    return moved(motion, transforms.invert(world_from_cam), "world", "camera")


def metric_cameras(world_from_cam: np.ndarray, scale: float) -> np.ndarray:
    """Cameras (T, 4, 4) with their centres multiplied by `scale`."""
    return transforms.rigid(world_from_cam[:, :3, :3], scale * world_from_cam[:, :3, 3])


def moved(motion: Motion, b_from_a: np.ndarray, a: str, b: Literal["world", "camera"]) -> Motion:
    """A motion of frame a in frame b, by b_from_a (T, 4, 4); BadMotionFile for a motion that is not
    in a, or of other frames than these."""
    if motion.frame != a:
        what = f"the motion is in the {motion.frame} frame, expected the {a} frame"
        raise BadMotionFile(f"{motion.source}: {what}")
    if b_from_a.shape != (motion.n_frames, 4, 4):
        what = f"{motion.n_frames} frames of motion, but cameras {b_from_a.shape}"
        raise BadMotionFile(f"{motion.source}: {what}. Give one (4, 4) for each frame")
    return replace(
        motion,
        root_rotmats=b_from_a[:, :3, :3] @ motion.root_rotmats,
        pelvis_m=transforms.apply(b_from_a, motion.pelvis_m[:, None])[:, 0],
        frame=b,
    )


IN_PLACE_M = 1e-9  # a camera that travels less was kept in place
OWN_WORLD = Similarity(1.0, np.eye(3), np.zeros(3))
LARGEST_RESIDUAL = 1e-6  # of the camera's distance from the middle, and of rotation matrices


@dataclass(frozen=True, eq=False)
class Background:
    """What held the cameras of a clip."""

    camera: CameraPath  # of the T frames of the reconstruction, in the clip's world [m]
    image_numbers: np.ndarray  # (T,) int: number in the image's file name for each row
    points_m: np.ndarray  # (N, 3) background points in the clip's world
    lens: files.Distortion | None  # distortion that was taken out of the image points


def load_background(sfm_dir: Path, clip: Clip | None) -> Background:
    """Read a reconstruction's folder; errors as of `world_from_sfm`.

    Without a clip it is in the world and the unit of the reconstruction itself.
    """
    cameras, points = files.load_cameras(sfm_dir), files.load_points(sfm_dir)
    similarity = OWN_WORLD if clip is None else world_from_sfm(cameras, clip, sfm_dir)
    known = cameras.path.world_from_cam
    rotmats, centres_m = similarity.rotmat @ known[:, :3, :3], similarity.apply(known[:, :3, 3])
    camera = replace(cameras.path, world_from_cam=transforms.rigid(rotmats, centres_m))
    lens = files.load_quality(sfm_dir).lens
    return Background(camera, cameras.image_numbers, similarity.apply(points), lens)


def load_background_tracks(sfm_dir: Path, background: Background) -> Tracks:
    """Its tracks; MissingInput where an older version kept none, BadRecord for those of another."""
    tracks = load_tracks(sfm_dir)
    if not tracks.fits(background.camera.n_frames, len(background.points_m)):
        raise BadRecord(f"{sfm_dir}: its files are of different frames; {MAKE_AGAIN}")
    return tracks


def is_kept_in_place(clip: Clip) -> bool:
    """Whether the clip's camera stays in one place, as that of a tripod, or for want of a scale."""
    camera = camera_of(clip)
    centres_m = camera.centres_world_m[camera.has_camera]
    return bool(np.ptp(centres_m, axis=0).max(initial=0.0) < IN_PLACE_M)


def world_from_sfm(cameras: files.SfmCameras, clip: Clip, sfm_dir: Path) -> Similarity:
    """The similarity that takes the cameras of a reconstruction to those of its clip.

    BadRecord where there is none: the clip is of another reconstruction, or its scale is not known,
    so that its camera was kept in place.
    """
    camera = camera_of(clip)
    rows = rows_of_numbers(cameras.image_numbers, clip.image_numbers)
    both = camera.has_camera & (rows >= 0)
    both[both] = cameras.path.has_camera[rows[both]]
    if not both.any():
        raise BadRecord(f"{sfm_dir}: has no frame of clip {clip.id}; {MAKE_AGAIN}")
    there, here = camera.world_from_cam[both], cameras.path.world_from_cam[rows[both]]
    rotmat = there[0, :3, :3] @ here[0, :3, :3].T
    middle_m, middle = there[:, :3, 3].mean(axis=0), here[:, :3, 3].mean(axis=0)
    way_m, way = there[:, :3, 3] - middle_m, (here[:, :3, 3] - middle) @ rotmat.T
    travels = float((way**2).sum())
    scale = float((way_m * way).sum()) / travels if travels > 0 else 1.0
    if travels > 0 and is_kept_in_place(clip):
        what = f"clip {clip.id} has no metric scale, so its camera was kept in place"
        raise BadRecord(f"{sfm_dir}: {what}, and the points have no place in its world")
    turned = np.abs(rotmat @ here[:, :3, :3] - there[:, :3, :3]).max()
    moved_m, extent_m = np.abs(scale * way - way_m).max(), 1.0 + np.abs(way_m).max()
    if max(turned, moved_m / extent_m) > LARGEST_RESIDUAL:
        raise BadRecord(f"{sfm_dir}: clip {clip.id} is of other cameras; {MAKE_AGAIN}")
    return Similarity(scale, rotmat, middle_m - scale * rotmat @ middle)
