"""The 2D keypoints of a clip's person, row by row."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.read.openpose import keypoint_files, read_people
from gmrdata.values.body import N_JOINTS
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadKeypoints

BEYOND_IMAGE_SHARE = 0.1
"""How far outside the image a detector may put a joint, as a share of the larger side."""
SAME_SHAPE = 0.02  # by how much the ratio of the sides may differ where images were made smaller


@dataclass(frozen=True, eq=False)
class ClipKeypoints:
    """2D joints of one person over a clip's T rows."""

    points: np.ndarray
    """(T, 24, 3) x [px], y [px], confidence of SMPL's joints; zero where there is none."""
    missing: tuple[str, ...]  # (T,) why a row has nothing; empty where it has
    n_crowded: int  # rows in which one of several people was chosen


def clip_keypoints(
    clip: Clip,
    folder: Path,
    *,
    person_id: int | None = None,
    image_size_px: tuple[int, int] | None = None,
) -> ClipKeypoints:
    """Read the keypoints of a clip's images, in `folder`'s JSON files of the images' numbers.

    Of several people in a frame, the one with STAF's track `person_id` is taken; without that, the
    one whose joints have the highest sum of confidences, frame by frame.  `image_size_px` are width
    and height of the images that the detector was given; None for those of the clip's camera.
    """
    camera = camera_of(clip)
    files = keypoint_files(folder)
    points = np.zeros((clip.motion.n_frames, N_JOINTS, 3))
    missing, n_crowded = [], 0
    for row, number in enumerate(clip.image_numbers.tolist()):
        if number not in files:
            missing.append("no keypoint file" if number >= 0 else "no image")
            continue
        people = read_people(files[number])
        wanted = [one for one in people if person_id is None or one.id == person_id]
        person = max(wanted, key=lambda one: one.confidence, default=None)
        if person is None:
            missing.append("nobody detected" if not people else f"no person {person_id} detected")
            continue
        points[row] = person.keypoints
        n_crowded += len(people) > 1
        missing.append("")
    if all(missing):
        raise BadKeypoints(_nothing(clip, folder, sorted(files), missing))
    points[..., :2] *= _factors(folder, camera, image_size_px)
    _check_in_image(points, camera, folder)
    return ClipKeypoints(points, tuple(missing), n_crowded)


def _nothing(clip: Clip, folder: Path, numbers: list[int], missing: list[str]) -> str:
    """Why no row has keypoints, and what to do."""
    detected_in = [why for why in missing if why not in ("no keypoint file", "no image")]
    if detected_in:
        return f"{folder}: {detected_in[0]} in any image of clip {clip.id}. Look at the detections"
    images = clip.image_numbers[clip.image_numbers >= 0]
    has = f"images {images.min()} to {images.max()}" if len(images) else "no images"
    return (
        f"{folder}: holds frames {numbers[0]} to {numbers[-1]}, but clip {clip.id} has {has}."
        " Name the files by the images' numbers"
    )


def _factors(
    folder: Path, camera: CameraPath, image_size_px: tuple[int, int] | None
) -> np.ndarray | float:
    """What the points are multiplied by to be those of the camera's images: (2,)."""
    if image_size_px is None:
        return 1.0
    factors = np.array([camera.width_px, camera.height_px]) / image_size_px
    if abs(factors[0] / factors[1] - 1) > SAME_SHAPE:
        raise BadKeypoints(
            f"{folder}: images of {image_size_px[0]}x{image_size_px[1]} px are of another shape"
            f" than the camera's {camera.width_px}x{camera.height_px}. Give uncropped images"
        )
    return factors


def _check_in_image(points: np.ndarray, camera: CameraPath, folder: Path) -> None:
    """Refuse points outside the camera's images; those of smaller images can't be told apart."""
    seen_px = points[points[..., 2] > 0][:, :2]
    if not len(seen_px):
        return
    if np.abs(seen_px).max() <= 1:
        remedy = "Run OpenPose with --keypoint_scale 0"
        raise BadKeypoints(f"{folder}: points are shares of the image, not pixels. {remedy}")
    size_px = np.array([camera.width_px, camera.height_px])
    margin_px = BEYOND_IMAGE_SHARE * size_px.max()
    if ((seen_px < -margin_px) | (seen_px > size_px + margin_px)).any():
        low, high = seen_px.min(axis=0), seen_px.max(axis=0)
        raise BadKeypoints(
            f"{folder}: points from ({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f})"
            f" px are not of the camera's images of {size_px[0]}x{size_px[1]} px. Say with"
            " image_size_px which size the detector was given"
        )
