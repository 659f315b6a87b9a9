"""Stage: train the non-sequential model of Table 10.

    run/checkpoints/    the network and its optimiser (`gmrdata.gmr.checkpoint`)
    run/metrics.jsonl   one line per logged step: step, loss and its terms
    run/stage.json      recipe, inputs, versions

It needs videos with image features and true motions, as the paper's did; motion capture alone, on
which GMR trains, is of no use here.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gmrdata.gmr import checkpoint
from gmrdata.gmr.flat_runs import TrainingRun, in_memory
from gmrdata.gmr.losses import Bodies, LossBody, gmr_loss, make_loss_bodies
from gmrdata.gmr.runs import MIN_FRAMES, check_finite, fitting_clips, no_runs, usable_clips
from gmrdata.gmr.steps import (
    Learner,
    check_device,
    derived_seed,
    fill_gradients,
    run_steps,
    torch_settings,
)
from gmrdata.gmr.windows import Batch, TrainingSet, sample_window, stacked
from gmrdata.motion.resample import valid_runs
from gmrdata.paper.joint_model import (
    JointModel,
    JointOutput,
    JointState,
    load_features,
    rows_per_frame,
)
from gmrdata.paper.recipe import JointConfig
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.body import N_LOCAL, BodyModel, names_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadFeatures

N_LOCAL_VALUES = N_LOCAL * 9  # numbers of the local rotations of a frame


def train_joint(
    manifest_paths: Sequence[Path],
    features_dir: Path,
    run_dir: Path,
    config: JointConfig | None = None,
    *,
    body_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Train the network on the clips of manifests.  A run that was stopped goes on where it was.

    Their image features are described in `gmrdata.paper.joint_model`; `body_path` is their body,
    None the default one.  Errors are those of `gmrdata.gmr.train.train`; MissingInput where a clip
    has no features, and BadFeatures where features do not fit their clip or each other.
    """
    config = config or JointConfig()
    clips = [one.clip for path in manifest_paths for one in usable_clips(path).clips]
    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    inputs |= {f"features_{clip.id}": features_dir / f"{clip.id}.npz" for clip in clips}
    inputs |= body_inputs(body_path)

    def work(partial_dir: Path) -> None:
        bodies = load_bodies(body_path)
        fitting = list(fitting_clips(clips, bodies))
        pairs = [(clip, load_features(features_dir, clip)) for clip in fitting]
        names = [body.name for body in bodies]
        training_set = training_runs(pairs, config.fps_hz, names)
        fit_joint(training_set, bodies, partial_dir, config)

    return run_stage("joint-train", run_dir, config, inputs, Resumable(work), run=run)


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
        for start, stop in valid_runs(clip.valid)
        for now in (slice(start + phase, stop, step) for phase in range(step))
        if stop - now.start > (MIN_FRAMES - 1) * step
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
    is_real = np.arange(config.frames) < lengths[:, None]
    local_rotmats[~is_real] = np.eye(3)
    return Batch(
        poses=torch.from_numpy(features),
        lengths=torch.from_numpy(lengths),
        mask=torch.from_numpy(is_real[:, 1:]),
        motions=motions,
        local_rotmats=torch.from_numpy(local_rotmats),
        shape=torch.from_numpy(np.stack([window.shape for window in windows])),
        bodies=torch.tensor([window.body for window in windows]),
    )
