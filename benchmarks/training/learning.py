"""The lifter that ships, made of motions and of the landmark network's measured errors.

    python -m training.learning MANIFEST OUT [--recipe FILE]

MANIFEST is what `gmrdata motions` left of CMU's trials.  About ten minutes on one core.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from training.examples import Example, ExampleSampler, SpoilConfig, bank_of
from training.noise import NOISE_FILE, LandmarkNoise

from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import ListManifest
from gmrdata.manifest.read import load_entry, read_manifest
from gmrdata.people.landmark_network import tree_joints
from gmrdata.people.lifter import Lifter, LifterConfig, save_lifter
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import progress_bar
from gmrdata.stage.recipes import load_recipe
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadManifest, MissingInput
from gmrdata.values.records import Config, Figure, Record

LIFTER_FILE, RECORD_FILE = "lifter.safetensors", "lifter.json"
RECIPE_FILE = Path(__file__).with_name("lifter.yaml")
"""That of the weights that ship."""


class TrainingConfig(Config):
    """How the lifter is made."""

    network: LifterConfig = LifterConfig()
    spoil: SpoilConfig = SpoilConfig()
    steps: int = Field(default=1500, ge=1)
    batch_size: int = Field(default=256, ge=1)
    reuse: int = Field(default=3, ge=1)
    """Steps for which an example is used, among others each time: making them takes longer."""
    learning_rate: float = Field(default=1e-3, gt=0)
    warmup_steps: int = Field(default=100, ge=1)
    average_decay: float = Field(default=0.995, ge=0, lt=1)
    rotation_weight: float = Field(default=0.3, ge=0)
    leg_weight: float = Field(default=0.1, ge=0)
    held_out_subjects: tuple[int, ...] = (2, 8)
    """CMU's subjects that are not trained on."""
    held_out_trials: tuple[str, ...] = ()
    """CMU's trials that are not trained on."""
    seed: int = Field(default=0, ge=0)


class LifterRecipe(TrainingConfig):
    """`recipe: lifter`."""

    recipe: Literal["lifter"]

    def config(self) -> TrainingConfig:
        return TrainingConfig(**{key: getattr(self, key) for key in TrainingConfig.model_fields})


class LifterRecord(Record):
    """`lifter.json`: what a lifter was made of."""

    format: Literal["gmrdata-lifter/1"] = "gmrdata-lifter/1"
    motions: int
    frames: int
    """Of them, at the lifter's rate."""
    held_out: tuple[str, ...]
    """Clips of the manifest that were left out."""
    steps: int
    joints_mm: Figure
    """Mean distance of joints from the pelvis on the last examples, before any alignment."""


