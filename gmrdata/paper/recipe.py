"""Recipes of kind `table`, the rows of one of the paper's tables and what is trained for each; and
of kind `joint`, the non-sequential model.  Need no torch."""

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from gmrdata.gmr.config import (
    LossConfig,
    NetworkConfig,
    StepsConfig,
    TrainConfig,
    WindowConfig,
    check_batch,
)
from gmrdata.paper import ScaleName
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


class RowAtScale(Config):
    """What is particular to a row at one size."""

    name: str | None = None
    train: Settings = Field(default_factory=dict)
    """Settings that stand over the row's."""


class Row(Config):
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

    def name_at(self, scale: ScaleName) -> str:
        return self.at.get(scale, RowAtScale()).name or self.name


class TableRecipe(Config):
    """One of the paper's tables."""

    recipe: Literal["table"]
    table: int = Field(ge=1)
    title: str
    paper_data: str
    """What the paper trained and scored on."""
    scales: dict[ScaleName, Scale]
    rows: tuple[Row, ...] = Field(min_length=1)
    """The rows in the paper's order."""

    @model_validator(mode="after")
    def _rows_fit(self) -> Self:
        names = [row.name for row in self.rows]
        if len(set(names)) < len(names):
            raise ValueError("rows: names must be unique")
        for row in self.rows:
            for other in {row.network, row.scores} - {None}:
                if other not in names:
                    raise ValueError(f"rows: {row.name}: there is no row {other!r}")
        return self

    def row(self, name: str) -> Row:
        return next(row for row in self.rows if row.name == name)

    def scored_row(self, row: Row) -> Row:
        """The row whose predictions are scored for a row: itself, or that of `scores`."""
        return row if row.scores is None else self.row(row.scores)


def load_table(name: str) -> TableRecipe:
    """A table's recipe by its number, or a YAML file; each setting of each row is tried."""
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
    recipe: TableRecipe, row: Row, scale: ScaleName, seed: int, held_out: tuple[int | str, ...]
) -> TrainConfig:
    """The training of a row's network, which may be another row's; ValidationError if wrong."""
    owner = row if row.network is None else recipe.row(row.network)
    own = {} if owner.method == "joint" else _settings_of(owner, scale)
    settings = merged(merged(recipe.scales[scale].train, own), {"seed": seed})
    if held_out:
        settings = merged(settings, {"data": {"held_out_subjects": held_out}})
    return TrainConfig.of_plain(settings)


def joint_config(recipe: TableRecipe, row: Row, scale: ScaleName, seed: int) -> JointConfig:
    """The training of the non-sequential model; errors as there."""
    own = _settings_of(row, scale) if row.method == "joint" else {}
    return JointConfig.of_plain(merged(recipe.scales[scale].joint, own) | {"seed": seed})


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> Settings:
    """Nested settings with others laid over them."""
    found = {**base, **over}
    for key in base.keys() & over.keys():
        if isinstance(base[key], Mapping) and isinstance(over[key], Mapping):
            found[key] = merged(base[key], over[key])
    return found


def _settings_of(row: Row, scale: ScaleName) -> Settings:
    return merged(row.train, row.at.get(scale, RowAtScale()).train)
