"""The non-sequential model of Table 10: image features in, local poses and motions out.

Features are one vector per frame, from whatever network looks at images.  `<folder>/<clip id>.npz`
holds `features` (T, D), row t for row t of the manifest's clip; rows that are not valid in the clip
may hold NaN.  A training needs videos with features and true motions, as the paper's did; motion
capture alone, on which GMR trains, is of no use here.

    run/checkpoints/    the network and its optimiser (`gmrdata.gmr.checkpoint`)
    run/metrics.jsonl   one line per logged step: step, loss and its terms
    run/stage.json      recipe, inputs, versions
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from gmrdata.gmr import checkpoint, rotations
from gmrdata.gmr.checkpoint import StepState, load_weights, read_step_state, trained_checkpoint
from gmrdata.gmr.config import DataConfig, weights_dir
from gmrdata.gmr.flat_runs import TrainingRun, in_memory
from gmrdata.gmr.losses import Bodies, LossBody, Motions, gmr_loss, make_loss_bodies
from gmrdata.gmr.model import MotionNetwork
from gmrdata.gmr.runs import (
    ClipFile,
    LazyClips,
    Split,
    check_finite,
    fitting_clips,
    given_body,
    no_runs,
    require_own_ids,
    run_slices,
    split_manifests,
)
from gmrdata.gmr.steps import (
    Learner,
    check_device,
    derived_seed,
    fill_gradients,
    run_steps,
    torch_settings,
)
from gmrdata.gmr.windows import Batch, TrainingSet, batch_of, sample_window, stacked
from gmrdata.paper.plan import JointConfig
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import baselines as predictions
from gmrdata.score.predictions import every_row
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.body import N_LOCAL, BodyModel, names_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadFeatures, BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.motion import whole_ratio
from gmrdata.values.records import Config
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import quaternions_from_rotmats, rotmats_from_quaternions

KEY = "features"


def load_features(folder: Path, clip: Clip) -> np.ndarray:
    """The features of a clip's rows: (T, D) float32."""
    path = folder / f"{clip.id}.npz"
    if not path.is_file():
        raise MissingInput(f"{path}: no image features of clip {clip.id}; write `{KEY}` (T, D)")
    features = read_npz(path).get(KEY)
    n = clip.motion.n_frames
    if features is None or features.dtype.kind != "f" or features.ndim != 2 or len(features) != n:
        shape = "none" if features is None else f"{features.dtype} of shape {features.shape}"
        raise BadFeatures(f"{path}: {KEY} is {shape}, expected numbers of shape ({n}, D)")
    if not features.shape[1]:
        raise BadFeatures(f"{path}: {KEY} has no columns")
    with np.errstate(over="ignore"):  # what float32 can't hold becomes infinite
        features = features.astype(np.float32)
    bad = np.flatnonzero(clip.valid & ~np.isfinite(features).all(axis=1))
    if len(bad):
        raise BadFeatures(
            f"{path}: row {bad[0]} holds NaN or infinite numbers ({len(bad)} rows in all), and clip"
            f" {clip.id} has it as valid. Compute them again, or drop the rows in the manifest"
        )
    return features


def rows_per_frame(clip: Clip, fps_hz: float) -> int:
    """How many rows of a clip there are for one frame of the network."""
    step = whole_ratio(clip.motion.fps_hz, fps_hz)
    if step is None:
        raise BadMotionFile(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no whole multiple of {fps_hz:g} fps,"
            " and image features can't be resampled. Set fps_hz in the recipe"
        )
    return step


class JointState(StepState):
    """`state.json` of a kept step."""

    format: Literal["gmrdata-joint/2"] = "gmrdata-joint/2"
    n_features: int  # numbers per frame that the network takes
    config: JointConfig


@dataclass(frozen=True, eq=False)
class JointOutput:
    """What the network sees in B sequences of T frames."""

    motions: Motions  # dR (B, T-1, 3, 3) and dT (B, T-1, 3) [m]
    local_rotmats: Tensor  # (B, T, 23, 3, 3) parent_from_joint


