"""Stages: VIBE-CAM, the paper's comparison (section 4.5), and GMR on the same network's poses.

Another network's local poses and orientations in the camera's frame (the paper: VIBE), placed
before the camera by 2D keypoints (the paper: STAF) frame by frame, give a motion in the camera's
frame.  It is then taken as one in the world, as if the camera stood still.  For the paper's rows
"Ours" (Tables 5 and 6), GMR sees the same local poses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field, PositiveInt

from gmrdata.gmr.config import weights_dir
from gmrdata.gmr.infer import predict_at_source_rate, too_short
from gmrdata.gmr.predict import TrainedGmr, load_gmr
from gmrdata.gmr.runs import given_body
from gmrdata.motion.resample import valid_runs
from gmrdata.paper.placement import (
    ClipKeypoints,
    PlacedPerson,
    PlacementConfig,
    clip_keypoints,
    place_person,
)
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import baselines as predictions
from gmrdata.score.camera_as_world import as_if_still
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, clip_on_body, dropped_ranges, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.motion import deltas
from gmrdata.values.records import Config


class VibeCamConfig(Config):
    """How people are placed, and who they are among the detected."""

    placement: PlacementConfig = PlacementConfig()  # the fit of one frame
    person_ids: Mapping[str, int] = Field(default_factory=dict)
    """Track of STAF to follow, by clip id; others take the most confident person of each frame."""
    image_size_px: tuple[PositiveInt, PositiveInt] | None = None
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


class SeenFiles(NamedTuple):
    """What other networks see of a manifest's clips."""

    poses_dir: Path
    """`<clip id>.npz` for each clip: a clip's file with `frame` "camera" and the rows of the
    manifest's clip, whose `trans` is not looked at."""
    keypoints_dir: Path
    """`<clip id>/` for each clip: OpenPose's or STAF's JSON, one file per frame."""
    body_path: Path | None = None
    """Body of the poses, or a folder of bodies, as `load_bodies` takes it; None for the default
    body."""


def predict_vibe_cam(
    manifest_path: Path,
    files: SeenFiles,
    out_dir: Path,
    config: VibeCamConfig | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict world motions as VIBE-CAM does.

    Of the manifest's clips, only the intrinsics, the image size and the images' numbers are used.
    The record says of each clip which rows have no prediction and why, and names the clips without
    files.  Errors are MissingInput where no clip has them, BadMotionFile, BadRecord, BadKeypoints,
    and BadRecipe where `person_ids` names a clip that is not there.
    """
    config = config or VibeCamConfig()
    subjects, left_out = predictions.manifest_subjects(
        manifest_path, lambda id: (files.poses_dir / f"{id}.npz", files.keypoints_dir / id)
    )
    known = [*(one.clip.id for one in subjects), *left_out]
    if unknown := sorted(config.person_ids.keys() - set(known)):
        what = f"no clip {', '.join(unknown)} in the manifest, which has {', '.join(known)}"
        raise BadRecipe(f"person_ids: {what}")
    inputs = {"manifest": manifest_path} | body_inputs(files.body_path)
    for id in (one.clip.id for one in subjects):
        inputs[f"poses_{id}"] = files.poses_dir / f"{id}.npz"
        inputs[f"keypoints_{id}"] = files.keypoints_dir / id

    def work(partial_dir: Path) -> None:
        bodies = load_bodies(files.body_path)
        made = []
        for one in track(subjects, "placing people", total=len(subjects)):
            id = one.clip.id
            posed, body = load_poses(inputs[f"poses_{id}"], one.clip, bodies)
            keypoints = clip_keypoints(
                one.clip,
                inputs[f"keypoints_{id}"],
                person_id=config.person_ids.get(id),
                image_size_px=config.image_size_px,
            )
            intrinsics_px = camera_of(one.clip).intrinsics_px
            placed = place_person(posed, keypoints, intrinsics_px, body, config.placement)
            made.append(_prediction(one, posed, placed, keypoints, body))
        predictions.write_predictions(partial_dir, "vibe_cam", made, left_out, VibeCamPredictions)

    return run_stage("baseline-vibe-cam", out_dir, config, inputs, work, run=run)


def load_poses(path: Path, clip: Clip, bodies: Sequence[BodyModel]) -> tuple[Clip, BodyModel]:
    """Another network's poses for a clip: in the camera's frame, the same rows; and their body."""
    posed = load_clip(path)
    motion = posed.motion
    if motion.frame != "camera":
        raise BadMotionFile(f"{path}: the motion is not in the camera frame")
    body = given_body(motion, bodies, BadMotionFile, f"{path}: of", "Give the poses' own body")
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
    subject: predictions.Subject,
    posed: Clip,
    placed: PlacedPerson,
    keypoints: ClipKeypoints,
    body: BodyModel,
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
            "n_rows_with_several_people": keypoints.n_crowded,
            "not_predicted": [
                {"start": start, "stop": stop, "reason": why}
                for start, stop, why in dropped_ranges(placed.missing)
            ],
        },
    )


def infer_poses(
    run_dir: Path,
    manifest_path: Path,
    poses_dir: Path,
    out_dir: Path,
    *,
    body_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict world motions from given local poses; their orientations are not looked at.

    Clips that are written have the given poses and shape; runs of frames that are too short for the
    network are not predicted, and clips without poses are left out.  `poses_dir` and `body_path`
    are as in `SeenFiles`.  MissingInput where no clip has poses, BadMotionFile where they have a
    lower rate than the network.
    """
    subjects, left_out = predictions.manifest_subjects(
        manifest_path, lambda id: (poses_dir / f"{id}.npz",)
    )
    inputs = {"run": weights_dir(run_dir), "manifest": manifest_path} | body_inputs(body_path)
    inputs |= {f"poses_{one.clip.id}": poses_dir / f"{one.clip.id}.npz" for one in subjects}

    def work(partial_dir: Path) -> None:
        gmr = load_gmr(run_dir)
        bodies = load_bodies(body_path)
        seen = (load_poses(inputs[f"poses_{one.clip.id}"], one.clip, bodies) for one in subjects)
        predicted = [_moved(gmr, one, *posed) for one, posed in zip(subjects, seen, strict=True)]
        kind = predictions.NetworkPredictions
        figures = predictions.NetworkFigures(run=run_dir.resolve().name)
        predictions.write_predictions(partial_dir, "gmr", predicted, left_out, kind, figures)

    # There is nothing to choose.
    return run_stage("gmr-on-poses", out_dir, Config(), inputs, work, run=run)


def _moved(
    gmr: TrainedGmr, subject: predictions.Subject, seen: Clip, body: BodyModel
) -> predictions.Prediction:
    """The poses with the world motion that the network sees in them."""
    motion = seen.motion
    valid = subject.clip.valid & seen.valid & np.isfinite(motion.local_rotmats).all((1, 2, 3))
    for first, stop in valid_runs(valid):
        if too_short(motion.take(slice(first, stop)), gmr.fps_hz, subject.clip.id):
            valid[first:stop] = False

    def motions_of(run: slice) -> tuple[np.ndarray, np.ndarray]:
        world = predict_at_source_rate(gmr, motion.take(run))
        return deltas(world.root_rotmats, world.pelvis_m)

    start = predictions.first_pose(subject.clip)
    root_rotmats, pelvis_m = predictions.roots_of_runs(valid, start, motions_of)
    moved = replace(
        motion,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m,
        frame="world",
        source=f"GMR on local poses of: {motion.source}",
    )
    rest_m = body.rest_pelvis_m(motion.shape)
    return predictions.predicted(subject, moved, valid, rest_pelvis_m=rest_m)
