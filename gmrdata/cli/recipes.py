"""Run a recipe of any kind."""

from pathlib import Path

from gmrdata.cli.answers import then
from gmrdata.stage.recipes import find_recipe, load_recipe, recipe_kind
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadRecipe

KINDS = "demo, synthetic, threedpw_twin and gmr"


def run_recipe(
    name: str,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Do what a recipe says; what is done already is kept.

    Args:
        name: A recipe file, or the name of one that travels with gmrdata.
        out_dir: The output folder.
        motions_dir: Folder of motion files, for recipes that use some.

    Returns:
        The report of a demo, the manifest of a synthetic set, the root of a twin dataset, or the
        run folder of a network.

    Raises:
        BadRecipe: the recipe is of a kind that gmrdata doesn't know.
    """
    path = find_recipe(name)
    match recipe_kind(path):
        case "demo":
            from gmrdata.cli.demo import run_demo
            from gmrdata.cli.demo_recipe import DemoRecipe

            demo = load_recipe(path, DemoRecipe)
            return run_demo(demo, out_dir, motions_dir=motions_dir, run=run)
        case "synthetic":
            from gmrdata.film.render_set import render_set
            from gmrdata.film.set_plan import SyntheticRecipe
            from gmrdata.pages.synthetic import write_set_pages

            synthetic = load_recipe(path, SyntheticRecipe)
            with then(lambda: write_set_pages(synthetic, out_dir)):
                return render_set(synthetic, out_dir, motions_dir=motions_dir, run=run)
        case "threedpw_twin":
            from gmrdata.pages.synthetic import write_set_pages
            from gmrdata.twins.recipe import TwinRecipe
            from gmrdata.twins.twin_set import SET_FOLDER, make_twins

            twin = load_recipe(path, TwinRecipe)
            with then(lambda: write_set_pages(twin.set, out_dir / SET_FOLDER)):
                return make_twins(twin, out_dir, motions_dir=motions_dir, run=run)
        case "gmr":
            return _train_and_score(path, out_dir, run)
        case "masks":
            raise BadRecipe(
                f"{path}: a recipe of masks needs frames: gmrdata masks FRAMES --sources {name}"
            )
        case "threedpw":
            raise BadRecipe(
                f"{path}: a recipe of 3DPW needs its folder: "
                f"gmrdata threedpw --root 3DPW --out OUT --recipe {name}"
            )
        case "table":
            raise BadRecipe(
                f"{path}: a table needs motions: gmrdata tables {name} --manifest M --out OUT"
            )
        case kind:
            raise BadRecipe(f"{path}: unknown kind {kind!r}; there are {KINDS}")


def _train_and_score(path: Path, out_dir: Path, run: Run) -> Path:
    from gmrdata.gmr.train import GmrRecipe, train
    from gmrdata.pages.scores import write_scores_page
    from gmrdata.score.score import score_manifest

    recipe = load_recipe(path, GmrRecipe)
    if not recipe.training:
        raise BadRecipe(
            f"{path}: names no `training` manifests. Name some, or use `gmrdata train` with them"
        )
    folder = path.parent
    body_path = None if recipe.body is None else folder / recipe.body
    run_dir = train(
        recipe.training_paths(folder),
        out_dir / "run",
        recipe.train_config(),
        body_path=body_path,
        run=run,
    )
    for manifest in recipe.scored:
        scores_dir = out_dir / "scores" / manifest.stem
        write_scores_page(
            score_manifest(run_dir, folder / manifest, body_path, scores_dir, run=run)
        )
    return run_dir
