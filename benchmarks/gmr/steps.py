"""Training steps that are timed beside one another: ours, the direct reading's, the bare network's.

All three have the same network, windows and optimiser, and do forward, backward and Adam.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.loop import gradient_step
from gmrdata.gmr.losses import Motions, gmr_loss, make_loss_bodies
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.windows import Batch, TrainingSet, make_batch, make_training_set
from gmrdata.values.body import BodyModel
from tests.gmr.direct_reading import direct_mesh_m
from tests.motions import walking_clips

Step = Callable[[int], None]
"""Does a training step; its number decides the windows."""


@dataclass(frozen=True, eq=False)
class Workload:
    """What a step is made of."""

    config: TrainConfig
    """The recipe."""
    body: BodyModel
    """The body."""
    training_set: TrainingSet
    """What windows are drawn from."""

    def batch(self, step: int) -> Batch:
        """The windows of a step."""
        config = self.config
        return make_batch(self.training_set, config.windows, config.batch_size, config.seed, step)

    def network(self) -> tuple[Gmr, torch.optim.Optimizer]:
        """A network with its optimiser, always the same at the start."""
        torch.manual_seed(0)
        model = Gmr(self.config.model).to(self.config.device)
        return model, torch.optim.Adam(model.parameters(), lr=self.config.learning_rate)


def workload(config: TrainConfig, body: BodyModel) -> Workload:
    """Generated walks of a body: as many and as long that no window is padded."""
    clips = walking_clips(body, ["0", "1", "2", "3"], fps_hz=10.0, duration_s=20.0)
    training_set = make_training_set(clips, config.model, config.windows)
    return Workload(config, body, training_set)


def recipe(
    layers: int,
    hidden: int,
    batch: int,
    frames: int,
    *,
    device: str = "cpu",
    precision: str = "fp32",
) -> TrainConfig:
    """The paper's recipe at some size."""
    return TrainConfig.model_validate(
        {
            "model": ModelConfig(layers=layers, hidden=hidden),
            "windows": WindowConfig(frames=frames),
            "batch_size": batch,
            "device": device,
            "precision": precision,
        }
    )


def our_step(work: Workload) -> Step:
    """A step of the training loop."""
    model, optimizer = work.network()
    loss_bodies = make_loss_bodies([work.body], None, work.config.device)

    def step(number: int) -> None:
        gradient_step(model, work.batch(number), loss_bodies, work.config)
        optimizer.step()

    return step


def direct_step(work: Workload) -> Step:
    """The same loss, with both meshes of eq. 13 made by the body's forward pass."""
    model, optimizer = work.network()

    def step(number: int) -> None:
        model.zero_grad(set_to_none=True)
        direct_loss(work, model, work.batch(number)).backward()
        optimizer.step()

    return step


def direct_loss(work: Workload, model: Gmr, batch: Batch) -> Tensor:
    """Eq. 5 as it is written."""
    delta_rotmats, delta_m = model(batch.poses, batch.lengths)
    predicted = Motions(delta_rotmats[:, :-1], delta_m[:, :-1])
    others: LossConfig = work.config.loss.model_copy(update={"vertex": 0.0})
    terms = gmr_loss(predicted, batch.motions, batch.mask, None, others)
    shape, local_rotmats = batch.shape[:, None], batch.local_rotmats[:, :-1]
    predicted_m, true_m = (
        direct_mesh_m(work.body, shape, motions.delta_rotmats, motions.delta_m, local_rotmats)
        for motions in (predicted, batch.motions)
    )
    distances_m = (predicted_m - true_m).abs().sum(-1).mean(-1)
    return terms["loss"] + work.config.loss.vertex * distances_m[batch.mask].mean()


def bare_step(work: Workload) -> Step:
    """GRUs and linear layers with the squared distance to some numbers as their loss."""
    model, optimizer = work.network()
    device, config = work.config.device, work.config
    batch = work.batch(0)
    poses = batch.poses.to(device)
    wanted = torch.randn(*poses.shape[:2], model.regression.out_features, device=device)

    def step(_: int) -> None:
        model.zero_grad(set_to_none=True)
        with torch.autocast(device, torch.bfloat16, enabled=config.precision == "bf16"):
            values = model.regression(model.projection(model.encoder(poses)[0]))
        loss = torch.nn.functional.mse_loss(values.float(), wanted)
        loss.backward()
        optimizer.step()
        loss.item()

    return step


def difference_to_direct(work: Workload) -> dict[str, float]:
    """How far our loss and its gradient are from the direct reading's, relative to these."""
    batch, loss_bodies = work.batch(0), make_loss_bodies([work.body], None, "cpu")
    ours, _ = work.network()
    value = gradient_step(ours, batch, loss_bodies, work.config)["loss"]
    direct, _ = work.network()
    loss = direct_loss(work, direct, batch)
    loss.backward()
    gradients = [
        torch.nn.utils.parameters_to_vector(
            p.grad for p in model.parameters() if p.grad is not None
        )
        for model in (ours, direct)
    ]
    return {
        "loss": abs(value - loss.item()) / loss.item(),
        "gradient": float((gradients[0] - gradients[1]).norm() / gradients[1].norm()),
    }


def with_pose_shapes(body: BodyModel) -> BodyModel:
    """The body with random pose blend shapes of SMPL's number and about its size."""
    rng = np.random.default_rng(0)
    return replace(body, pose_dirs_m=rng.normal(0, 2e-3, (len(body.template_m), 3, 207)))
