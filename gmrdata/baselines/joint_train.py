"""Stage: train the non-sequential model of Table 10.

    run/checkpoints/    the network and its optimiser (`gmrdata.gmr.checkpoint`)
    run/metrics.jsonl   one line per logged step: step, loss and its terms
    run/stage.json      recipe, inputs, versions

It needs videos with image features and true motions, as the paper's did; motion capture alone, on
which GMR trains, is of no use here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.baselines.joint_data import (
    JointBatch,
    JointRun,
    features_path,
    load_features,
    make_joint_batch,
    training_runs,
)
from gmrdata.baselines.joint_model import JointModel, JointOutput, resume_joint, save_joint
from gmrdata.gmr.losses import LossTerms, Motions, gmr_loss
from gmrdata.gmr.parallel import check_device
from gmrdata.gmr.run_log import run_log
from gmrdata.gmr.runs import check_clips_fit, usable_clips
from gmrdata.gmr.steps import check_finite, derived_seed, torch_settings
from gmrdata.gmr.vertex_loss import Bodies, LossBody, make_loss_body
from gmrdata.stage.progress import progress_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel


@dataclass(frozen=True, eq=False)
class JointTerms:
    """The loss, and its parts before they are weighted."""

    total: Tensor
    """What is minimised: eq. 5 and the weighted local pose."""
    motion: LossTerms
    """Eq. 5."""
    local_pose: Tensor
    """Chordal loss of the local rotations."""

    def as_values(self) -> dict[str, float]:
        """The numbers by name."""
        return {
            "loss": self.total.item(),
            "local_pose": self.local_pose.item(),
            "orientation": self.motion.orientation.item(),
            "translation": self.motion.translation.item(),
            "vertex": self.motion.vertex.item(),
            "smoothness": self.motion.smoothness.item(),
        }


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

    Args:
        manifest_paths: Manifests whose clips are trained on.
        features_dir: Their image features; see `gmrdata.baselines.joint_data`.
        run_dir: The run folder to make.
        config: The recipe; None for its defaults.
        body_path: Body of the clips, as `load_body` takes it; None for the default body.

    Returns:
        `run_dir`.

    Raises:
        BadManifest: no clips to train on, or of another body than the given one.
        BadMotionFile: a clip holds NaN, or its rate is no multiple of the network's.
        MissingInput: a clip has no features.
        BadFeatures: features do not fit their clip or each other.
        TrainingDiverged: the loss became infinite or NaN.
        BadCheckpoint: the checkpoint to go on from is broken.
        StageFailed: a GPU is asked for, and there is none.
    """
    config = config or JointConfig()
    clips = [one.clip for path in manifest_paths for one in usable_clips(path).clips]
    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    inputs |= {f"features_{clip.id}": features_path(features_dir, clip.id) for clip in clips}
    if body_path is not None:
        inputs["body"] = body_path

    def work(partial_dir: Path) -> None:
        from gmrdata.read.bodies import load_body

        body = load_body("anny" if body_path is None else str(body_path))
        check_clips_fit(clips, body)
        pairs = [(clip, load_features(features_dir, clip)) for clip in clips]
        fit_joint(training_runs(pairs, config.fps_hz), body, partial_dir, config)

    return run_stage("joint-train", run_dir, config, inputs, work, run=run, resumable=True)


def fit_joint(
    runs: Sequence[JointRun], body: BodyModel, run_dir: Path, config: JointConfig
) -> JointModel:
    """The training loop: goes on from the folder's latest checkpoint, or begins.

    Args:
        runs: What to train on.
        body: Their body.
        run_dir: Gets `checkpoints` and `metrics.jsonl`.
        config: The recipe.

    Raises:
        TrainingDiverged: the loss became infinite or NaN.
        BadCheckpoint: the checkpoint to go on from is broken.
        StageFailed: a GPU is asked for, and there is none.
    """
    check_device(config.device)
    loss_body = make_loss_body(body, config.loss.n_vertices, config.device)
    settings = torch_settings(config.device, config.threads, derived_seed(config.seed, 0))
    with settings, progress_bar() as bar:
        model = _new_model(runs, config)
        optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
        done = resume_joint(run_dir, model, optimizer)
        task = bar.add_task("training", total=config.steps, completed=done)
        with run_log(run_dir, done, tensorboard=False) as log:
            for step in range(done + 1, config.steps + 1):
                torch.manual_seed(derived_seed(config.seed, step))
                batch = make_joint_batch(runs, config, step)
                values = _gradient_step(model, batch, loss_body, config)
                check_finite(values, run_dir, step)
                optimizer.step()
                bar.update(task, advance=1, description=f"training  loss {values['loss']:.5f}")
                is_last = step == config.steps
                if step % config.log_every == 0 or is_last:
                    log({"step": step} | values)
                if step % config.checkpoint_every == 0 or is_last:
                    save_joint(run_dir, step, model, optimizer, body.name)
    return model


def _gradient_step(
    model: JointModel, batch: JointBatch, loss_body: LossBody, config: JointConfig
) -> dict[str, float]:
    """Fill the gradients of a step; its loss, terms, and the gradient's length before clipping."""
    model.zero_grad(set_to_none=True)
    output = model(batch.features.to(config.device), batch.lengths)
    terms = joint_loss(output, batch, loss_body, config)
    terms.total.backward()
    limit = math.inf if config.gradient_norm is None else config.gradient_norm
    norm = torch.nn.utils.clip_grad_norm_(model.parameters(), limit)
    return terms.as_values() | {"gradient_norm": norm.item()}


def joint_loss(
    output: JointOutput,
    batch: JointBatch,
    loss_body: LossBody,
    config: JointConfig,
) -> JointTerms:
    """Eq. 5 of the motion, and the chordal loss of the local pose.

    Args:
        output: What the network sees.
        batch: The windows.
        loss_body: The body, made ready for the vertex term.
        config: The recipe.
    """
    device = output.local_rotmats.device
    true_local = batch.local_rotmats.to(device)
    bodies = None
    if config.loss.vertex > 0:
        bodies = Bodies(loss_body, batch.shape.to(device), true_local[:, :-1])
    mask = batch.frame_mask.to(device)
    motion = gmr_loss(
        output.motions,
        Motions(batch.motions.delta_rotmats.to(device), batch.motions.delta_m.to(device)),
        mask[:, 1:],
        bodies,
        config.loss,
    )
    per_joint = (output.local_rotmats - true_local).square().sum((-1, -2))
    if config.loss.reduction == "mean":
        local_pose = per_joint.mean(-1)[mask].mean()
    else:
        local_pose = torch.where(mask[..., None], per_joint, 0.0).sum() / len(mask)
    return JointTerms(motion.total + config.local_pose * local_pose, motion, local_pose)


def _new_model(runs: Sequence[JointRun], config: JointConfig) -> JointModel:
    model = JointModel(config, runs[0].features.shape[1])
    model.start_from(
        torch.cat([torch.from_numpy(run.features) for run in runs]),
        torch.cat([torch.from_numpy(run.local_rotmats) for run in runs]),
    )
    return model.to(config.device).train()
