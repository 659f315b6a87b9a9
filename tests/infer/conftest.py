"""Small networks, and a person who walks."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.body.file import save_body
from gmrdata.body.model import BodyModel
from gmrdata.gmr.checkpoint import save_checkpoint
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.infer import TrainedGmr
from gmrdata.gmr.model import Gmr
from gmrdata.motion.gait import embedded_motions
from gmrdata.motion.motion import Motion


@pytest.fixture(scope="session")
def walk(small_body: BodyModel) -> Callable[..., Motion]:
    """`walk(fps_hz, n_frames)`: the embedded gait on the small body."""

    def make(fps_hz: float = 30.0, n_frames: int = 46) -> Motion:
        rng = np.random.default_rng(3)
        seconds = (n_frames + 1) / fps_hz
        motion = embedded_motions(
            small_body, rng, count=1, fps_hz=fps_hz, duration_s=max(1.0, seconds)
        )[0]
        assert motion.n_frames >= n_frames
        return Motion(
            local_rotmats=motion.local_rotmats[:n_frames],
            root_rotmats=motion.root_rotmats[:n_frames],
            pelvis_m=motion.pelvis_m[:n_frames],
            shape=motion.shape,
            fps_hz=fps_hz,
            body=motion.body,
            gender=motion.gender,
            frame=motion.frame,
            source=motion.source,
        )

    return make


@pytest.fixture
def untrained() -> TrainedGmr:
    """A network of random weights."""
    torch.manual_seed(0)
    config = ModelConfig(layers=1, hidden=6, output_scale=0.1)
    return TrainedGmr(Gmr(config).eval(), 10.0, "untrained", 3)


@pytest.fixture(scope="session")
def constant() -> Callable[..., TrainedGmr]:
    """`constant(turn, step_m)`: a network that sees the same motion between any two frames."""

    def make(turn: Sequence[float], step_m: Sequence[float]) -> TrainedGmr:
        model = Gmr(ModelConfig(layers=1, hidden=6, output="axis-angle")).eval()
        with torch.no_grad():
            model.regression.weight.zero_()
            model.regression.bias.copy_(torch.tensor([*turn, *step_m]))
        return TrainedGmr(model, 10.0, "constant", 1)

    return make


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A finished run of a small network."""
    torch.manual_seed(0)
    model = Gmr(ModelConfig(layers=1, hidden=6, output_scale=0.1))
    optimizer = torch.optim.Adam(model.parameters())
    inputs = model.encoder.input_size
    delta_rotmats, delta_m = model(torch.randn(1, 4, inputs))
    (delta_rotmats.sum() + delta_m.sum()).backward()
    optimizer.step()
    save_checkpoint(tmp_path / "run", 1, model, optimizer, {"fps_hz": 10.0})
    return tmp_path / "run"


@pytest.fixture
def body_path(tmp_path: Path, small_body: BodyModel) -> Path:
    """The small body's file."""
    save_body(tmp_path / "body.npz", small_body)
    return tmp_path / "body.npz"