class JointModel(MotionNetwork):
    """GMR's encoder over image features, with a head for the motion and one for the local pose."""

    feature_mean: Tensor
    feature_scale: Tensor
    mean_pose: Tensor

    def __init__(self, config: JointConfig, n_features: int) -> None:
        super().__init__(n_features, config.model)
        self.config = config
        self.n_features = n_features
        n_latent = config.model.n_features
        self.motion = nn.Linear(n_latent, rotations.SIZE[config.model.output] + 3)
        self.pose = nn.Linear(n_latent, N_LOCAL * rotations.SIZE["6d"])
        self.register_buffer("feature_mean", torch.zeros(n_features))
        self.register_buffer("feature_scale", torch.ones(n_features))
        self.register_buffer("mean_pose", torch.tensor(rotations.IDENTITY["6d"]).repeat(N_LOCAL))

    def start_from(
        self, features: Float[Tensor, "n numbers"], local_rotmats: Float[Tensor, "n 23 3 3"]
    ) -> None:
        """Take the scale of the inputs and the mean pose from training frames."""
        self.feature_mean.copy_(features.mean(0))
        # A feature that never changes says nothing, and stays at zero.
        spread = features.std(0, correction=0)
        self.feature_scale.copy_(torch.where(spread > 0, 1 / spread.clamp_min(1e-12), 0.0))
        self.mean_pose.copy_(rotations.from_rotmats(local_rotmats, "6d").flatten(1).mean(0))

    def forward(
        self, features: rotations.Sequences, lengths: rotations.Lengths = None
    ) -> JointOutput:
        """Local poses of T frames, and the T-1 motions between them; `lengths` as in `features`."""
        latent = self.features((features - self.feature_mean) * self.feature_scale, lengths)
        poses = (self.mean_pose + self.pose(latent)).unflatten(-1, (N_LOCAL, -1))
        motions = Motions(*self.motions(self.motion(latent[:, :-1])))
        return JointOutput(motions, rotations.to_rotmats(poses, "6d"))


def load_joint(run_dir: Path) -> JointModel:
    """The network of a run, on the CPU, in evaluation mode."""
    folder = trained_checkpoint(run_dir)
    state = read_step_state(folder, JointState)
    with torch.random.fork_rng(devices=[]):  # whose first weights nobody keeps
        model = JointModel(state.config, state.n_features)
    load_weights(folder, model)
    return model.eval()


def predict_joint(
    run_dir: Path,
    manifest_path: Path,
    features_dir: Path,
    out_dir: Path,
    *,
    body_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict local poses and world motions from image features, at the network's frame rate, on a
    body of mean shape.

    `run_dir` is a finished run of `train_joint`; `body_path` is the clips' body, None the default
    one.  The record names clips without features.  Errors are MissingInput where no clip has any,
    BadCheckpoint, BadFeatures for those of other clips or networks, and BadMotionFile for a clip of
    another body, or whose rate is no multiple of the network's.
    """
    subjects, left_out = predictions.manifest_subjects(
        manifest_path, lambda id: (features_dir / f"{id}.npz",)
    )
    inputs = {"run": weights_dir(run_dir), "manifest": manifest_path} | body_inputs(body_path)
    inputs |= {f"features_{one.clip.id}": features_dir / f"{one.clip.id}.npz" for one in subjects}

    def work(partial_dir: Path) -> None:
        model, bodies = load_joint(run_dir), load_bodies(body_path)
        predicted = []
        for one in subjects:
            features = load_features(features_dir, one.clip)
            if features.shape[1] != model.n_features:
                path, found_size = inputs[f"features_{one.clip.id}"], features.shape[1]
                what = f"{found_size} numbers per frame, but the model takes {model.n_features}"
                raise BadFeatures(f"{path}: {what}. Give those it was trained on")
            whose, remedy = f"clip {one.clip.id}: of", "Give the clips' own body"
            body = given_body(one.clip.motion, bodies, BadMotionFile, whose, remedy)
            predicted.append(seen_in_features(model, one, features, body))
        kind = predictions.NetworkPredictions
        figures = predictions.NetworkFigures(run=run_dir.resolve().name)
        predictions.write_predictions(partial_dir, "joint", predicted, left_out, kind, figures)

    # There is nothing to choose: the frame rate is the network's.
    return run_stage("baseline-joint", out_dir, Config(), inputs, work, run=run)


def seen_in_features(
    model: JointModel, subject: predictions.Subject, features: np.ndarray, body: BodyModel
) -> predictions.Prediction:
    """What the network sees in features (T, D), run by run from the subject's first pose on, on the
    body's mean shape: features hold none."""
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
        shape=np.zeros(body.n_shape),
        fps_hz=model.config.fps_hz,
        frame="world",
        source=f"seen in image features of: {clip.motion.source}",
    )
    rest_m = body.rest_pelvis_m(motion.shape)
    return predictions.predicted(subject, motion, valid, step=step, rest_pelvis_m=rest_m)


