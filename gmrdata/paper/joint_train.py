"""Stage: train the non-sequential model of Table 10.

    run/checkpoints/    the network and its optimiser (`gmrdata.gmr.checkpoint`)
    run/metrics.jsonl   one line per logged step: step, loss and its terms
    run/stage.json      recipe, inputs, versions

It needs videos with image features and true motions, as the paper's did; motion capture alone, on
which GMR trains, is of no use here.
"""

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from gmrdata.gmr import checkpoint
from gmrdata.gmr.losses import gmr_loss
from gmrdata.gmr.runs import fitting_clips, usable_clips
from gmrdata.gmr.steps import (
    Learner,
    check_device,
    derived_seed,
    fill_gradients,
    run_steps,
    torch_settings,
)
from gmrdata.gmr.vertex_loss import Bodies, LossBody, make_loss_bodies
from gmrdata.gmr.windows import Batch, TrainingSet
from gmrdata.paper import joint_data
from gmrdata.paper.joint_config import JointConfig
from gmrdata.paper.joint_model import JointModel, JointOutput, JointState
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.bodies import names_of
from gmrdata.values.body import BodyModel


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

    Their image features are described in `gmrdata.paper.joint_data`; `body_path` is their body,
    None the default one.  Errors are those of `gmrdata.gmr.train.train`; MissingInput where a clip
    has no features, and BadFeatures where features do not fit their clip or each other.
    """
    config = config or JointConfig()
    clips = [one.clip for path in manifest_paths for one in usable_clips(path).clips]
    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    inputs |= {f"features_{clip.id}": features_dir / f"{clip.id}.npz" for clip in clips}
    inputs |= body_inputs(body_path)

    def work(partial_dir: Path) -> None:
        bodies = load_bodies("anny" if body_path is None else str(body_path))
        fitting = list(fitting_clips(clips, bodies))
        pairs = [(clip, joint_data.load_features(features_dir, clip)) for clip in fitting]
        names = [body.name for body in bodies]
        training_set = joint_data.training_runs(pairs, config.fps_hz, names)
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
        features, local_rotmats = joint_data.split_rows(training_set.frames.poses)
        model = JointModel(config, features.shape[1])
        model.start_from(torch.from_numpy(features), torch.from_numpy(local_rotmats))
        super().__init__(model, config, run_dir)
        self._training_set, self._config = training_set, config
        self._loss_bodies = make_loss_bodies(bodies, config.loss.n_vertices, config.device)
        if (folder := checkpoint.latest_checkpoint(run_dir)) is not None:
            self.go_on_from(folder, checkpoint.read_step_state(folder, JointState).step)

    def batch_of(self, step: int) -> Batch:
        return joint_data.make_joint_batch(self._training_set, self._config, step + 1)

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
