"""Verbs for 3DPW: its pseudo ground truth, a look into it, a twin of it, and the noise floor."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, OmitSubcommandPrefixes, Positional, arg, subcommand

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table, then
from gmrdata.stage.recipes import read_recipe
from gmrdata.values.errors import BadRecipe, BadSequence, MissingInput

if TYPE_CHECKING:
    from gmrdata.twins.floor import MadeFloor

Root = Annotated[
    Path, arg(name="threedpw", help="3DPW's folder, which holds imageFiles and sequenceFiles.")
]
Rule = Annotated[
    str, arg(help="Which frames count as valid: campose_valid, 3dpw_eval, glamr, vibe or slahmr.")
]


def threedpw_regenerate(
    root: Root,
    out: Path,
    recipe: flags.RecipeName = "threedpw",
    sequences: tuple[str, ...] = (),
    *,
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
) -> None:
    """World-frame pseudo ground truth of a 3DPW folder, a verdict for each sequence, a manifest.

    Args:
        out: Output folder: pseudo_gt.yaml, verdicts.json, sequences/. A run that was stopped goes
            on where it was.
        sequences: Names of sequences; all when left out.
    """
    from gmrdata.pages.batches import write_set_pages
    from gmrdata.threedpw import regenerate as stage
    from gmrdata.threedpw.recipe import ThreedpwRecipe

    loaded = read_recipe(recipe, ThreedpwRecipe)
    if sequences:
        loaded = loaded.model_copy(update={"sequences": sequences})
    if dry_run:
        print_table(stage.HEADINGS, stage.plan(loaded, root, out, run=run))
        return

    def show() -> None:
        write_set_pages(loaded, root, out)
        verdicts = stage.Verdicts.read(out / "verdicts.json").sequences
        print_table(stage.VERDICT_HEADINGS, [verdict.table_row for verdict in verdicts])
        answer(out.resolve() / "index.html")

    with then(show):
        made = stage.regenerate_set(loaded, root, out, run=run)
    answer(made)


def threedpw_list(root: Root, rule: Rule = "campose_valid") -> None:
    """List the sequences of a 3DPW folder: people, frames, image size, usable share, problems.

    A sequence that can't be read is listed with the reason; then the exit code is 1.
    """
    from gmrdata.threedpw.regenerate import LIST_HEADINGS, sequence_rows

    rows, n_bad = sequence_rows(root, rule)
    print_table(LIST_HEADINGS, rows)
    if n_bad:
        raise BadSequence(f"{root}: {n_bad} of {len(rows)} sequences can't be used, see the table")


def threedpw_show(sequence: Positional[str], root: Root, rule: Rule = "campose_valid") -> None:
    """Show one sequence of 3DPW: its people, and which frames of each can't be used and why.

    Args:
        sequence: Name of the sequence, like courtyard_arguing_00.
    """
    from gmrdata.threedpw.regenerate import RANGE_HEADINGS, range_rows

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
    from gmrdata.paper import table7

    rows = table7.compare_with_table7(manifest)
    print_table(table7.HEADINGS, table7.table_rows(rows))
    answer(table7.summary(rows))
    if out is not None:
        answer(table7.write_csv(out, rows))


def threedpw_twin(
    recipe: Positional[flags.RecipeName],
    out: Path,
    motions: flags.Motions = None,
    *,
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
    probe: flags.Probe = True,
) -> None:
    """Render sequences with 3DPW's layout and faults, and keep the truth aside.

    Args:
        out: Output folder: 3DPW/ (the dataset), truth/ (exact clips, twins.json), render_set/. A
            run that was stopped goes on at the next missing frame.
    """
    from gmrdata.pages.sets import write_set_pages
    from gmrdata.twins.twin_set import SET_FOLDER, TwinRecipe, make_twins

    loaded = read_recipe(recipe, TwinRecipe)
    if dry_run:
        flags.show_dry_run(loaded.set, out / SET_FOLDER, motions, run.workers, probe)
        return
    with then(lambda: write_set_pages(loaded.set, out / SET_FOLDER)):
        made = make_twins(loaded, out, motions_dir=motions, run=run)
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
    """World-frame pseudo ground truth of a 3DPW folder, a look into it, or a twin of it."""


@dataclass(frozen=True)
class Sampled:
    """Which twins are sampled from --motions."""

    sequences: int = 6
    """Twins to sample; with 6 or more every class of camera motion is among them."""
    seed: int = 0
    """Chooses their motions, cameras, places, people and faults."""
    size: str = "small"
    """Images of sampled twins: small (540x960), full (1080x1920), or like 180x320 [px]."""
    clip_frames: int = 150
    """Frames of each sampled twin, at 30 fps; at least 60."""


def floor(
    out: Path,
    motions: flags.Motions = None,
    twins: Path | None = None,
    recipe: flags.RecipeName = "threedpw",
    *,
    sampled: Annotated[Sampled, OmitArgPrefixes],
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
    probe: flags.Probe = True,
) -> None:
    """How wrong the pseudo ground truth itself is: regenerate twins of 3DPW, and measure them.

    The twins are sampled from --motions, or given with --twins.

    Args:
        out: Output folder: floor.json, twins/, regenerated/. A run that was stopped goes on where
            it was.
        twins: Output folder of `gmrdata threedpw twin`.
    """
    from gmrdata.pages.batches import write_set_pages as write_regenerated
    from gmrdata.pages.sets import write_set_pages as write_rendered
    from gmrdata.threedpw import regenerate as regeneration
    from gmrdata.threedpw.recipe import ThreedpwRecipe
    from gmrdata.twins import floor as stage
    from gmrdata.twins.sampling import film_of, twin_recipe
    from gmrdata.twins.twin_set import SET_FOLDER, read_truth

    loaded, regenerated = read_recipe(recipe, ThreedpwRecipe), out / stage.REGENERATED_FOLDER
    folder = out / stage.TWINS_FOLDER if twins is None else twins
    pages: AbstractContextManager[None] = nullcontext()
    if twins is not None:
        if motions is not None or sampled != Sampled():
            what = "--twins: no twins are sampled then, so --motions and what says how do nothing"
            raise BadRecipe(f"{what}. Leave them out")
        if dry_run:
            plan = regeneration.plan(loaded, read_truth(twins).root, regenerated, run=run)
            print_table(regeneration.HEADINGS, plan)
            return
        make = partial(stage.floor_of_twins, twins, loaded, out, run=run)
    elif motions is None:
        raise MissingInput("nothing to measure on. Name --motions to sample twins, or --twins")
    else:
        film, n = film_of(sampled.size, sampled.clip_frames), sampled.sequences
        chosen = twin_recipe(n, sampled.seed, motions, film=film, workers=run.workers)
        if dry_run:
            flags.show_dry_run(chosen.set, folder / SET_FOLDER, motions, run.workers, probe)
            return
        make = partial(stage.sampled_floor, chosen, motions, loaded, out, run=run)
        pages = then(lambda: write_rendered(chosen.set, folder / SET_FOLDER))
    with then(lambda: write_regenerated(loaded, read_truth(folder).root, regenerated)), pages:
        made = make()
    _show_floor(made)


def _show_floor(made: "MadeFloor") -> None:
    """Print a `floor.json`; then StageFailed where something of it failed."""
    from gmrdata.twins import floor_record

    measured = floor_record.Floor.read(made.path)
    print_table(floor_record.HEADINGS, floor_record.floor_rows(measured))
    for line in floor_record.notes(measured):
        answer(line)
    answer(made.path)
    if made.failed is not None:
        raise made.failed
