"""Stage: people before the camera, from pictures alone.

    landmarks/   what the landmark network saw of each person (`landmarks`)
    poses/       `local_poses.json`, and `person_<n>.npz` of each person: poses, roots and places

The lifter gives the pose and the fit lays it onto the landmarks; the place is where a body of usual
size lies on them, without leaps in depth.
"""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.landmarks import LandmarksConfig, LandmarkTrack, find_landmarks, load_tracks
from gmrdata.people.lifter import WEIGHTS_FILE, LiftedPose, SeenLandmarks, lift
from gmrdata.people.placement import place
from gmrdata.read.body_file import read_body
from gmrdata.read.frames import check_images, image_number, list_images
from gmrdata.read.models import POSE_LANDMARKS, YOLOX_NANO, find_model
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.lens import straightened
from gmrdata.values.local_poses import POSES_FILE, LocalPoses, LocalPosesRecord
from gmrdata.values.people import person_file
from gmrdata.values.records import Config

LANDMARKS_FOLDER, POSES_FOLDER = "landmarks", "poses"
Method = Literal["lifter", "fit", "lifter_fit"]


class LocalPosesConfig(Config):
    """How people are found, and how their poses are made."""

    landmarks: LandmarksConfig = LandmarksConfig()
    method: Method = "lifter_fit"
    """The network; the optimisation alone; or the optimisation from the network's poses."""
    fit: FitConfig = FitConfig()
    smooth_s: float = Field(default=0.03, ge=0)
    """Deviation of the weights in time by which poses are averaged [s]; 0: not at all."""


class Lens(NamedTuple):
    """The camera of the images."""

    matrix_px: np.ndarray  # (3, 3) [px]
    radial: tuple[float, float] = (0.0, 0.0)  # k1 and k2


class ImageTimes(NamedTuple):
    """Which frames of a video the T images of a folder are."""

    frame_numbers: np.ndarray  # (T,) int, rising, counted from 0
    fps_hz: float  # images per second


class _Recipe(Config):
    poses: LocalPosesConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial: tuple[float, float]
    frame_numbers: tuple[int, ...]
    fps_hz: float


def local_poses(
    images_dir: Path,
    times: ImageTimes,
    lens: Lens,
    body_path: Path,
    out_dir: Path,
    config: LocalPosesConfig,
    *,
    detector_path: Path | None = None,
    landmarks_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir/landmarks` and `out_dir/poses`, whose path is given; `read_camera_bodies`
    reads it.

    Networks that are not given are those of `gmrdata fetch models`.  A video in which nobody is
    seen leaves poses without people.

    Raises:
        MissingInput, BadDetector, BadFrames, BadBodyFile: name the file and the remedy.
    """
    found = find_landmarks(
        find_model(YOLOX_NANO, detector_path),
        find_model(POSE_LANDMARKS, landmarks_path),
        images_dir,
        out_dir / LANDMARKS_FOLDER,
        config.landmarks,
        run=run,
    )
    recipe = _Recipe(
        poses=config,
        intrinsics_px=tuple(tuple(row) for row in lens.matrix_px.tolist()),
        radial=lens.radial,
        frame_numbers=tuple(times.frame_numbers.tolist()),
        fps_hz=times.fps_hz,
    )

    def work(partial: Path) -> None:
        images = list_images(images_dir)
        numbers = np.array([image_number(image) for image in images], dtype=np.int64)
        body = read_body(body_path)
        people = load_tracks(found)
        for n, track in enumerate(with_bar(people, "poses")):
            seen = seen_landmarks(track, numbers, times, lens)
            rows = np.searchsorted(numbers, track.image_numbers)
            poses = poses_of(seen, times.frame_numbers[rows], body, config)
            poses.write(partial / person_file(n))
        LocalPosesRecord(
            people=len(people),
            images=len(images),
            frames=int(times.frame_numbers[-1]) + 1,
            size_px=check_images(images),
            body=body.name,
            method=config.method,
        ).write(partial / POSES_FILE)

    inputs = {"landmarks": found, "body": body_path, "lifter": WEIGHTS_FILE}
    return run_stage("local_poses", out_dir / POSES_FOLDER, recipe, inputs, work, run=run)


def seen_landmarks(
    track: LandmarkTrack, numbers: np.ndarray, times: ImageTimes, lens: Lens
) -> SeenLandmarks:
    """A track's landmarks as rays without distortion, at its times."""
    rows = np.searchsorted(numbers, track.image_numbers)
    per_image = float(np.median(np.diff(times.frame_numbers))) if len(numbers) > 1 else 1.0
    matrix_px = lens.matrix_px
    bent = (track.image_px - matrix_px[:2, 2]) / np.diag(matrix_px)[:2]
    return SeenLandmarks(
        times_s=times.frame_numbers[rows] / (per_image * times.fps_hz),
        rays=straightened(bent, *lens.radial),
        world_m=track.world_m,
        visibility=track.visibility,
    )


def poses_of(
    seen: SeenLandmarks, frame_numbers: np.ndarray, body: BodyModel, config: LocalPosesConfig
) -> LocalPoses:
    """One person's poses and places on a body of mean shape."""
    rest_joints_m = body.rest_joints_m(np.zeros(body.n_shape))
    start = None if config.method == "fit" else smoothed(lift(seen), seen.times_s, config.smooth_s)
    rotmats = start.rotmats if start is not None else None
    if config.method != "lifter":
        rotmats = fit(seen, rest_joints_m, config.fit, start).rotmats
    assert rotmats is not None
    return LocalPoses(
        frame_numbers=frame_numbers,
        local_rotmats=rotmats[:, 1:],
        root_rotmats=rotmats[:, 0],
        pelvis_m=place(seen, rotmats, rest_joints_m),
    )


def smoothed(pose: LiftedPose, times_s: np.ndarray, deviation_s: float) -> LiftedPose:
    """Rotations averaged with their neighbours in time (chordal means)."""
    if deviation_s == 0:
        return pose
    apart = (times_s[:, None] - times_s) / deviation_s
    weights = np.exp(-0.5 * apart**2) * (np.abs(apart) < 4)
    sums = np.einsum("ts,sjab->tjab", weights, pose.rotmats)
    u, _, vt = np.linalg.svd(sums)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return LiftedPose(u @ vt, pose.leg_m)
