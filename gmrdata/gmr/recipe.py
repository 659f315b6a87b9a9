"""A recipe of kind `gmr`: what to train on, how, and what to score."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from gmrdata.config import Config
from gmrdata.gmr.config import TrainConfig


class WeightedManifest(Config):
    """A manifest to train on, and how often."""

    manifest: Path
    """The manifest, relative to the recipe's folder."""
    weight: float | None = Field(default=None, gt=0.0)
    """Share of the windows that come from it, up to a factor; None for its share of all frames."""


class GmrRecipe(Config):
    """Train a network on manifests and score it on others."""

    recipe: Literal["gmr"]
    """Kind of recipe."""
    training: tuple[Path | WeightedManifest, ...] = ()
    """Manifests to train on, relative to the recipe's folder; else those of the command line.
    Either all of them have a weight or none."""
    scored: tuple[Path, ...] = ()
    """Manifests to score on, relative to the recipe's folder."""
    body: Path | None = None
    """Body model of the clips, relative to the recipe's folder; the default body if left out."""
    train: TrainConfig = TrainConfig()
    """The network and its training."""

    @model_validator(mode="after")
    def _weights_fit(self) -> Self:
        known = [weight is not None for weight in self._weights()]
        if any(known) and not all(known):
            raise ValueError("training: give each manifest a weight, or none of them")
        if any(known) and self.train.data.weights is not None:
            raise ValueError("weights stand in training and in train.data.weights; leave one out")
        return self

    def training_paths(self, folder: Path) -> list[Path]:
        """The manifests to train on, for a recipe that lies in `folder`."""
        return [
            folder / (one.manifest if isinstance(one, WeightedManifest) else one)
            for one in self.training
        ]

    def train_config(self) -> TrainConfig:
        """`train`, with the weights that stand beside the manifests."""
        weights = [weight for weight in self._weights() if weight is not None]
        if not weights:
            return self.train
        data = self.train.data.model_copy(update={"weights": tuple(weights)})
        return self.train.model_copy(update={"data": data})

    def _weights(self) -> list[float | None]:
        return [one.weight if isinstance(one, WeightedManifest) else None for one in self.training]
