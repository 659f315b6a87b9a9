"""Small clips to train on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gmrdata.gmr.config import LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.loop import fit
from gmrdata.gmr.model import Gmr
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from tests.motions import walking_clips


@pytest.fixture(scope="session")
def make_clips(small_body) -> Callable[..., list[Clip]]:
    """Generated walks of the small body as clips without cameras."""

    def make(count: int, seed: int, duration_s: float = 4.0, fps_hz: float = 20.0) -> list[Clip]:
        ids = [f"gait_{seed}_{i}" for i in range(count)]
        return walking_clips(small_body, ids, seed, fps_hz=fps_hz, duration_s=duration_s)

    return make


@pytest.fixture
def small_config() -> TrainConfig:
    """A run of a second: every option that has randomness is on."""
    return TrainConfig(
        model=ModelConfig(layers=2, hidden=12, dropout=0.2, output_scale=0.1),
        loss=LossConfig(n_vertices=16),
        windows=WindowConfig(frames=16),
        learning_rate=3e-3,
        schedule="cosine",
        warmup_steps=3,
        gradient_norm=1.0,
        batch_size=4,
        steps=12,
        seed=7,
        log_every=1,
        eval_every=4,
        checkpoint_every=5,
    )


@dataclass(frozen=True)
class Training:
    """What a training takes: clips, their body, a configuration and a folder."""

    make_clips: Callable[..., list[Clip]]
    body: BodyModel
    config: TrainConfig
    path: Path

    def fit(
        self, clips: Sequence[Clip], name: str = "", held_out: Sequence[Clip] = (), **changes: Any
    ) -> Gmr:
        """Train in the folder, or one of that name in it, with changes to the configuration."""
        config = self.config.model_copy(update=changes)
        return fit(clips, [self.body], self.path / name, config, held_out=held_out)


@pytest.fixture
def training(make_clips, small_body, small_config, tmp_path) -> Training:
    return Training(make_clips, small_body, small_config, tmp_path)
