"""What the measurements on CMU motions share: the data, the chosen recipe's run, and the record."""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

from gmr.cmu_ablation import changed
from gmr.cmu_data import HELD_OUT, Motions, every_motion, holding_out, scored_motions
from gmr.cmu_runs import Trained, trained, trained_for
from record import OUT_DIR, Record, machine

from gmrdata.gmr.config import LossConfig, TrainConfig
from gmrdata.gmr.train import GmrRecipe
from gmrdata.stage.recipes import find_recipe, load_recipe

SMALL_SIZE: dict[str, Any] = {
    "model": {"layers": 1, "hidden": 16},
    "batch_size": 4,
    "steps": 20,
    "eval_every": 5,
}


@dataclass
class CmuSession:
    """One run of the measurements; its trainings lie in `out/bench/gmr_cmu`, which it empties."""

    small: bool
    """Whether to only try every part, without bars."""
    cmu_dir: Callable[[], Path]
    """Where CMU's files are; asked only once."""

    def __post_init__(self) -> None:
        shutil.rmtree(self.work_dir, ignore_errors=True)
        self.work_dir.mkdir(parents=True)

    @cached_property
    def record(self) -> Record:
        """What was measured so far."""
        return Record(OUT_DIR / "gmr_cmu.json", self.small, self._settings)

    @property
    def work_dir(self) -> Path:
        """Where runs are kept, to look at."""
        return (OUT_DIR / "gmr_cmu").resolve()

    @property
    def recipe(self) -> TrainConfig:
        """The chosen settings: those of `gmrdata train --recipe gmr_cmu`."""
        config = load_recipe(find_recipe("gmr_cmu"), GmrRecipe).train
        return changed(config, SMALL_SIZE) if self.small else config

    @property
    def paper(self) -> TrainConfig:
        """The paper's settings, on as few vertices as ours, so that it gets more steps."""
        vertices = LossConfig(n_vertices=self.recipe.loss.n_vertices)
        threads = len(os.sched_getaffinity(0))
        config = holding_out(TrainConfig(loss=vertices, threads=threads), HELD_OUT)
        return changed(config, SMALL_SIZE) if self.small else config

    @cached_property
    def every(self) -> Path:
        """Manifest of all CMU motions at hand."""
        return every_motion(self.cmu_dir(), small=self.small)

    @cached_property
    def motions(self) -> Motions:
        """All motions, with subjects 02 and 08 to score."""
        return scored_motions(self.every, self.recipe, HELD_OUT)

    @cached_property
    def ours(self) -> Trained:
        """The chosen recipe, trained to its end."""
        return trained("ours", self.motions, self.recipe, self.work_dir)

    @cached_property
    def papers(self) -> Trained:
        """The paper's network and settings, trained for as long as ours."""
        return trained_for(
            self.ours.minutes, "the paper's", self.motions, self.paper, self.work_dir
        )

    @cached_property
    def papers_small(self) -> Trained:
        """The paper's settings on a network of our size, which gets through more steps."""
        size = {"layers": self.recipe.model.layers, "hidden": self.recipe.model.hidden}
        config = changed(self.paper, {"model": size, "threads": self.recipe.threads})
        name = "the paper's, our size"
        return trained_for(self.ours.minutes, name, self.motions, config, self.work_dir)

    def _settings(self) -> dict[str, Any]:
        return machine() | {
            "scale": "small" if self.small else "full",
            "recipe": self.recipe.model_dump(mode="json"),
            "torch": metadata.version("torch"),
        }
