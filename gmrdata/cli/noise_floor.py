"""The verb that measures the pseudo ground truth itself: floor."""

from pathlib import Path

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.options import show_dry_run, with_workers
from gmrdata.errors import MissingInput


def floor(
    out: Path,
    sequences: int = 6,
    seed: int = 0,
    motions: Path | None = None,
    twins: Path | None = None,
    recipe: str = "threedpw",
    size: str = "small",
    frames: int = 150,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
    probe: bool = True,
) -> None:
    """How wrong the pseudo ground truth itself is: regenerate twins of 3DPW, and measure them.

    Args:
        out: Output folder: floor.json, twins/, regenerated/. A run that was stopped goes on where
            it was.
        sequences: Twins to draw; with 6 or more every class of camera motion is among them.
        seed: Chooses their motions, cameras, places, people and faults.
        motions: Folder of motion files to draw from.
        twins: Output folder of `gmrdata threedpw twin`, in place of drawn ones.
        recipe: A recipe file of kind `threedpw`, or the name of one that travels with gmrdata.
        size: Images of drawn twins: small (540x960), full (1080x1920), or like 180x320 [px].
        frames: Frames of each drawn twin, at 30 fps; at least 60.
        workers: Worker processes; the recipes' numbers when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the sequences.
        redo: Make anew what another recipe made.
        dry_run: List the twins and frames with an estimate of the rendering's time and disk, or
            what would be done with given twins, and make nothing.
        probe: For the estimate of a dry run, render two frames in a temporary folder.
    """
    from gmrdata.evaluate.floor_record import read_floor
    from gmrdata.floor.draw import draw_twins, film_of
    from gmrdata.floor.make import REGENERATED_FOLDER, TWINS_FOLDER, drawn_floor, floor_of_twins
    from gmrdata.floor.table import HEADINGS, floor_rows, notes
    from gmrdata.recipes import find_recipe, load_recipe
    from gmrdata.regenerate import regenerate_set as regeneration
    from gmrdata.regenerate.recipe import ThreedpwRecipe
    from gmrdata.threedpw.twin_set import SET_FOLDER
    from gmrdata.threedpw.twin_truth import read_truth

    loaded = load_recipe(find_recipe(recipe), ThreedpwRecipe)
    loaded = with_workers(loaded, workers)
    if twins is not None and dry_run:
        plan = regeneration.plan(loaded, read_truth(twins).root, out / REGENERATED_FOLDER)
        print_table(regeneration.HEADINGS, plan)
        return
    if twins is not None:
        made = floor_of_twins(twins, loaded, out, scheduler=scheduler, redo=redo)
    elif motions is not None:
        drawn = draw_twins(sequences, seed, motions, film_of(size, frames), workers)
        if dry_run:
            show_dry_run(drawn.set, out / TWINS_FOLDER / SET_FOLDER, motions, probe)
            return
        made = drawn_floor(drawn, motions, loaded, out, scheduler=scheduler, redo=redo)
    else:
        raise MissingInput("nothing to measure on. Name --motions to draw twins, or --twins")
    measured = read_floor(made.path)
    print_table(HEADINGS, floor_rows(measured))
    for line in notes(measured):
        answer(line)
    answer(made.path)
    if made.failed is not None:
        raise made.failed
