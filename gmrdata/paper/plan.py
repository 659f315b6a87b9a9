"""Which trainings and scores a table takes of what is given, in which folders, and how long.

out/runs/<row>/seed_<n>          a training run (gmrdata.gmr.train)
out/predictions/<row>/seed_<n>   what a row that isn't GMR on true poses predicts
out/scores/<row>/seed_<n>        its scores (gmrdata.score)
"""

import re
import timeit
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gmrdata.gmr.config import TrainConfig
from gmrdata.paper import VIBE, ScaleName
from gmrdata.paper.recipe import JointConfig, Row, Scale, TableRecipe, joint_config, train_config
from gmrdata.values.errors import BadRecipe


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
        """Who is not trained on; nobody is held out where a manifest to score is given."""
        return self.held_out or (() if self.scored else scale.held_out_subjects)


def lacking(recipe: TableRecipe, row: Row, scale: Scale, given: Given) -> list[str]:
    """What has to be given for a row and is not, in words."""
    owner = row if row.network is None else recipe.row(row.network)
    # Another network's poses are of filmed clips, not of those that are held out of the training.
    has_own_clips = row.method == "gmr" and row.poses == "true" and bool(given.subjects(scale))
    wants_keypoints, is_joint = row.method == "vibe_cam", row.method == "joint"
    wants_poses = row.poses == "given" or wants_keypoints
    needs = (
        ("motions to train on (--manifest) or a network (--network)",
         owner.method == row.method == "gmr", given.manifests or given.network),
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
    row: Row  # where several rows use one score, the one whose predictions are scored
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

    def shown_name(self, row: Row) -> str:
        """What a row is called here, with the estimator's name in VIBE's place."""
        name, given = row.name_at(self.scale), self.given
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
    if given.network is not None:
        _require_one_network(recipe)
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
            run = f"{folder_name(row.network or row.name)}/seed_{seed}"
            config = (
                joint_config(recipe, row, scale, seed)
                if row.method == "joint"
                else train_config(recipe, row, scale, seed, given.subjects(shared))
            )
            plan.trainings.setdefault(run, config)
            of_seeds.append(Scoring(row, f"{folder_name(row.name)}/seed_{seed}", run))
    return plan


def _require_one_network(recipe: TableRecipe) -> None:
    varied = [row.name for row in recipe.rows if row.method == "gmr" and (row.train or row.at)]
    if varied:
        raise BadRecipe(
            f"table {recipe.table} compares trainings ({', '.join(varied)}), which no single"
            " network stands for. Leave out --network"
        )


def folder_name(name: str) -> str:
    """A row's name as a folder's: "V+O+S+T(4/2048)" is v_o_s_t_4_2048."""
    # "w/" and "w/o" differ in more than signs, so no two rows of a table fall together by this.
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


HEADINGS = ("training", "parameters", "steps", "state", "minutes")
PROBED_STEPS = 2


def planned_runs(
    plan: Plan, out_dir: Path, workers: int
) -> tuple[list[tuple[str, ...]], list[str]]:
    """The trainings of a table as rows under `HEADINGS`, and lines on the sum of what is left.  The
    estimate is of the network's forward and backward pass here; loss and data come on top."""
    probed: dict[str, tuple[int, float | None]] = {}
    rows: list[tuple[str, ...]] = []
    left_minutes: list[float | None] = []
    for run, config in plan.trainings.items():
        parameters, step_s = "-", None
        if isinstance(config, TrainConfig):
            key = f"{config.model!r} {config.batch_size} {config.windows.frames} {config.device}"
            if key not in probed:
                probed[key] = _probe(config)
            parameters, step_s = f"{probed[key][0]:,}", probed[key][1]
        minutes = None if step_s is None else config.steps * step_s / 60
        run_dir = out_dir / "runs" / run
        is_begun = run_dir.with_name(run_dir.name + ".partial").is_dir()
        state = "made" if run_dir.is_dir() else "begun" if is_begun else "to make"
        if state != "made":
            left_minutes.append(minutes)
        shown = "?" if minutes is None else f"{minutes:.1f}"
        rows.append((run, parameters, str(config.steps), state, shown))
    n_left, known = len(left_minutes), [one for one in left_minutes if one is not None]
    total = f"at least {sum(known) / max(1, min(workers, n_left)):.0f} minutes"
    if len(known) < n_left:
        total = "no estimate for those with ?: their device is not here, or their input is unknown"
    return rows, [
        f"{n_left} of {len(plan.trainings)} trainings to make with {workers} workers: {total}",
        f"{sum(map(len, plan.scorings.values()))} scores",
    ]


def _probe(config: TrainConfig) -> tuple[int, float | None]:
    """Number of parameters, and seconds of a step on one CPU thread; None for another device."""
    import torch

    from gmrdata.gmr.model import Gmr, input_size

    model = Gmr(config.model)
    n_parameters = sum(values.numel() for values in model.parameters())
    if config.device != "cpu":
        return n_parameters, None
    poses = torch.zeros(config.batch_size, config.windows.frames, input_size(config.model))

    def step() -> None:
        delta_rotmats, delta_m = model(poses)
        (delta_rotmats.sum() + delta_m.sum()).backward()

    threads = torch.get_num_threads()
    torch.set_num_threads(config.threads)
    try:
        # The first step loads what the others find loaded, so it is not counted.
        times_s = timeit.repeat(step, number=1, repeat=1 + PROBED_STEPS)
        return n_parameters, min(times_s[1:])
    finally:
        torch.set_num_threads(threads)
