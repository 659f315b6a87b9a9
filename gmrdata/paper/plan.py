"""The paper's tables as recipes, and which trainings and scores a table takes, in which folders.

Recipes of kind `table` are the rows of one table and what is trained for each; those of kind
`joint` the non-sequential model.  Reading them needs no torch.

out/runs/<row>/seed_<n>          a training run (gmrdata.gmr.train)
out/predictions/<row>/seed_<n>   what a row that isn't GMR on true poses predicts
out/scores/<row>/seed_<n>        its scores (gmrdata.score)
"""

import re
import timeit
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

from pydantic import Field, ValidationError, model_validator

from gmrdata.gmr.config import (
    LossConfig,
    NetworkConfig,
    StepsConfig,
    TrainConfig,
    WindowConfig,
    check_batch,
)
from gmrdata.paper import VIBE, ScaleName
from gmrdata.score import Metric
from gmrdata.stage.recipes import find_recipe, load_recipe, recipe_path
from gmrdata.values import limits
from gmrdata.values.errors import BadRecipe
from gmrdata.values.records import Config

Method = Literal["gmr", "vibe_cam", "camera_as_world", "joint"]
Settings = dict[str, Any]  # settings of a training, nested as its config is


class JointConfig(StepsConfig):
    """A training run of the non-sequential model (Table 10).

    The paper says that it reformulates VIBE to put out both local pose and global motion, and no
    more: size, losses and settings are GMR's, with a term for the local pose.
    """

    recipe: Literal["joint"] = "joint"
    model: NetworkConfig = NetworkConfig()
    """The network; local rotations are always put out in 6D, as VIBE does."""
    loss: LossConfig = LossConfig()
    """Eq. 5 for the motion.  The vertex term poses the body by the true local pose."""
    local_pose: float = Field(default=1.0, ge=0.0)
    """Weight of the local pose's chordal loss (squared Frobenius norm, per joint)."""
    frames: int = Field(default=64, ge=2, le=limits.MOST_FRAMES)
    """Frames of a window; the paper's 64.  Shorter runs are padded."""
    fps_hz: float = Field(default=10.0, ge=0.1, le=1000.0)
    """Frame rate of the network's input [Hz]; clips must have a whole multiple of it, since
    features can't be resampled."""
    reverse_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of windows played backwards, as the paper's flip augmentation."""

    @model_validator(mode="after")
    def _batch_can_be_held(self) -> Self:
        check_batch(self.batch_size, self.frames)
        return self

    @property
    def windows(self) -> WindowConfig:
        return WindowConfig(
            frames=self.frames, fps_hz=self.fps_hz, reverse_probability=self.reverse_probability
        )


class Scale(Config):
    """What all rows of a table have in common at one size."""

    note: str = ""
    """What a reader must know of this size."""
    seeds: tuple[int, ...] = Field(default=(0,), min_length=1)
    """Of each row's trainings; the paper has one training per row."""
    held_out_subjects: tuple[int | str, ...] = ()
    """People who are scored and not trained on, where no manifest to score is given."""
    train: Settings = Field(default_factory=dict)
    """Settings of `TrainConfig`, nested as it is; the paper's where left out."""
    joint: Settings = Field(default_factory=dict)
    """Settings of `JointConfig`, for rows of that method."""

    @model_validator(mode="after")
    def _each_seed_once(self) -> Self:
        if len(set(self.seeds)) < len(self.seeds):
            raise ValueError("seeds: a seed counts twice, as if two trainings agreed; give it once")
        return self


class RowAtScale(Config):
    """What is particular to a row at one size."""

    name: str | None = None
    train: Settings = Field(default_factory=dict)
    """Settings that stand over the row's."""


class RecipeRow(Config):
    name: str
    """As the paper calls it."""
    method: Method = "gmr"
    """What predicts: a trained GMR; VIBE-CAM; true camera-frame poses taken as world poses; or the
    non-sequential model."""
    network: str | None = None
    """Name of the row whose trainings are used; its own where left out."""
    poses: Literal["true", "given"] = "true"
    """GMR's input: the scored clips' own local poses, or those of --poses."""
    scores: str | None = None
    """Name of the row whose scores are used, for other clips of them; its own where left out."""
    clips: Literal["all", "moving", "still"] = "all"
    """Which of the scored clips count: all, those whose camera moves, or those whose camera stands
    still, as their twins' does."""
    train: Settings = Field(default_factory=dict)
    """Settings that this row varies, of `TrainConfig` or, for method `joint`, `JointConfig`."""
    at: dict[ScaleName, RowAtScale] = Field(default_factory=dict)
    paper: dict[Metric, float] = Field(default_factory=dict)
    """The paper's figures [deg, mm]; none for a row that the paper doesn't have."""

    @property
    def trains(self) -> bool:
        """Whether a network is trained for it, by its own settings."""
        return self.method in ("gmr", "joint") and self.network is None and self.scores is None