def train_lifter(
    manifest_path: Path,
    body_path: Path,
    out_dir: Path,
    config: TrainingConfig,
    *,
    noise_path: Path = NOISE_FILE,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: `lifter.safetensors` and `lifter.json`, trained on a manifest's motions.

    Clips of CMU's held-out subjects and trials are known by their names (02_03).  MissingInput
    where no motion is left.
    """

    def work(partial: Path) -> None:
        torch.set_num_threads(1)
        kept, held_out = _clips(manifest_path, config)
        bank = bank_of(load_entry(manifest_path, entry).motion for entry in kept)
        noise = LandmarkNoise.read(noise_path)
        sampler = ExampleSampler(bank, read_body(body_path), noise, config.spoil)
        with progress_bar() as bar:
            task = bar.add_task("training the lifter", total=config.steps)
            lifter, joints_m = train(
                sampler, config, lambda step, _: bar.update(task, completed=step)
            )
        save_lifter(partial / LIFTER_FILE, lifter, config.network)
        LifterRecord(
            motions=len(kept),
            frames=int(bank.n_rows.sum()),
            held_out=tuple(entry.id for entry in held_out),
            steps=config.steps,
            joints_mm=1000 * joints_m,
        ).write(partial / RECORD_FILE)

    inputs = {"manifest": manifest_path, "body": body_path, "noise": noise_path}
    return run_stage("lifter", out_dir, config, inputs, work, run=run) / LIFTER_FILE


def _clips(path: Path, config: TrainingConfig) -> tuple[list[ClipEntry], list[ClipEntry]]:
    """A manifest's clips to train on, and those that are held out."""
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        raise BadManifest(f"{path}: only lists clips and has no files. Make them first")
    subjects = {f"{subject:02d}" for subject in config.held_out_subjects}
    kept: list[ClipEntry] = []
    held_out: list[ClipEntry] = []
    for entry in manifest.clips:
        trial = entry.source.sequence
        out = trial in config.held_out_trials or trial.split("_")[0] in subjects
        (held_out if out and entry.source.dataset == "CMU" else kept).append(entry)
    if not kept:
        raise MissingInput(f"{path}: no motion is left to train on. Give more motions")
    return kept, held_out


def loss_of(
    found: tuple[Tensor, Tensor], example: Example, config: TrainingConfig
) -> dict[str, Tensor]:
    """Joints' distances [m], rotations' squared differences and the legs' logarithms."""
    rotmats, leg_m = found
    found_m, found_turns = tree_joints(example.rest_joints_m, rotmats)
    true_m, true_turns = tree_joints(example.rest_joints_m, example.rotmats)
    joints = (found_m - true_m).norm(dim=-1).mean()
    rotation = (rotmats - example.rotmats).pow(2).sum((-1, -2)).mean()
    turned = (found_turns - true_turns).pow(2).sum((-1, -2)).mean()
    legs = (torch.log(leg_m) - torch.log(example.leg_m)).pow(2).mean()
    weighted = config.rotation_weight * (rotation + turned) / 8 + config.leg_weight * legs
    return {"loss": joints + weighted, "joints_m": joints, "rotation": rotation, "legs": legs}


def train(
    sampler: ExampleSampler,
    config: TrainingConfig,
    say: Callable[[int, dict[str, float]], None],
) -> tuple[Lifter, float]:
    """A lifter of averaged weights after all steps, and joints' mean distance at the end [m].

    `say` is told the step and means of late losses, every 20 steps.
    """
    torch.manual_seed(config.seed)
    rng = np.random.default_rng(config.seed)
    lifter, average = Lifter(config.network), Lifter(config.network)
    average.load_state_dict(lifter.state_dict())
    optimiser = torch.optim.AdamW(lifter.parameters(), lr=config.learning_rate, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, _rate_of(config))
    pool = _Pool(sampler, config, rng)
    seen: dict[str, float] = {}
    began_s = time.monotonic()
    for step in range(1, config.steps + 1):
        example = pool.next()
        losses = loss_of(lifter(example.features), example, config)
        optimiser.zero_grad()
        losses["loss"].backward()
        torch.nn.utils.clip_grad_norm_(lifter.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        _average(average, lifter, min(config.average_decay, step / (step + 10)))
        for key, value in losses.items():
            now = float(value.detach())
            seen[key] = 0.98 * seen.get(key, now) + 0.02 * now
        if step % 20 == 0:
            say(step, seen | {"seconds": time.monotonic() - began_s})
    return average.eval(), seen["joints_m"]


class _Pool:
    """Examples of some batches, of which the oldest is replaced every few steps."""

    def __init__(
        self, sampler: ExampleSampler, config: TrainingConfig, rng: np.random.Generator
    ) -> None:
        self._sampler, self._config, self._rng = sampler, config, rng
        batches = [sampler.sample(config.batch_size, rng) for _ in range(POOLED)]
        self._all = Example(*map(torch.cat, zip(*batches, strict=True)))
        self._step = 0

    def next(self) -> Example:
        """A batch of the pool's examples."""
        size = self._config.batch_size
        if self._step % self._config.reuse == self._config.reuse - 1:
            start = self._step // self._config.reuse % POOLED * size
            fresh = self._sampler.sample(size, self._rng)
            for old, new in zip(self._all, fresh, strict=True):
                old[start : start + size] = new
        self._step += 1
        rows = torch.as_tensor(self._rng.choice(POOLED * size, size=size, replace=False))
        return Example(*(values[rows] for values in self._all))


POOLED = 8  # batches


def _rate_of(config: TrainingConfig) -> Callable[[int], float]:
    def rate(step: int) -> float:
        warm = min(1.0, (step + 1) / config.warmup_steps)
        return float(warm * 0.5 * (1 + np.cos(np.pi * step / config.steps)) + 1e-3)

    return rate


@torch.no_grad()
def _average(average: Lifter, lifter: Lifter, decay: float) -> None:
    for mean, now in zip(average.parameters(), lifter.parameters(), strict=True):
        mean.lerp_(now, 1 - decay)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--recipe", type=Path, default=RECIPE_FILE)
    given = parser.parse_args()
    config = load_recipe(given.recipe, LifterRecipe).config()
    train_lifter(given.manifest, ANNY_FILE, given.out, config)
