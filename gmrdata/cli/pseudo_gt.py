"""The verb for 3DPW: its pseudo ground truth, a look into it, a twin of it.

The verb that measures the pseudo ground truth itself: floor.
"""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import OmitSubcommandPrefixes, Positional, subcommand

from gmrdata.cli.answers import answer, print_table, then
from gmrdata.cli.options import show_dry_run, with_workers
from gmrdata.stage.run import Run
from gmrdata.values.errors import MissingInput


def threedpw_regenerate(
    root: Path,
    out: Path,
    recipe: str = "threedpw",
    sequences: tuple[str, ...] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """World-frame pseudo ground truth of a 3DPW folder, a verdict for each sequence, a manifest.

    Args:
        root: The folder that holds imageFiles and sequenceFiles.
        out: Output folder: pseudo_gt.yaml, verdicts.json, sequences/. A run that was stopped goes
            on where it was.
        recipe: A recipe file of kind `threedpw`, or the name of one that travels with gmrdata.
        sequences: Names of sequences; all when left out.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the sequences.
        redo: Make anew what another recipe made.
        dry_run: Say what would be done, and do nothing.
    """
    from gmrdata.pages.qa import write_set_pages
    from gmrdata.stage.recipes import find_recipe, load_recipe
    from gmrdata.threedpw import regenerate as stage
    from gmrdata.threedpw.recipe import ThreedpwRecipe
    from gmrdata.threedpw.regenerate import VERDICT_HEADINGS, table_row
    from gmrdata.values.files import read_json

    loaded = load_recipe(find_recipe(recipe), ThreedpwRecipe)
    loaded = with_workers(loaded, workers)
    if sequences:
        loaded = loaded.model_copy(update={"sequences": sequences})
    if dry_run:
        print_table(stage.HEADINGS, stage.plan(loaded, root, out))
        return
    with then(lambda: write_set_pages(loaded, root, out)):
        made = stage.regenerate_set(loaded, root, out, run=Run(redo=redo, scheduler=scheduler))
    rows = read_json(made.with_name("verdicts.json"))
    print_table(VERDICT_HEADINGS, [table_row(row) for row in rows])
    answer(made.with_name("index.html"))
    answer(made)


def threedpw_list(root: Path, rule: str = "campose_valid") -> None:
    """List the sequences of a 3DPW folder: people, frames, image size, usable share, problems.

    A sequence that can't be read is listed with the reason; then the exit code is 1.

    Args:
        root: The folder that holds imageFiles and sequenceFiles.
        rule: Which frames count as valid: campose_valid, 3dpw_eval, glamr, vibe or slahmr.
    """
    from gmrdata.threedpw.listing import HEADINGS, bad_summary, sequence_rows

    rows, n_bad = sequence_rows(root, rule)
    print_table(HEADINGS, rows)
    if n_bad:
        raise bad_summary(root, n_bad, len(rows))


def threedpw_show(sequence: Positional[str], root: Path, rule: str = "campose_valid") -> None:
    """Show one sequence of 3DPW: its people, and which frames of each can't be used and why.

    Args:
        sequence: Name of the sequence, like courtyard_arguing_00.
        root: The folder that holds imageFiles and sequenceFiles.
        rule: Which frames count as valid: campose_valid, 3dpw_eval, glamr, vibe or slahmr.
    """
    from gmrdata.threedpw.listing import RANGE_HEADINGS, range_rows

    rows, problems = range_rows(root, sequence, rule)
    print_table(RANGE_HEADINGS, rows)
    for problem in problems:
        answer(problem)


def threedpw_compare(manifest: Positional[Path], out: Path | None = None) -> None:
    """Lay a pseudo ground truth of 3DPW beside Table 7 of the GMR paper, row by row.

    Args:
        manifest: A manifest of kind pseudo_gt, or the folder that holds one.
        out: CSV file for the rows, besides the table.
    """
    from gmrdata.threedpw.table7 import (
        HEADINGS,
        compare_with_table7,
        summary,
        table_rows,
        write_csv,
    )

    rows = compare_with_table7(manifest)
    print_table(HEADINGS, table_rows(rows))
    answer(summary(rows))
    if out is not None:
        answer(write_csv(out, rows))


def threedpw_twin(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
    probe: bool = True,
) -> None:
    """Render sequences with 3DPW's layout and faults, and keep the truth aside.

    Args:
        recipe: A recipe file of kind `threedpw_twin`, or the name of one that travels with gmrdata.
        out: Output folder: 3DPW/ (the dataset), truth/ (exact clips, twins.json), render_set/. A
            run that was stopped goes on at the next missing frame.
        motions: Folder of motion files that the recipe's clips name.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: List clips and frames with an estimate of time and disk, and make nothing.
        probe: For the estimate of a dry run, render two frames in a temporary folder.
    """
    from gmrdata.pages.synthetic import write_set_pages
    from gmrdata.stage.recipes import find_recipe, load_recipe
    from gmrdata.twins.recipe import TwinRecipe
    from gmrdata.twins.twin_set import SET_FOLDER, make_twins

    loaded = load_recipe(find_recipe(recipe), TwinRecipe)
    if workers is not None:
        loaded = loaded.model_copy(update={"set": with_workers(loaded.set, workers)})
    if dry_run:
        show_dry_run(loaded.set, out / SET_FOLDER, motions, probe)
        return
    with then(lambda: write_set_pages(loaded.set, out / SET_FOLDER)):
        made = make_twins(loaded, out, motions_dir=motions, run=Run(redo=redo, scheduler=scheduler))
    answer(made)


def threedpw(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("regenerate", constructor=threedpw_regenerate)]
        | Annotated[Any, subcommand("list", constructor=threedpw_list)]
        | Annotated[Any, subcommand("show", constructor=threedpw_show)]
        | Annotated[Any, subcommand("compare", constructor=threedpw_compare)]
        | Annotated[Any, subcommand("twin", constructor=threedpw_twin)]
    ],
) -> None:
    """World-frame pseudo ground truth of a 3DPW folder, a look into it, or a twin of it.

    `gmrdata threedpw --root 3DPW --out OUT` is short for `gmrdata threedpw regenerate ...`.
    """


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
    from gmrdata.pages import qa
    from gmrdata.pages.synthetic import write_set_pages
    from gmrdata.stage.recipes import find_recipe, load_recipe
    from gmrdata.threedpw import regenerate as regeneration
    from gmrdata.threedpw.recipe import ThreedpwRecipe
    from gmrdata.twins.floor import REGENERATED_FOLDER, TWINS_FOLDER, drawn_floor, floor_of_twins
    from gmrdata.twins.floor_record import HEADINGS, floor_rows, notes, read_floor
    from gmrdata.twins.sampling import draw_twins, film_of
    from gmrdata.twins.twin_set import SET_FOLDER, read_truth

    loaded = load_recipe(find_recipe(recipe), ThreedpwRecipe)
    loaded = with_workers(loaded, workers)

    def regenerated_pages(twins_dir: Path) -> None:
        qa.write_set_pages(loaded, read_truth(twins_dir).root, out / REGENERATED_FOLDER)

    if twins is not None and dry_run:
        plan = regeneration.plan(loaded, read_truth(twins).root, out / REGENERATED_FOLDER)
        print_table(regeneration.HEADINGS, plan)
        return
    if twins is not None:
        with then(lambda: regenerated_pages(twins)):
            made = floor_of_twins(twins, loaded, out, run=Run(redo=redo, scheduler=scheduler))
    elif motions is not None:
        drawn = draw_twins(sequences, seed, motions, film_of(size, frames), workers)
        if dry_run:
            show_dry_run(drawn.set, out / TWINS_FOLDER / SET_FOLDER, motions, probe)
            return
        twins_dir = out / TWINS_FOLDER
        with (
            then(lambda: regenerated_pages(twins_dir)),
            then(lambda: write_set_pages(drawn.set, twins_dir / SET_FOLDER)),
        ):
            made = drawn_floor(drawn, motions, loaded, out, run=Run(redo=redo, scheduler=scheduler))
    else:
        raise MissingInput("nothing to measure on. Name --motions to draw twins, or --twins")
    measured = read_floor(made.path)
    print_table(HEADINGS, floor_rows(measured))
    for line in notes(measured):
        answer(line)
    answer(made.path)
    if made.failed is not None:
        raise made.failed