class TableRecipe(Config):
    """One of the paper's tables."""

    recipe: Literal["table"]
    table: int = Field(ge=1)
    title: str
    paper_data: str
    """What the paper trained and scored on."""
    scales: dict[ScaleName, Scale]
    rows: tuple[RecipeRow, ...] = Field(min_length=1)
    """The rows in the paper's order."""

    @model_validator(mode="after")
    def _rows_fit(self) -> Self:
        names = [row.name for row in self.rows]
        often = Counter(map(folder_name, names))
        alike = [name for name in names if often[folder_name(name)] > 1 or not folder_name(name)]
        if alike:
            said = ", ".join(map(repr, alike))
            raise ValueError(f"rows: {said}: names must differ in letters a-z or digits")
        for row in self.rows:
            for other in {row.network, row.scores} - {None}:
                if other not in names:
                    raise ValueError(f"rows: {row.name}: there is no row {other!r}")
            own = [row.train, *(one.train for one in row.at.values())]
            if not row.trains and any(own):
                raise ValueError(f"rows: {row.name}: has `train`, and no training of its own")
            # A table says once who is trained on, and which scored clips are among them.
            if any("data" in settings for settings in own):
                what = "`train` has `data`, which all rows share. Give it in the scale's `train`"
                raise ValueError(f"rows: {row.name}: {what}")
            trained, scored = self.trained_row(row), self.scored_row(row)
            if trained is not row and not (trained.trains and trained.method == row.method):
                what = f"trains no network of method {row.method}"
                raise ValueError(f"rows: {row.name}: row {row.network!r} {what}")
            if scored is not row and scored.scores is not None:
                raise ValueError(f"rows: {row.name}: row {row.scores!r} has no scores of its own")
        return self

    def row(self, name: str) -> RecipeRow:
        return next(row for row in self.rows if row.name == name)

    def trained_row(self, row: RecipeRow) -> RecipeRow:
        """The row whose trainings are used for a row: itself, or that of `network`."""
        return row if row.network is None else self.row(row.network)

    def scored_row(self, row: RecipeRow) -> RecipeRow:
        """The row whose predictions are scored for a row: itself, or that of `scores`."""
        return row if row.scores is None else self.row(row.scores)


