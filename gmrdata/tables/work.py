"""One training and one score of a table, as jobs for workers.  A finished folder is kept."""

from pathlib import Path

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.gmr.config import TrainConfig
from gmrdata.tables.given import Given
from gmrdata.tables.plan import Scoring, Training, scored_manifest


def train_one(training: Training, given: Given, out_dir: Path, redo: bool) -> None:
    """Train a network into `out_dir/runs`; errors as in the trainers."""
    run_dir = out_dir / "runs" / training.id
    match training.config:
        case TrainConfig() as config:
            from gmrdata.gmr.train import train

            train(given.manifests, run_dir, config, body_path=given.body, redo=redo)
        case JointConfig() as config:
            from gmrdata.baselines.joint_train import train_joint

            assert given.features is not None
            train_joint(
                given.videos, given.features, run_dir, config, body_path=given.body, redo=redo
            )


def score_one(scoring: Scoring, given: Given, out_dir: Path, redo: bool) -> Path:
    """Predict where a row needs it, and score into `out_dir/scores`.

    Returns:
        Path of `scores.json`.
    """
    from gmrdata.evaluate.score import score_manifest, score_predictions

    manifest = scored_manifest(given, out_dir)
    scores_dir = out_dir / "scores" / scoring.id
    if scoring.row.method == "gmr" and scoring.row.poses == "true":
        run_dir = out_dir / "runs" / str(scoring.training)
        return score_manifest(run_dir, manifest, given.body, scores_dir, redo=redo)
    predictions = _predict(scoring, manifest, given, out_dir, redo) / "predictions"
    return score_predictions(predictions, manifest, given.body, scores_dir, redo=redo)


def _predict(scoring: Scoring, manifest: Path, given: Given, out_dir: Path, redo: bool) -> Path:
    into, run_dir = out_dir / "predictions" / scoring.id, out_dir / "runs" / str(scoring.training)
    match scoring.row.method:
        case "gmr":
            from gmrdata.tables.infer_poses import infer_poses

            assert given.poses is not None
            return infer_poses(
                run_dir, manifest, given.poses, into, body_path=given.body, redo=redo
            )
        case "joint":
            from gmrdata.baselines.joint_predict import predict_joint

            assert given.features is not None
            return predict_joint(run_dir, manifest, given.features, into, redo=redo)
        case "vibe_cam":
            from gmrdata.baselines.vibe_cam import predict_vibe_cam

            assert given.poses is not None and given.keypoints is not None
            return predict_vibe_cam(
                manifest, given.poses, given.keypoints, into, body_path=given.body, redo=redo
            )
        case "camera_as_world":
            from gmrdata.baselines.camera_as_world import predict_camera_as_world

            return predict_camera_as_world(manifest, into, redo=redo)
