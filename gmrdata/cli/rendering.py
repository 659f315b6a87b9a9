"""The verb that films motions: render."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, then
from gmrdata.cli.options import show_dry_run, with_workers
from gmrdata.stage.run import Run


def render(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
    probe: bool = True,
    preview: bool = False,
) -> None:
    """Render synthetic clips with exact cameras and masks, and write their manifest.

    Args:
        recipe: A recipe file of kind `synthetic`, or the name of one that travels with gmrdata.
        out: Output folder; a run that was stopped goes on at the next missing frame.
        motions: Folder of motion files that the recipe's clips name; the embedded gait needs none.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: List clips and frames with an estimate of time and disk, and make nothing.
        probe: For the estimate of a dry run, render two frames in a temporary folder.
        preview: Only draw a few small frames and the paths of each clip, to OUT/preview/index.html.
    """
    from gmrdata.film.set_plan import SyntheticRecipe
    from gmrdata.stage.recipes import find_recipe, load_recipe

    loaded = load_recipe(find_recipe(recipe), SyntheticRecipe)
    loaded = with_workers(loaded, workers)
    if dry_run:
        show_dry_run(loaded, out, motions, probe)
        return
    if preview:
        from gmrdata.pages.preview import preview_set

        answer(preview_set(loaded, out, motions_dir=motions, run=Run(scheduler=scheduler)))
        return
    from gmrdata.film.render_set import render_set
    from gmrdata.pages.synthetic import write_set_pages

    with then(lambda: write_set_pages(loaded, out)):
        made = render_set(loaded, out, motions_dir=motions, run=Run(redo=redo, scheduler=scheduler))
    answer(made)