def load_table(name: str) -> TableRecipe:
    """A table's recipe by its number, or a YAML file; each setting of each row is tried."""
    if name in ("7", "8"):
        what = f"is a list of clips, not of trainings: the manifest paper_table{name}.yaml"
        raise BadRecipe(f"table {name}: {what}. Give 1 to 6, 9 or 10 (docs/tables.md)")
    path = recipe_path(f"paper/table{name}") if name.isdecimal() else find_recipe(name)
    recipe = load_recipe(path, TableRecipe)
    for row in recipe.rows:
        for scale, shared in recipe.scales.items():
            try:
                train_config(recipe, row, scale, shared.seeds[0], ())
                joint_config(recipe, row, scale, shared.seeds[0])
            except ValidationError as error:
                where = f"{path}: row {row.name!r} at scale {scale}:"
                problems = [f"  {'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()]
                raise BadRecipe("\n".join([where, *problems])) from None
    return recipe


def train_config(
    recipe: TableRecipe,
    row: RecipeRow,
    scale: ScaleName,
    seed: int,
    held_out: tuple[int | str, ...],
) -> TrainConfig:
    """The training of a row's network, which may be another row's; ValidationError if wrong."""
    owner = recipe.trained_row(row)
    own = {} if owner.method == "joint" else _settings_of(owner, scale)
    settings = merged(merged(recipe.scales[scale].train, own), {"seed": seed})
    if held_out:
        settings = merged(settings, {"data": {"held_out_subjects": held_out}})
    return TrainConfig.of_plain(settings)


def joint_config(recipe: TableRecipe, row: RecipeRow, scale: ScaleName, seed: int) -> JointConfig:
    """The training of the non-sequential model; errors as there."""
    owner = recipe.trained_row(row)
    own = _settings_of(owner, scale) if owner.method == "joint" else {}
    return JointConfig.of_plain(merged(recipe.scales[scale].joint, own) | {"seed": seed})


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> Settings:
    """Nested settings with others laid over them."""
    settings = {**base, **over}
    for key in base.keys() & over.keys():
        if isinstance(base[key], Mapping) and isinstance(over[key], Mapping):
            settings[key] = merged(base[key], over[key])
    return settings


def _settings_of(row: RecipeRow, scale: ScaleName) -> Settings:
    return merged(row.train, row.at.get(scale, RowAtScale()).train)


@dataclass(frozen=True)
class Given:
    """Files and people."""

    manifests: tuple[Path, ...]  # to train on
    scored: Path | None = None  # manifest to score; None for the held-out subjects of `manifests`
    poses: Path | None = None  # folder of another network's <clip id>.npz (the paper: VIBE's)
    keypoints: Path | None = None  # folder with <clip id>/ of 2D keypoints
    features: Path | None = None  # folder of <clip id>.npz: image features, to train and score on
    videos: tuple[Path, ...] = ()  # manifests to train the non-sequential model on
    held_out: tuple[int | str, ...] = ()  # people, in place of the recipe's
    body: Path | None = None  # body model of the clips; None for the default body
    network: Path | None = None  # a trained GMR's run or bundle, in place of the recipe's trainings
    estimator: str = VIBE  # whose poses and keypoints they are

    def subjects(self, scale: Scale) -> tuple[int | str, ...]:
        """Who is not trained on; nobody of the recipe's where a manifest to score is given."""
        return self.held_out or (() if self.scored else scale.held_out_subjects)


def lacking(recipe: TableRecipe, row: RecipeRow, scale: Scale, given: Given) -> list[str]:
    """What has to be given for a row and is not, in words."""
    # Another network's poses are of filmed clips, not of those that are held out of the training.
    has_own_clips = row.method == "gmr" and row.poses == "true" and bool(given.subjects(scale))
    wants_keypoints, is_joint = row.method == "vibe_cam", row.method == "joint"
    wants_poses = row.poses == "given" or wants_keypoints
    motions = "motions to train on (--manifest)"
    needs = (
        (motions if compared(recipe) else f"{motions} or a network (--network)",
         row.method == "gmr", given.manifests or given.network),
        ("clips to score (--scored)", not has_own_clips, given.scored),
        ("VIBE's poses as <clip id>.npz (--poses)", wants_poses, given.poses),
        ("2D keypoints of STAF or OpenPose as <clip id>/ (--keypoints)", wants_keypoints,
         given.keypoints),
        ("videos with true motions to train on (--videos)", is_joint, given.videos),
        ("image features as <clip id>.npz (--features)", is_joint, given.features),
    )  # fmt: skip
    return [what for what, is_needed, files in needs if is_needed and not files]


@dataclass(frozen=True)
class Scoring:
    row: RecipeRow  # where several rows use one score, the one whose predictions are scored
    id: str  # its folder below scores/
    training: str | None  # id of the one whose network is scored


@dataclass(frozen=True)
class Plan:
    """What a recipe makes at one size, of what is given."""

    recipe: TableRecipe
    scale: ScaleName
    given: Given
    trainings: dict[str, TrainConfig | JointConfig]  # by folder below runs/; rows may share one
    scorings: dict[str, list[Scoring]]  # by a row's name in the recipe, seed by seed
    lacking: dict[str, list[str]]  # by name of a row that can't be made: what must be given for it

    @property
    def subjects(self) -> tuple[int | str, ...]:
        return self.given.subjects(self.recipe.scales[self.scale])

    def shown_name(self, row: RecipeRow) -> str:
        """What a row is called here, with the estimator's name in VIBE's place."""
        name, given = row.at.get(self.scale, RowAtScale()).name or row.name, self.given
        if given.estimator == VIBE:
            return name
        if self.recipe.scored_row(row).poses == "given":
            return name.replace("Ours", f"Ours({given.estimator})")
        return name.replace(VIBE, given.estimator)

    def lacking_text(self) -> str:
        listed = "\n".join(f"  {name}: {'; '.join(what)}" for name, what in self.lacking.items())
        which = f"table {self.recipe.table}: {'not every' if self.scorings else 'no'} row"
        return f"{which} can be made of what is given. What is missing:\n{listed}"


def plan_table(
    recipe: TableRecipe, scale: ScaleName, given: Given, seeds: Sequence[int] = ()
) -> Plan:
    """List the trainings and scores of a table; `seeds` stand in place of the recipe's."""
    shared = recipe.scales.get(scale)
    if shared is None:
        raise BadRecipe(f"table {recipe.table} has no scale {scale}; give one of its own")
    if given.held_out and not given.manifests:
        said = "they are people of --manifest, and there is none"
        raise BadRecipe(f"--held-out-subjects: {said}. Leave them out, or give it")
    if given.network is not None and (varied := compared(recipe)):
        raise BadRecipe(
            f"table {recipe.table} compares trainings ({', '.join(varied)}), which no single"
            " network stands for. Leave out --network"
        )
    if len(set(seeds)) < len(seeds) or min(seeds, default=0) < 0:
        said = " ".join(map(str, seeds))
        raise BadRecipe(f"--seeds {said}: give each seed once, and none below 0")
    plan = Plan(recipe, scale, given, {}, {}, {})
    for shown in recipe.rows:
        row = recipe.scored_row(shown)
        if wanted := lacking(recipe, row, shared, given):
            plan.lacking[plan.shown_name(shown)] = wanted
            continue
        is_trained = row.method == "joint" or (row.method == "gmr" and given.network is None)
        if not is_trained:
            plan.scorings[shown.name] = [Scoring(row, folder_name(row.name), None)]
            continue
        plan.scorings[shown.name] = of_seeds = []
        for seed in seeds or shared.seeds:
            run = f"{folder_name(recipe.trained_row(row).name)}/seed_{seed}"
            config = (
                joint_config(recipe, row, scale, seed)
                if row.method == "joint"
                else train_config(recipe, row, scale, seed, given.subjects(shared))
            )
            plan.trainings.setdefault(run, config)
            of_seeds.append(Scoring(row, f"{folder_name(row.name)}/seed_{seed}", run))
    return plan


def compared(recipe: TableRecipe) -> list[str]:
    """Rows whose trainings a table compares: no single network stands for them."""
    return [row.name for row in recipe.rows if row.method == "gmr" and (row.train or row.at)]


def folder_name(name: str) -> str:
    """A row's name as a folder's: "V+O+S+T(4/2048)" is v_o_s_t_4_2048."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


PROBED_STEPS = 2
PROBED_S = 1.0


class TrainingCost(NamedTuple):
    """How large a network is, and how long it takes."""

    n_parameters: int
    step_s: float | None  # of a step on the CPU; None for another device
    basis: str  # what was timed


def probe_training(config: TrainConfig) -> TrainingCost:
    """Time a network's forward and backward pass.  Where that of whole windows is long, as many of
    their frames as take a second stand for all, which is rather too long: weights are loaded once
    for any number of frames."""
    import torch

    from gmrdata.gmr.model import Gmr, input_size

    model, whole = Gmr(config.model), config.windows.frames
    n_parameters = sum(values.numel() for values in model.parameters())
    if config.device != "cpu":
        return TrainingCost(n_parameters, None, "")

    def timed_s(frames: int) -> float:
        poses = torch.zeros(config.batch_size, frames, input_size(config.model))

        def step() -> None:
            delta_rotmats, delta_m = model(poses)
            (delta_rotmats.sum() + delta_m.sum()).backward()

        return min(timeit.repeat(step, number=1, repeat=PROBED_STEPS if frames == whole else 1))

    threads = torch.get_num_threads()
    torch.set_num_threads(config.threads)
    try:
        frames = min(2, whole)
        timed_s(frames)  # loads, perhaps for seconds, what all others find loaded
        while (step_s := timed_s(frames)) < PROBED_S and frames < whole:
            frames = min(2 * frames, whole)
    finally:
        torch.set_num_threads(threads)
    some = f"{config.batch_size} windows of {frames} of {whole} frames"
    basis = f"passes over {some}, timed here; loss and data come on top"
    return TrainingCost(n_parameters, step_s * whole / frames, basis)
