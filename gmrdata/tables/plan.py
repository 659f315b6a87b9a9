"""Which trainings and scores a table takes, and in which folders they lie.

out/runs/<row>/seed_<n>          a training run (gmrdata.gmr.train)
out/predictions/<row>/seed_<n>   what a row that isn't GMR on true poses predicts
out/scores/<row>/seed_<n>        its scores (gmrdata.evaluate)
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.errors import BadRecipe
from gmrdata.gmr.config import TrainConfig
from gmrdata.tables.given import Given, lacking
from gmrdata.tables.recipe import Row, TableRecipe, joint_config, train_config
from gmrdata.tables.scales import ScaleName


@dataclass(frozen=True)
class Training:
    """One network to train."""

    id: str
    """Its folder below runs/."""
    config: TrainConfig | JointConfig
    """Its recipe."""


@dataclass(frozen=True)
class Scoring:
    """One score of a row."""

    row: Row
    """The row; or, where several rows use one score, the one whose predictions are scored."""
    id: str
    """Its folder below scores/."""
    training: str | None
    """Id of the training whose network is scored."""


@dataclass(frozen=True)
class Plan:
    """What a table takes."""

    trainings: tuple[Training, ...]
    """Each network once, though several rows may use it."""
    scorings: dict[str, tuple[Scoring, ...]]
    """By name of a row in the recipe: its scores, seed by seed."""
    lacking: dict[str, list[str]]
    """By name of a row that can't be made: what would have to be given."""


def plan_table(
    recipe: TableRecipe, scale: ScaleName, given: Given, seeds: Sequence[int] = ()
) -> Plan:
    """List the trainings and scores of a table.

    Args:
        recipe: The table.
        scale: The size.
        given: What it is made from.
        seeds: In place of the recipe's.

    Raises:
        BadRecipe: the table has no such scale.
    """
    shared = recipe.scales.get(scale)
    if shared is None:
        raise BadRecipe(f"table {recipe.table} has no scale {scale}; give one of its own")
    trainings: dict[str, Training] = {}
    scorings: dict[str, tuple[Scoring, ...]] = {}
    missing: dict[str, list[str]] = {}
    for shown in recipe.rows:
        row = recipe.scored_row(shown)
        wanted = lacking(recipe, row, shared, given)
        if wanted:
            missing[shown.name_at(scale)] = wanted
            continue
        if row.method in ("vibe_cam", "camera_as_world"):
            scorings[shown.name] = (Scoring(row, folder_name(row.name), None),)
            continue
        of_seeds = []
        for seed in seeds or shared.seeds:
            run = f"{folder_name(row.network or row.name)}/seed_{seed}"
            config: TrainConfig | JointConfig
            if row.method == "joint":
                config = joint_config(recipe, row, scale, seed)
            else:
                config = train_config(recipe, row, scale, seed, given.subjects(shared))
            trainings.setdefault(run, Training(run, config))
            of_seeds.append(Scoring(row, f"{folder_name(row.name)}/seed_{seed}", run))
        scorings[shown.name] = tuple(of_seeds)
    return Plan(tuple(trainings.values()), scorings, missing)


def folder_name(name: str) -> str:
    """A row's name as a folder's: "V+O+S+T(4/2048)" is v_o_s_t_4_2048."""
    # "w/" and "w/o" differ in more than signs, so no two rows of a table fall together by this.
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def scored_manifest(given: Given, out_dir: Path) -> Path:
    """The clips to score: those given, or the held-out ones."""
    return given.scored or out_dir / "held_out" / "manifest.yaml"
