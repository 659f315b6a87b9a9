"""Stage: world motions and local poses that the non-sequential model sees in image features."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.paper.joint_data import load_features, rows_per_frame
from gmrdata.paper.joint_model import JointModel, load_joint
from gmrdata.score import baseline_clips as predictions
from gmrdata.score.predictions import every_row
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import N_LOCAL
from gmrdata.values.errors import BadFeatures
from gmrdata.values.records import Config


def predict_joint(
    run_dir: Path, manifest_path: Path, features_dir: Path, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> Path:
    """Predict local poses and world motions from image features, at the network's frame rate.

    `run_dir` is a finished run of `gmrdata.paper.joint_train`, which sees features as there.
    Errors are MissingInput, BadCheckpoint, BadFeatures for those of other clips or networks, and
    BadMotionFile for a clip whose rate is no multiple of the network's.
    """
    subjects, left_out = predictions.manifest_subjects(manifest_path)
    inputs = {"run": run_dir, "manifest": manifest_path}
    inputs |= {f"features_{one.clip.id}": features_dir / f"{one.clip.id}.npz" for one in subjects}

    def work(partial_dir: Path) -> None:
        model = load_joint(run_dir)
        found = []
        for one in subjects:
            features = load_features(features_dir, one.clip)
            if features.shape[1] != model.n_features:
                path, found_size = inputs[f"features_{one.clip.id}"], features.shape[1]
                what = f"{found_size} numbers per frame, but the model takes {model.n_features}"
                raise BadFeatures(f"{path}: {what}. Give those it was trained on")
            found.append(seen_in_features(model, one, features))
        kind, figures = predictions.NetworkPredictions, predictions.NetworkFigures(run=run_dir.name)
        predictions.write_predictions(partial_dir, "joint", found, left_out, kind, figures)

    # There is nothing to choose: the frame rate is the network's.
    return run_stage("baseline-joint", out_dir, Config(), inputs, work, run=run)


def seen_in_features(
    model: JointModel, subject: predictions.Subject, features: np.ndarray
) -> predictions.Prediction:
    """What the network sees in features (T, D), run by run from the subject's first pose on."""
    clip = subject.clip
    step = rows_per_frame(clip, model.config.fps_hz)
    rows, valid = every_row(clip.valid, step)
    local_rotmats = np.full((len(rows), N_LOCAL, 3, 3), np.nan)

    def motions_of(run: slice) -> tuple[np.ndarray, np.ndarray]:
        local_rotmats[run], delta_rotmats, delta_m = _seen(model, features[rows[run]])
        return delta_rotmats, delta_m

    root_rotmats, pelvis_m = predictions.roots_of_runs(
        valid, predictions.first_pose(clip), motions_of
    )
    motion = replace(
        clip.motion,
        local_rotmats=local_rotmats,
        root_rotmats=root_rotmats,
        pelvis_m=pelvis_m,
        fps_hz=model.config.fps_hz,
        frame="world",
        source=f"seen in image features of: {clip.motion.source}",
    )
    return predictions.predicted(subject, motion, valid, step=step)


def _seen(model: JointModel, features: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local rotations (n, 23, 3, 3), dR (n-1, 3, 3) and dT (n-1, 3) [m], orthonormal to float64."""
    with torch.no_grad():
        output = model(torch.from_numpy(np.ascontiguousarray(features))[None])

    def orthonormal(rotmats: torch.Tensor) -> np.ndarray:
        flat = rotmats[0].double().numpy().reshape(-1, 3, 3)
        found: np.ndarray = flat if not len(flat) else Rotation.from_matrix(flat).as_matrix()
        return found.reshape(rotmats.shape[1:])

    return (
        orthonormal(output.local_rotmats),
        orthonormal(output.motions.delta_rotmats),
        output.motions.delta_m[0].double().numpy(),
    )
