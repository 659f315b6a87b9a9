"""One training and one score of a table, as jobs for workers.  A finished folder is kept.

For the paper's rows "Ours" (Tables 5 and 6), GMR sees another network's local poses.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.predict import TrainedGmr, load_gmr, predict_deltas
from gmrdata.gmr.train import train
from gmrdata.paper.joint_config import JointConfig
from gmrdata.paper.joint_predict import predict_joint
from gmrdata.paper.joint_train import train_joint
from gmrdata.paper.plan import Given, Scoring
from gmrdata.paper.vibe_cam import load_poses, predict_vibe_cam
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import baseline_clips as predictions
from gmrdata.score.camera_as_world import predict_camera_as_world
from gmrdata.score.predictions import every_row
from gmrdata.score.score import score
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import whole_ratio
from gmrdata.values.records import Config


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

    Clips that are written are at the network's frame rate, and have the given poses and shape.
    `poses_dir` holds `<clip id>.npz` for each clip, as `gmrdata.paper.vibe_cam` takes them, of
    the body in `body_path`; of the default body where it is None.
    """
    subjects, left_out = predictions.manifest_subjects(manifest_path)
    inputs = {"run": run_dir, "manifest": manifest_path}
    inputs |= body_inputs(body_path)
    inputs |= {f"poses_{one.clip.id}": poses_dir / f"{one.clip.id}.npz" for one in subjects}

    def work(partial_dir: Path) -> None:
        gmr, bodies = (
            load_gmr(run_dir),
            load_bodies("anny" if body_path is None else str(body_path)),
        )
        seen = (load_poses(inputs[f"poses_{one.clip.id}"], one.clip, bodies) for one in subjects)
        found = [_moved(gmr, one, *posed) for one, posed in zip(subjects, seen, strict=True)]
        kind, figures = predictions.NetworkPredictions, predictions.NetworkFigures(run=run_dir.name)
        predictions.write_predictions(partial_dir, "gmr", found, left_out, kind, figures)

    # There is nothing to choose: the frame rate is the network's.
    return run_stage("gmr-on-poses", out_dir, Config(), inputs, work, run=run)


def _moved(
    gmr: TrainedGmr, subject: predictions.Subject, seen: Clip, body: BodyModel
) -> predictions.Prediction:
    """The poses with the world motion that the network sees in them."""
    motion = seen.motion
    step = whole_ratio(motion.fps_hz, gmr.fps_hz)
    if step is None:
        raise BadMotionFile(
            f"clip {subject.clip.id}: {motion.fps_hz:g} fps is no multiple of the network's "
            f"{gmr.fps_hz:g}"
        )
    rows, valid = every_row(subject.clip.valid & seen.valid, step)
    local_rotmats = motion.local_rotmats[rows]

    def motions_of(run: slice) -> tuple[np.ndarray, np.ndarray]:
        if run.stop - run.start == 1:
            return np.zeros((0, 3, 3)), np.zeros((0, 3))
        return predict_deltas(gmr, local_rotmats[run])

    start = predictions.first_pose(subject.clip)
    root_rotmats, pelvis_m = predictions.roots_of_runs(valid, start, motions_of)
    moved = replace(
        motion,
        local_rotmats=local_rotmats,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m,
        fps_hz=gmr.fps_hz,
        frame="world",
        source=f"GMR on local poses of: {motion.source}",
    )
    rest_m = body.rest_pelvis_m(motion.shape)
    return predictions.predicted(subject, moved, valid, step=step, rest_pelvis_m=rest_m)


def train_one(
    id: str, config: TrainConfig | JointConfig, given: Given, out_dir: Path, run: Run
) -> None:
    """Train a network into `out_dir/runs`; errors as in the trainers."""
    run_dir, body = out_dir / "runs" / id, given.body
    if isinstance(config, TrainConfig):
        train(given.manifests, run_dir, config, body_path=body, run=run)
    else:
        assert given.features is not None
        train_joint(given.videos, given.features, run_dir, config, body_path=body, run=run)


def score_one(scoring: Scoring, given: Given, out_dir: Path, run: Run) -> Path:
    """Predict where a row needs it, and score into `out_dir/scores`; gives its `scores.json`."""
    manifest = given.scored or out_dir / "held_out" / "manifest.yaml"
    scores_dir = out_dir / "scores" / scoring.id
    if scoring.row.method == "gmr" and scoring.row.poses == "true":
        predictor = _network(scoring, given, out_dir)
    else:
        predictor = _predict(scoring, manifest, given, out_dir, run)
    return score(predictor, manifest, scores_dir, body_path=given.body, run=run).scores[0]


def _network(scoring: Scoring, given: Given, out_dir: Path) -> Path:
    """The run that a row's training left, or the network that was given in its place."""
    if scoring.training is None and given.network is not None:
        return given.network
    return out_dir / "runs" / str(scoring.training)


def _predict(scoring: Scoring, manifest: Path, given: Given, out_dir: Path, run: Run) -> Path:
    into, run_dir = out_dir / "predictions" / scoring.id, _network(scoring, given, out_dir)
    match scoring.row.method:
        case "gmr":
            assert given.poses is not None
            return infer_poses(run_dir, manifest, given.poses, into, body_path=given.body, run=run)
        case "joint":
            assert given.features is not None
            return predict_joint(run_dir, manifest, given.features, into, run=run)
        case "vibe_cam":
            assert given.poses is not None and given.keypoints is not None
            return predict_vibe_cam(
                manifest, given.poses, given.keypoints, into, body_path=given.body, run=run
            )
        case "camera_as_world":
            return predict_camera_as_world(manifest, into, run=run)
