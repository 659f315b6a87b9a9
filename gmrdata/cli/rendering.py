"""The verb that films motions: render."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, then
from gmrdata.cli.options import (
    DryRun,
    Motions,
    Probe,
    RecipeName,
    RunFlags,
    read_recipe,
    show_dry_run,
)


def render(
    recipe: Positional[RecipeName],
    out: Path,
    motions: Motions = None,
    *,
    run: RunFlags,
    dry_run: DryRun = False,
    probe: Probe = True,
    preview: bool = False,
) -> None:
    """Render synthetic clips with exact cameras and masks, and write their manifest.

    Args:
        out: Output folder; a run that was stopped goes on at the next missing frame.
        preview: Only draw a few small frames and the paths of each clip, to OUT/preview/index.html.
    """
    from gmrdata.film.render_set import render_set
    from gmrdata.film.set_plan import SyntheticRecipe
    from gmrdata.pages.sets import preview_set, write_set_pages

    loaded = read_recipe(recipe, SyntheticRecipe)
    if dry_run:
        show_dry_run(loaded, out, motions, run.workers, probe)
    elif preview:
        answer(preview_set(loaded, out, motions_dir=motions, run=run))
    else:
        with then(lambda: write_set_pages(loaded, out)):
            made = render_set(loaded, out, motions_dir=motions, run=run)
        answer(made)
