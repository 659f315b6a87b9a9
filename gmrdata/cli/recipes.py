"""Verbs that take a whole recipe: run, for a recipe of any kind; demo, and its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.baselines import baseline_joint_train
from gmrdata.cli.gmr import show_scores
from gmrdata.cli.motion_files import render
from gmrdata.cli.paper_tables import Seen, tables
from gmrdata.cli.pseudo_gt import threedpw_regenerate, threedpw_twin
from gmrdata.cli.video import masks
from gmrdata.stage.recipes import find_recipe, load_recipe, read_recipe, recipe_kind
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe, MissingInput


def demo(
    out: Path = Path("out/demo"),
    motions: flags.Motions = None,
    trials: tuple[str, ...] = (),
    recipe: flags.RecipeName = "demo",
    *,
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
) -> None:
    """Everything once: film, regenerate the world poses from the frames, train GMR, score, report.

    Without --motions the embedded gait is filmed and trained on.

    Args:
        out: Output folder. A run that was stopped goes on where it was.
        trials: Names of the files to film, without suffix, one for each clip of the recipe; the
            first that fit when left out. Where two files have one name, with their folders:
            rub001.0005_walk.
    """
    from gmrdata.cli.demo import plan, run_demo
    from gmrdata.cli.demo_recipe import DemoRecipe

    if run.shard is not None:
        raise BadRecipe("--shard: a demo has a handful of clips and is not shared; leave it out")
    if trials and motions is None:
        raise BadRecipe("--trials: names of files of --motions. Give that folder too")
    loaded = read_recipe(recipe, DemoRecipe)
    if dry_run:
        print_table(("stage", "state"), plan(loaded, out, motions, trials, run.redo))
    else:
        run_demo(loaded, out, motions_dir=motions, trials=trials, run=run)


def report(demo_out: Positional[Path]) -> None:
    """Write the report of a finished demo again.

    Args:
        demo_out: Output folder of `gmrdata demo`.
    """
    from gmrdata.cli.demo_figures import show
    from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe

    paths = DemoPaths(demo_out.resolve())
    show(paths, load_recipe(paths.recipe, DemoRecipe))


@dataclass(frozen=True)
class Inputs:
    """Inputs that a recipe of some kind needs."""

    motions: flags.Motions = None
    threedpw: Path | None = None
    """3DPW's folder, which holds imageFiles and sequenceFiles (threedpw)."""
    frames: Path | None = None
    """Folder of numbered images, or a video file (masks)."""
    camera_body: Path | None = None
    """Clip file (.npz) in the camera's frame, for masks from the silhouette (masks)."""
    manifest: UseAppendAction[tuple[Path, ...]] = ()
    """Manifest to train on; may be given several times (gmr, joint, table)."""
    scored: Path | None = None
    """Manifest to score (table)."""
    poses: Annotated[Path | None, flags.POSES] = None
    keypoints: Annotated[Path | None, flags.KEYPOINTS] = None
    features: Annotated[Path | None, flags.FEATURES] = None
    videos: UseAppendAction[tuple[Path, ...]] = ()
    """Manifest that the non-sequential model is trained on; may be repeated (table)."""
    body: flags.Body = "anny"


NO_INPUTS = Inputs()
TAKES = {
    "demo": ("motions",),
    "synthetic": ("motions",),
    "threedpw_twin": ("motions",),
    "threedpw": ("threedpw",),
    "masks": ("frames", "camera_body", "body"),
    "gmr": ("manifest", "body"),
    "joint": ("manifest", "features", "body"),
    "table": ("manifest", "scored", "poses", "keypoints", "features", "videos", "body"),
}
"""Inputs by kind of recipe."""
NEEDS = {"threedpw": ("threedpw",), "masks": ("frames",), "joint": ("manifest", "features")}
"""Those that no recipe of a kind does without."""
UNSHARED = ("masks", "gmr", "joint")
"""Kinds without a dry run, and without workers and shards."""


