"""Verbs that run a whole recipe: demo, its report, and run."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.options import with_workers
from gmrdata.stage.run import Run


def demo(
    out: Path = Path("out/demo"),
    motions: Path | None = None,
    trials: tuple[str, ...] = (),
    recipe: str = "demo",
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """Everything once: film, regenerate the world poses from the frames, train GMR, score, report.

    Args:
        out: Output folder. A run that was stopped goes on where it was.
        motions: Folder of BVH, ASF/AMC or AMASS files to film and to train on; the embedded gait
            when left out.
        trials: Names of the files to film, without suffix, one for each clip of the recipe; the
            first that fit when left out.
        recipe: A recipe file, or the name of one that travels with gmrdata.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: Say what would be done, and do nothing.
    """
    from gmrdata.cli.demo import plan, run_demo
    from gmrdata.cli.demo_recipe import DemoRecipe
    from gmrdata.stage.recipes import find_recipe, load_recipe

    loaded = load_recipe(find_recipe(recipe), DemoRecipe)
    loaded = with_workers(loaded, workers)
    if dry_run:
        print_table(("stage", "state"), plan(loaded, out))
        return
    run_demo(
        loaded, out, motions_dir=motions, trials=trials, run=Run(redo=redo, scheduler=scheduler)
    )


def report(demo_out: Positional[Path]) -> None:
    """Write the report of a finished demo again.

    Args:
        demo_out: Output folder of `gmrdata demo`.
    """
    from gmrdata.cli.demo_figures import show
    from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe
    from gmrdata.stage.recipes import load_recipe

    paths = DemoPaths(demo_out.resolve())
    show(paths, load_recipe(paths.recipe, DemoRecipe))


def run(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> None:
    """Run a recipe of any kind.

    Args:
        recipe: A recipe file, or the name of one that travels with gmrdata.
        out: Output folder.
        motions: Folder of motion files, for recipes that use some.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
    """
    from gmrdata.cli.recipes import run_recipe

    answer(run_recipe(recipe, out, motions_dir=motions, run=Run(redo=redo, scheduler=scheduler)))
