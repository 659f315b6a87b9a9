"""Stage: the poses that a camera sees, taken as poses in the world.

With `camera` "ignored" this is what a pose estimator in the camera's frame gives: right where the
camera stands still, and wrong by its motion where it moves.  With the true or a recovered camera
applied it is the reference that knows the camera (eqs. 6-8 of the paper).
"""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.baselines.predictions import Prediction, predicted, write_predictions
from gmrdata.baselines.recovered_cameras import CameraFiles, find_cameras, recovered_cameras
from gmrdata.baselines.still_camera import as_if_still, seen_motion
from gmrdata.baselines.subjects import Subject, manifest_subjects
from gmrdata.clip import camera_of
from gmrdata.config import Config
from gmrdata.errors import MissingInput
from gmrdata.pseudogt.compose import world_motion
from gmrdata.store import run_stage


class CameraAsWorldConfig(Config):
    """Which camera is applied."""

    camera: Literal["ignored", "true", "recovered"] = "ignored"
    """`ignored`: as if the camera stood still.  `true`: the clip's own.  `recovered`: one that
    structure from motion found."""


def predict_camera_as_world(
    manifest_path: Path,
    out_dir: Path,
    config: CameraAsWorldConfig | None = None,
    *,
    cameras_dir: Path | None = None,
    redo: bool = False,
) -> Path:
    """Predict world motions from the camera's view of the true motion.

    Clips that no camera sees are left out and named.

    Args:
        manifest_path: The clips.
        out_dir: Folder to make; see `gmrdata.baselines.predictions`.
        config: The recipe; None for its defaults.
        cameras_dir: For recovered cameras: `<clip id>/` of each clip, as `gmrdata sfm` makes it.
        redo: Throw away a result of another recipe.

    Returns:
        `out_dir`.

    Raises:
        MissingInput: recovered cameras are asked for, and are not there.
        BadMotionFile: recovered cameras are of other images, or up to an unknown scale.
        GmrdataError: as `manifest_subjects`.
    """
    config = config or CameraAsWorldConfig()
    subjects, left_out = manifest_subjects(manifest_path)
    seen = [one for one in subjects if _is_seen(one)]
    left_out |= {one.clip.id: "no camera sees it" for one in subjects if not _is_seen(one)}
    files: dict[str, CameraFiles] = {}
    inputs = {"manifest": manifest_path}
    if config.camera == "recovered":
        if cameras_dir is None:
            raise MissingInput("no recovered cameras given. Name --cameras")
        files = {one.clip.id: find_cameras(cameras_dir, one.clip.id) for one in seen}
        for clip_id, found in files.items():
            inputs |= found.inputs(clip_id)

    def work(partial_dir: Path) -> None:
        if config.camera == "recovered":
            predictions = [in_recovered_world(one, files[one.clip.id]) for one in seen]
        elif config.camera == "true":
            predictions = [in_true_world(one) for one in seen]
        else:
            predictions = [in_camera_world(one) for one in seen]
        figures = {"camera": config.camera}
        write_predictions(partial_dir, "camera_as_world", predictions, left_out, figures)

    return run_stage("baseline-camera-as-world", out_dir, config, inputs, work, redo=redo)


def in_camera_world(subject: Subject) -> Prediction:
    """A subject in the camera's frame, taken as the world."""
    seen, valid = seen_motion(subject.clip)
    source = f"camera frame taken as world: {seen.source}"
    return predicted(subject, replace(as_if_still(seen), source=source), valid)


def in_true_world(subject: Subject) -> Prediction:
    """A subject in the camera's frame, brought into the world by the clip's own camera."""
    camera = camera_of(subject.clip)
    return _in_world(subject, camera.world_from_cam, camera.has_camera, "true")


def in_recovered_world(subject: Subject, files: CameraFiles) -> Prediction:
    """A subject in the camera's frame, brought into the world by a recovered camera."""
    world_from_cam, known = recovered_cameras(subject.clip, files)
    return _in_world(subject, world_from_cam, known, "recovered")


def _in_world(
    subject: Subject, world_from_cam: np.ndarray, known: np.ndarray, which: str
) -> Prediction:
    seen, valid = seen_motion(subject.clip)
    source = f"camera frame with the {which} camera applied: {seen.source}"
    world = replace(world_motion(seen, world_from_cam), source=source)
    return predicted(subject, world, valid & known)


def _is_seen(subject: Subject) -> bool:
    return subject.clip.motion.frame == "camera" or subject.clip.camera is not None
