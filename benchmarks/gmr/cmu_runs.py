"""Trainings as a user starts them, their scores, and a training that gets so many minutes."""

import json
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gmr.cmu_data import Motions

from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.loop import fit
from gmrdata.gmr.runs import LazyClips, split_manifests
from gmrdata.gmr.train import train
from gmrdata.read.bodies import load_body
from gmrdata.score.score import score
from gmrdata.stage.store import stage_seconds
from gmrdata.values.files import read_json

METRICS = ("ome_deg", "tme_mm", "vme_mm")


@dataclass(frozen=True)
class Trained:
    """A run and its scores on what it was not trained on."""

    name: str
    run_dir: Path
    config: TrainConfig
    steps: int
    minutes: float
    held_out: dict[str, float]
    """Of the network and of zero motion (`zero_*`), pooled over all motions [deg, mm]."""
    mean_of_clips: dict[str, float]
    """The same as the mean of the clips' means."""

    @property
    def row(self) -> dict[str, Any]:
        """For a table and for JSON."""
        scores = self.held_out
        shares = {
            f"{metric[:3]}_of_zero": round(scores[metric] / scores[f"zero_{metric}"], 4)
            for metric in METRICS
        }
        figures = {metric: round(scores[metric], 3) for metric in METRICS}
        sizes = {"steps": self.steps, "minutes": round(self.minutes, 2)}
        return {"run": self.name} | sizes | figures | shares

    @property
    def curve(self) -> list[dict[str, float]]:
        """Held-out scores and losses by step, as they were logged."""
        lines = (self.run_dir / "metrics.jsonl").read_text("utf-8").splitlines()
        return [json.loads(line) for line in lines]


def trained(name: str, motions: Motions, config: TrainConfig, out_dir: Path) -> Trained:
    """Train by the stage, as `gmrdata train` does, and score."""
    run_dir = out_dir / _folder(name)
    train([motions.every], run_dir, config)
    return _scored(name, run_dir, config, config.steps, stage_seconds(run_dir) / 60, motions)


def trained_for(
    minutes: float, name: str, motions: Motions, config: TrainConfig, out_dir: Path
) -> Trained:
    """Train for so many minutes with a constant step size: the loop goes on from where it was."""
    assert config.schedule == "constant", "another schedule depends on the number of steps"
    split = split_manifests([motions.every], config.data)
    clips, held_out = list(LazyClips(split.training)), list(LazyClips(split.held_out))
    body, run_dir = load_body("anny"), out_dir / _folder(name)
    run_dir.mkdir(parents=True)
    start_s, steps, more = time.monotonic(), 0, 1
    while more:
        steps += more
        before_s = time.monotonic()
        fit(clips, [body], run_dir, _until(config, steps), held_out=held_out)
        # Start and end of a call are counted as steps, so time is left for another, longer one.
        step_s = (time.monotonic() - before_s) / more
        spent_s = time.monotonic() - start_s
        more = max(0, int((60 * minutes - spent_s) / step_s))
    return _scored(name, run_dir, config, steps, spent_s / 60, motions)


def _folder(name: str) -> str:
    return re.sub(r"\W+", "_", name)


def _until(config: TrainConfig, steps: int) -> TrainConfig:
    every = {"eval_every": max(1, steps // 10), "checkpoint_every": steps}
    return config.model_copy(update={"steps": steps} | every)


def _scored(
    name: str, run_dir: Path, config: TrainConfig, steps: int, minutes: float, motions: Motions
) -> Trained:
    out_dir = run_dir.with_name(f"{run_dir.name}_scores")
    overall = read_json(score(run_dir, motions.held_out, out_dir).scores[0])["overall"]
    return Trained(
        name,
        run_dir,
        config,
        steps,
        minutes,
        _flat(overall["pooled_over_motions"]),
        _flat(overall["mean_of_clips"]),
    )


def _flat(scores: dict[str, dict[str, float]]) -> dict[str, float]:
    zero = {f"zero_{metric}": scores["zero"][metric] for metric in METRICS}
    return {metric: scores["predicted"][metric] for metric in METRICS} | zero