def _seen(model: JointModel, features: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local rotations (n, 23, 3, 3), dR (n-1, 3, 3) and dT (n-1, 3) [m], orthonormal to float64."""
    with torch.no_grad():
        output = model(torch.from_numpy(np.ascontiguousarray(features))[None])

    def orthonormal(rotmats: torch.Tensor) -> np.ndarray:
        return rotmats_from_quaternions(quaternions_from_rotmats(rotmats[0].double().numpy()))

    return (
        orthonormal(output.local_rotmats),
        orthonormal(output.motions.delta_rotmats),
        output.motions.delta_m[0].double().numpy(),
    )


N_LOCAL_VALUES = N_LOCAL * 9  # numbers of the local rotations of a frame


def split_videos(
    manifest_paths: Sequence[Path], held_out_subjects: tuple[int | str, ...] = ()
) -> Split:
    """Choose the clips to train on: all but those of people who are held out.

    BadManifest where two have one id, by which their features are found, or none is usable.
    """
    # What GMR never trains on are motions that it is scored on, not videos.
    data = DataConfig(held_out_subjects=held_out_subjects, never_train_on=())
    split = split_manifests(manifest_paths, data, may_lack_people=True)
    require_own_ids(split.training, "clips")
    return split


def train_joint(
    files: Sequence[ClipFile],
    features_dir: Path,
    run_dir: Path,
    config: JointConfig | None = None,
    *,
    body_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Train the network on clips (`split_videos`).  A run that was stopped goes on where it was.

    `body_path` is their body, None the default one. Errors are those of `gmrdata.gmr.train.train`;
    MissingInput where a clip has no features, and BadFeatures where features do not fit their clip
    or each other.
    """
    config = config or JointConfig()
    paths = dict.fromkeys(file.manifest_path for file in files)
    inputs = {f"manifest_{i}": path for i, path in enumerate(paths)}
    ids = [file.entry.id for file in files]
    inputs |= {f"features_{id}": features_dir / f"{id}.npz" for id in ids}
    inputs |= body_inputs(body_path)

    def work(partial_dir: Path) -> None:
        bodies = load_bodies(body_path)
        fitting = fitting_clips(LazyClips(files), bodies)
        pairs = [(clip, load_features(features_dir, clip)) for clip in fitting]
        training_set = training_runs(pairs, config.fps_hz, [body.name for body in bodies])
        fit_joint(training_set, bodies, partial_dir, config)

    return run_stage("joint-train", run_dir, config, inputs, Resumable(work, costly=True), run=run)


def fit_joint(
    training_set: TrainingSet, bodies: Sequence[BodyModel], run_dir: Path, config: JointConfig
) -> JointModel:
    """Train a network: goes on from the folder's latest checkpoint, or begins."""
    check_device(config.device)
    with torch_settings(config.device, config.threads, derived_seed(config.seed, 0)):
        learner = _JointLearner(training_set, bodies, run_dir, config)
        run_steps(learner, config)
    return learner.model


class _JointLearner(Learner[Batch]):
    model: JointModel

    def __init__(
        self,
        training_set: TrainingSet,
        bodies: Sequence[BodyModel],
        run_dir: Path,
        config: JointConfig,
    ) -> None:
        features, local_rotmats = split_rows(training_set.frames.poses)
        model = JointModel(config, features.shape[1])
        model.start_from(torch.from_numpy(features), torch.from_numpy(local_rotmats))
        super().__init__(model, config, run_dir)
        self._training_set, self._config = training_set, config
        self._loss_bodies = make_loss_bodies(bodies, config.loss.n_vertices, config.device)
        if (folder := checkpoint.latest_checkpoint(run_dir)) is not None:
            self.go_on_from(folder, checkpoint.read_step_state(folder, JointState).step)

    def batch_of(self, step: int) -> Batch:
        return make_joint_batch(self._training_set, self._config, step + 1)

    def gradients(self, batch: Batch) -> dict[str, float]:
        config = self._config

        def terms() -> dict[str, Tensor]:
            output = self.model(batch.poses.to(config.device), batch.lengths)
            return joint_loss(output, batch, self._loss_bodies, config)

        return fill_gradients(self.model, terms, config.gradient_norm)

    def state(self, done: int) -> JointState:
        return JointState(
            step=done,
            body=names_of(one.body for one in self._loss_bodies),
            n_features=self.model.n_features,
            config=self._config,
        )


def joint_loss(
    output: JointOutput, batch: Batch, loss_bodies: tuple[LossBody, ...], config: JointConfig
) -> dict[str, Tensor]:
    """Eq. 5 of the motion and the chordal loss of the local pose; terms are not weighted yet."""
    device = output.local_rotmats.device
    true_local = batch.local_rotmats.to(device)
    bodies = None
    if config.loss.vertex > 0:
        shape, local_rotmats = batch.shape.to(device), true_local[:, :-1]
        bodies = Bodies(loss_bodies, shape, local_rotmats, batch.bodies)
    true, mask = batch.motions.to(device), batch.mask.to(device)
    motion = gmr_loss(output.motions, true, mask, bodies, config.loss)
    per_joint = (output.local_rotmats - true_local).square().sum((-1, -2))
    is_real = (torch.arange(per_joint.shape[1]) < batch.lengths[:, None]).to(device)
    if config.loss.reduction == "mean":
        local_pose = per_joint.mean(-1)[is_real].mean()
    else:
        local_pose = torch.where(is_real[..., None], per_joint, 0.0).sum() / len(is_real)
    loss = motion.pop("loss") + config.local_pose * local_pose
    return {"loss": loss, "local_pose": local_pose} | motion


def joint_runs(clip: Clip, features: np.ndarray, fps_hz: float, body: int = 0) -> list[TrainingRun]:
    """Runs of valid frames, all phases: rows of features (T, D), then the local rotations."""
    check_finite(clip)
    step = rows_per_frame(clip, fps_hz)
    motion = clip.motion
    local = motion.local_rotmats.reshape(motion.n_frames, -1)
    rows = np.concatenate([features, local.astype(np.float32)], axis=1)
    return [
        TrainingRun(
            rows[now], motion.root_rotmats[now], motion.pelvis_m[now], motion.shape, body=body
        )
        for now in run_slices(clip.valid, step, step)
    ]


def split_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features (..., D) and local rotations (..., 23, 3, 3) of a run's rows (..., D + 207)."""
    features, local = rows[..., :-N_LOCAL_VALUES], rows[..., -N_LOCAL_VALUES:]
    return np.ascontiguousarray(features), local.reshape(*rows.shape[:-1], N_LOCAL, 3, 3)


def training_runs(
    pairs: Sequence[tuple[Clip, np.ndarray]], fps_hz: float, bodies: Sequence[str] = ()
) -> TrainingSet:
    """Runs of all training clips, with features of one size, each of a body of those names."""
    sizes = sorted({features.shape[1] for _, features in pairs})
    if len(sizes) > 1:
        raise BadFeatures(
            f"features have {' or '.join(map(str, sizes))} numbers per frame. Compute those of all"
            " clips with one network"
        )
    runs = [
        run
        for clip, features in pairs
        for run in joint_runs(
            clip, features, fps_hz, bodies.index(clip.motion.body) if bodies else 0
        )
    ]
    if not runs:
        raise no_runs(len(pairs), "training", fps_hz, "Give manifests with longer clips")
    return TrainingSet(in_memory(runs), "6d")


def make_joint_batch(training_set: TrainingSet, config: JointConfig, step: int) -> Batch:
    """The windows of one step, features as input; local rotations are the identity in padding."""
    rng = np.random.default_rng([config.seed, step])
    windows = [sample_window(training_set, config.windows, rng) for _ in range(config.batch_size)]
    rows, lengths, motions = stacked(windows, config.frames)
    features, local_rotmats = split_rows(rows)
    local_rotmats[np.arange(config.frames) >= lengths[:, None]] = np.eye(3)
    return batch_of(windows, features, lengths, motions, local_rotmats)
