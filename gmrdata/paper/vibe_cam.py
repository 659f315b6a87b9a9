"""Stage: VIBE-CAM, the paper's comparison (section 4.5).

Another network's local poses and orientations in the camera's frame (the paper: VIBE), placed
before the camera by 2D keypoints (the paper: STAF) frame by frame, give a motion in the camera's
frame.  It is then taken as one in the world, as if the camera stood still.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.paper.clip_keypoints import ClipKeypoints, clip_keypoints
from gmrdata.paper.vibe_placement import Placed, PlacementConfig, place_person
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import baseline_clips as predictions
from gmrdata.score.camera_as_world import as_if_still
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.bodies import body_of
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, clip_on_body, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.records import Config
from gmrdata.values.rows import text_runs


class VibeCamConfig(Config):
    """How people are placed, and who they are among the detected."""

    placement: PlacementConfig = PlacementConfig()  # the fit of one frame
    person_ids: Mapping[str, int] = Field(default_factory=dict)
    """Track of STAF to follow, by clip id; others take the most confident person of each frame."""
    image_size_px: tuple[int, int] | None = None
    """Width and height of the images that the detector was given [px]; None for the clips' own."""


class UnpredictedRows(Config):
    """Rows start, start + 1, ..., stop - 1."""

    start: int  # the first
    stop: int  # one past the last
    reason: str  # why they have no prediction


class PlacedFigures(predictions.ClipFigures):
    """How well a clip's person was placed."""

    median_residual_px: float | None
    """Median distance of joints from their keypoints [px]; None where no row is known."""
    n_rows_with_several_people: int  # rows in which one of several people was chosen
    not_predicted: tuple[UnpredictedRows, ...]  # rows without a prediction


class VibeCamPredictions(predictions.Predictions):
    clips: Mapping[str, PlacedFigures]


def predict_vibe_cam(
    manifest_path: Path,
    poses_dir: Path,
    keypoints_dir: Path,
    out_dir: Path,
    config: VibeCamConfig | None = None,
    *,
    body_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict world motions as VIBE-CAM does.

    Of the manifest's clips, only the intrinsics, the image size and the images' numbers are used.
    The record says of each clip which rows have no prediction and why.

    Args:
        poses_dir: `<clip id>.npz` for each clip: a clip's file with `frame` "camera" and the rows
            of the manifest's clip, whose `trans` is not looked at.
        keypoints_dir: `<clip id>/` for each clip: OpenPose's or STAF's JSON, one file per frame.
        body_path: Body of the poses, or a folder of bodies, as `load_bodies` takes it; None for the
            default body.

    Errors are MissingInput, BadMotionFile, BadRecord, BadKeypoints, and BadRecipe where
    `person_ids` names a clip that is not there.
    """
    config = config or VibeCamConfig()
    subjects, left_out = predictions.manifest_subjects(manifest_path)
    _check_ids(config, [one.clip.id for one in subjects])
    inputs = {"manifest": manifest_path}
    inputs |= body_inputs(body_path)
    for one in subjects:
        inputs[f"poses_{one.clip.id}"] = poses_dir / f"{one.clip.id}.npz"
        inputs[f"keypoints_{one.clip.id}"] = keypoints_dir / one.clip.id

    def work(partial_dir: Path) -> None:
        bodies = load_bodies("anny" if body_path is None else str(body_path))
        made = []
        for one in track(subjects, "placing people", total=len(subjects)):
            posed, body = load_poses(inputs[f"poses_{one.clip.id}"], one.clip, bodies)
            found = clip_keypoints(
                one.clip,
                keypoints_dir / one.clip.id,
                person_id=config.person_ids.get(one.clip.id),
                image_size_px=config.image_size_px,
            )
            intrinsics_px = camera_of(one.clip).intrinsics_px
            placed = place_person(posed, found, intrinsics_px, body, config.placement)
            made.append(_prediction(one, posed, placed, found, body))
        predictions.write_predictions(partial_dir, "vibe_cam", made, left_out, VibeCamPredictions)

    return run_stage("baseline-vibe-cam", out_dir, config, inputs, work, run=run)


def load_poses(path: Path, clip: Clip, bodies: Sequence[BodyModel]) -> tuple[Clip, BodyModel]:
    """Another network's poses for a clip: in the camera's frame, the same rows; and their body."""
    posed = load_clip(path)
    motion = posed.motion
    if motion.frame != "camera":
        raise BadMotionFile(f"{path}: the motion is not in the camera frame")
    body = body_of(motion, bodies)
    if body is None:
        given = ", ".join(f"{one.name} with {one.n_shape}" for one in bodies)
        raise BadMotionFile(
            f"{path}: of body {motion.body} with {motion.shape.size} shape coefficients, but the"
            f" given body is {given}. Give the poses' own body"
        )
    same_rate = abs(motion.fps_hz / clip.motion.fps_hz - 1) < 1e-6
    if motion.n_frames != clip.motion.n_frames or not same_rate:
        raise BadMotionFile(
            f"{path}: {motion.n_frames} frames at {motion.fps_hz:g} fps, but clip {clip.id} has"
            f" {clip.motion.n_frames} at {clip.motion.fps_hz:g}. Give poses of all its images"
        )
    numbers = posed.image_numbers
    if (numbers >= 0).any() and not np.array_equal(numbers, clip.image_numbers):
        raise BadMotionFile(f"{path}: of other images than clip {clip.id}. Give its own poses")
    return clip_on_body(posed, body), body


def _prediction(
    subject: predictions.Subject, posed: Clip, placed: Placed, found: ClipKeypoints, body: BodyModel
) -> predictions.Prediction:
    seen = replace(posed.motion, pelvis_m=placed.pelvis_m)
    source = f"VIBE-CAM: {seen.source}, placed by 2D keypoints, camera frame taken as world"
    return predictions.predicted(
        subject,
        replace(as_if_still(seen), source=source),
        np.array([not why for why in placed.missing]),
        rest_pelvis_m=body.rest_pelvis_m(seen.shape),
        figures={
            "median_residual_px": placed.residual_px,
            "n_rows_with_several_people": found.n_crowded,
            "not_predicted": [
                {"start": start, "stop": stop, "reason": why}
                for start, stop, why in text_runs(placed.missing)
                if why
            ],
        },
    )


def _check_ids(config: VibeCamConfig, clip_ids: list[str]) -> None:
    unknown = sorted(config.person_ids.keys() - set(clip_ids))
    if unknown:
        raise BadRecipe(
            f"person_ids: no clip {', '.join(unknown)} in the manifest, which has"
            f" {', '.join(clip_ids)}"
        )
