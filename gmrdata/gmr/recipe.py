"""A recipe of kind `gmr`: what to train on, how, and what to score."""

from pathlib import Path
from typing import Literal

from gmrdata.config import Config
from gmrdata.gmr.config import TrainConfig


class GmrRecipe(Config):
    """Train a network on manifests and score it on others."""

    recipe: Literal["gmr"]
    """Kind of recipe."""
    training: tuple[Path, ...] = ()
    """Manifests to train on, relative to the recipe's folder; else those of the command line."""
    scored: tuple[Path, ...] = ()
    """Manifests to score on, relative to the recipe's folder."""
    body: Path | None = None
    """Body model of the clips, relative to the recipe's folder; the default body if left out."""
    train: TrainConfig = TrainConfig()
    """The network and its training."""
