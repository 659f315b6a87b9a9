"""Stage: the poses that a camera sees, taken as poses in the world.

With `camera` "ignored" this is what a pose estimator in the camera's frame gives: right where the
camera stands still, and wrong by its motion where it moves.  With the true or a recovered camera
applied it is the reference that knows the camera (eqs. 6-8 of the paper).
"""

from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from gmrdata.cameras.files import CAMERAS_FILE, QUALITY_FILE, SfmCameras, load_cameras
from gmrdata.score import baselines as predictions
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import Clip, camera_of, rows_of_numbers
from gmrdata.values.errors import BadMotionFile, BadRecipe, BadRecord, MissingInput
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config
from gmrdata.values.transforms import invert, rigid
from gmrdata.world.compose import metric_cameras, motion_in_camera, motion_in_world
from gmrdata.world.judge import PseudoGtQuality

LEVEL_FROM_CAM = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""World of a camera that is held level and looks along +y: x to the right, z up, origin in it."""


def seen_motion(clip: Clip) -> tuple[Motion, np.ndarray]:
    """The person in the frame of the camera at each row, and the (T,) bool rows that have it."""
    if clip.motion.frame == "camera":
        return clip.motion, clip.valid
    camera = camera_of(clip)
    return motion_in_camera(clip.motion, camera.world_from_cam), clip.valid & camera.has_camera


def as_if_still(seen: Motion) -> Motion:
    """A motion in the camera's frame taken as one in the world, the camera's motion ignored."""
    return motion_in_world(seen, np.tile(LEVEL_FROM_CAM, (seen.n_frames, 1, 1)))


class CameraFiles(NamedTuple):
    """Where one clip's recovered cameras lie."""

    cameras_path: Path  # `cameras.npz` of a reconstruction
    quality_path: Path | None  # of the pseudo ground truth, which states the scale; None: no such


def find_cameras(folder: Path, clip_id: str) -> CameraFiles:
    """The cameras of a clip: `folder/<clip id>/` as `gmrdata sfm` made it, or its `cameras.npz`."""
    made = folder / clip_id
    for path in (made / "sfm" / CAMERAS_FILE, made / CAMERAS_FILE):
        if path.is_file():
            quality_path = made / "pseudo_gt" / QUALITY_FILE
            return CameraFiles(path, quality_path if quality_path.is_file() else None)
    remedy = f"Run gmrdata sfm with --out {made}, or leave the clip out of the manifest"
    raise MissingInput(f"{made}: no sfm/{CAMERAS_FILE} and no {CAMERAS_FILE} there. {remedy}")


def recovered_cameras(clip: Clip, files: CameraFiles) -> tuple[np.ndarray, np.ndarray]:
    """Recovered cameras of a clip's rows, matched by the images' numbers.

    Gives world_from_cam (T, 4, 4) [m], NaN where there is none, and (T,) bool rows that have one.
    The world is that of the first camera, held level.
    """
    cameras = load_cameras(files.cameras_path.parent)
    rows = rows_of_numbers(cameras.image_numbers, clip.image_numbers)
    known = (rows >= 0) & cameras.path.has_camera[rows]
    if not known.any():
        raise BadMotionFile(
            f"{files.cameras_path}: has a camera for none of the images of clip {clip.id}. Give"
            " cameras of its own images"
        )
    metric = metric_cameras(cameras.path.world_from_cam, _scale(cameras, files))
    level_from_world = LEVEL_FROM_CAM @ invert(metric[rows[known][0]])
    world_from_cam = np.full((len(rows), 4, 4), np.nan)
    world_from_cam[known] = level_from_world @ metric[rows[known]]
    return world_from_cam, known


def _scale(cameras: SfmCameras, files: CameraFiles) -> float:
    """Metres per unit; 1 for cameras that do not travel, which need none."""
    if cameras.geometry != "full":
        return 1.0
    if files.quality_path is None:
        raise BadMotionFile(
            f"{files.cameras_path}: cameras up to scale, and no pseudo_gt/{QUALITY_FILE} states it."
            " Give the output folder of gmrdata sfm"
        )
    scale = PseudoGtQuality.read(files.quality_path).scale
    if scale is None or scale <= 0:
        raise BadRecord(f"{files.quality_path}: states no scale above zero. Run gmrdata sfm again")
    return scale


WhichCamera = Literal["ignored", "true", "recovered"]


class CameraAsWorldConfig(Config):
    """Which camera is applied."""

    camera: WhichCamera = "ignored"
    """`ignored`: as if the camera stood still.  `true`: the clip's own.  `recovered`: one that
    structure from motion found."""


class CameraFigures(predictions.MethodFigures):
    """What the record says of this baseline."""

    camera: WhichCamera


class CameraPredictions(predictions.Predictions):
    figures: CameraFigures


def predict_camera_as_world(
    manifest_path: Path,
    out_dir: Path,
    config: CameraAsWorldConfig | None = None,
    *,
    cameras_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict world motions from the camera's view of the true motion; unseen clips are named.

    `cameras_dir` holds recovered cameras: `<clip id>/` of each clip, as `gmrdata sfm` makes it.
    BadMotionFile where they are of other images, or up to an unknown scale.
    """
    config = config or CameraAsWorldConfig()
    if cameras_dir is not None and config.camera != "recovered":
        raise BadRecipe("--cameras: for --camera recovered alone. Give both, or neither")
    subjects, left_out = predictions.manifest_subjects(manifest_path)
    seen = [one for one in subjects if _is_seen(one)]
    left_out |= {one.clip.id: "no camera sees it" for one in subjects if not _is_seen(one)}
    files: dict[str, CameraFiles] = {}
    inputs: dict[str, Path | None] = {"manifest": manifest_path}
    if config.camera == "recovered":
        if cameras_dir is None:
            raise MissingInput("no recovered cameras given. Name --cameras")
        files = {one.clip.id: find_cameras(cameras_dir, one.clip.id) for one in seen}
        for clip_id, (cameras_path, quality_path) in files.items():
            inputs |= {f"cameras_{clip_id}": cameras_path, f"scale_{clip_id}": quality_path}

    def work(partial_dir: Path) -> None:
        made = [_prediction(one, config.camera, files.get(one.clip.id)) for one in seen]
        kind, figures = CameraPredictions, CameraFigures(camera=config.camera)
        predictions.write_predictions(partial_dir, "camera_as_world", made, left_out, kind, figures)

    return run_stage("baseline-camera-as-world", out_dir, config, inputs, work, run=run)


def _prediction(
    subject: predictions.Subject, camera: WhichCamera, files: CameraFiles | None
) -> predictions.Prediction:
    seen, valid = seen_motion(subject.clip)
    if camera == "ignored":
        source = f"camera frame taken as world: {seen.source}"
        return predictions.predicted(subject, replace(as_if_still(seen), source=source), valid)
    if files is None:
        path = camera_of(subject.clip)
        world_from_cam, known = path.world_from_cam, path.has_camera
    else:
        world_from_cam, known = recovered_cameras(subject.clip, files)
    source = f"camera frame with the {camera} camera applied: {seen.source}"
    world = replace(motion_in_world(seen, world_from_cam), source=source)
    return predictions.predicted(subject, world, valid & known)


def _is_seen(subject: predictions.Subject) -> bool:
    """Whether a camera sees the person in some row that is to be predicted."""
    clip = subject.clip
    if clip.motion.frame == "camera":
        return True
    return clip.camera is not None and bool((clip.valid & clip.camera.has_camera).any())