def run(
    recipe: Positional[str],
    out: Path,
    inputs: Annotated[Inputs, OmitArgPrefixes] = NO_INPUTS,
    *,
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
) -> None:
    """Run a recipe of any kind: demo, synthetic, threedpw, threedpw_twin, masks, gmr, joint,
    table.

    It does what the verb of that kind does with its defaults, whose dry run is here without a
    probe.  A recipe that lacks an input names the flag.

    Args:
        recipe: A recipe file, or the name of one that travels with gmrdata.
        out: Output folder.
    """
    path = find_recipe(recipe)
    kind = recipe_kind(path)
    if kind not in TAKES:
        raise BadRecipe(f"{path}: unknown kind {kind!r}; there are {', '.join(TAKES)}")
    for name, value in vars(inputs).items():  # one that isn't read is a mistake, not a default
        if name not in TAKES[kind] and value != getattr(NO_INPUTS, name):
            raise BadRecipe(
                f"{path}: {_flag(name)} is not for a recipe of kind {kind}. Leave it out"
            )
    if dry_run and kind in UNSHARED:
        raise BadRecipe(f"{path}: there is no dry run of a recipe of kind {kind}")
    if kind in UNSHARED and (run.shard or run.workers or run.scheduler):
        what = f"a recipe of kind {kind} is not shared"
        raise BadRecipe(f"{path}: {what}. Leave --workers, --scheduler and --shard out")
    if lacking := [name for name in NEEDS.get(kind, ()) if not getattr(inputs, name)]:
        raise MissingInput(f"{path}: this recipe needs {_flag(lacking[0])}")
    _run_kind(path, kind, out, inputs, run, dry_run)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _run_kind(path: Path, kind: str, out: Path, inputs: Inputs, run: Run, dry_run: bool) -> None:
    recipe, given = str(path), {name: getattr(inputs, name) for name in TAKES[kind]}
    match kind:
        case "demo":
            demo(out, recipe=recipe, run=run, dry_run=dry_run, **given)
        case "synthetic":
            render(recipe, out, run=run, dry_run=dry_run, probe=False, **given)
        case "threedpw_twin":
            threedpw_twin(recipe, out, run=run, dry_run=dry_run, probe=False, **given)
        case "threedpw":
            threedpw_regenerate(given["threedpw"], out, recipe, run=run, dry_run=dry_run)
        case "table":
            kinds = ("poses", "keypoints", "features", "videos")
            seen = Seen(**{name: given.pop(name) for name in kinds})
            tables(recipe, out, seen=seen, run=run, dry_run=dry_run, **given)
        case "masks":
            masks(
                out=out,
                masks=(recipe,),
                redo=run.redo,
                part=None,
                networks=flags.NetworkOptions(),
                **given,
            )
        case "joint":
            manifests = given.pop("manifest")
            baseline_joint_train(manifests, out=out, recipe=path, redo=run.redo, **given)
        case _:
            _train_and_score(path, out, inputs, run)


def _train_and_score(path: Path, out: Path, inputs: Inputs, run: Run) -> None:
    """Train to OUT/run, and score on the recipe's manifests to OUT/scores."""
    from gmrdata.gmr.train import GmrRecipe, train
    from gmrdata.score.score import score

    recipe = load_recipe(path, GmrRecipe)
    if recipe.training and inputs.manifest:
        raise BadRecipe(f"{path}: names its `training` manifests itself. Leave --manifest out")
    if recipe.body and inputs.body != NO_INPUTS.body:
        raise BadRecipe(f"{path}: names its `body` itself. Leave --body out")
    folder = path.parent
    scored = _folders_of_scores([folder / manifest for manifest in recipe.scored])
    training = [folder / one for one in recipe.training] or list(inputs.manifest)
    if not training:
        raise MissingInput(f"{path}: this recipe needs --manifest")
    body = flags.body_path(str(recipe.body or inputs.body))
    if recipe.body and body:
        body = folder / body.expanduser()
    run_dir = train(training, out / "run", recipe.train, body_path=body, run=run)
    for name, manifest in scored.items():
        made = score(run_dir, manifest, out / "scores" / name, body_path=body, run=run)
        show_scores(*made.scores)
    answer(run_dir)


def _folders_of_scores(manifests: Sequence[Path]) -> dict[str, Path]:
    """Each manifest by the folder of its scores: libraries' are all called motions.yaml.

    Asked before the training, which takes long.
    """
    by_folder: dict[str, Path] = {}
    stems = [path.stem for path in manifests]
    for path in manifests:
        if not path.is_file():
            raise MissingInput(f"{path}: no such manifest, which the recipe names in `scored`")
        alone = stems.count(path.stem) == 1
        name = path.stem if alone else f"{path.resolve().parent.name}_{path.stem}"
        if name in by_folder:
            raise BadRecipe(
                f"`scored` names {by_folder[name]} and {path}: their scores are both {name}"
            )
        by_folder[name] = path
    return by_folder
