"""Twins made, regenerated and measured: `floor.json`."""

from pathlib import Path
from typing import NamedTuple

from gmrdata.errors import StageFailed
from gmrdata.floor.measure import measure
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.regenerate.regenerate_set import regenerate_set
from gmrdata.store import write_json
from gmrdata.threedpw.twin_recipe import TwinRecipe
from gmrdata.threedpw.twin_set import make_twins
from gmrdata.threedpw.twin_truth import read_truth

TWINS_FOLDER, REGENERATED_FOLDER, FLOOR_FILE = "twins", "regenerated", "floor.json"


class MadeFloor(NamedTuple):
    """What was measured, and what could not be."""

    path: Path
    """`floor.json`."""
    failed: StageFailed | None
    """Sequences that could not be rendered, or not be read; the others are measured."""


def drawn_floor(
    drawn: TwinRecipe,
    motions_dir: Path,
    recipe: ThreedpwRecipe,
    out_dir: Path,
    *,
    scheduler: str | None = None,
    redo: bool = False,
) -> MadeFloor:
    """Render twins to `out_dir/twins`, then as `floor_of_twins`.

    Args:
        drawn: The twins' recipe.
        motions_dir: Folder of the motion files that it names.
        recipe: The recipe of the pseudo ground truth.
        out_dir: Output folder.
        scheduler: Address of a Dask cluster; local processes when None.
        redo: Make anew what another recipe made.

    Raises:
        StageFailed: not one twin could be rendered.
        GmrdataError: as `floor_of_twins` says.
    """
    twins_dir = out_dir / TWINS_FOLDER
    failed: StageFailed | None = None
    try:
        make_twins(drawn, twins_dir, motions_dir=motions_dir, scheduler=scheduler, redo=redo)
    except StageFailed as error:
        failed = error
        if not read_truth(twins_dir).classes:
            raise
    made = floor_of_twins(
        twins_dir, recipe, out_dir, seed=drawn.set.seed, scheduler=scheduler, redo=redo
    )
    return made._replace(failed=failed or made.failed)


def floor_of_twins(
    twins_dir: Path,
    recipe: ThreedpwRecipe,
    out_dir: Path,
    *,
    seed: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> MadeFloor:
    """Regenerate twins to `out_dir/regenerated` and measure them.  A run that was stopped goes on.

    Args:
        twins_dir: What `gmrdata threedpw twin` made.
        recipe: The recipe of the pseudo ground truth.
        out_dir: Output folder.
        seed: What the twins were drawn by.
        scheduler: Address of a Dask cluster; local processes when None.
        redo: Make anew what another recipe made.

    Returns:
        Path of `out_dir/floor.json`, in which sequences that failed are listed as rejected.

    Raises:
        MissingInput: the folder holds no twins, or a sequence has no truth.
    """
    twins = read_truth(twins_dir)
    names = recipe.sequences or tuple(sorted(twins.classes))
    for name in names:
        twins.people(name)
    recipe = recipe.model_copy(update={"sequences": names})
    regenerated_dir = out_dir / REGENERATED_FOLDER
    failed: StageFailed | None = None
    try:
        regenerate_set(recipe, twins.root, regenerated_dir, scheduler=scheduler, redo=redo)
    except StageFailed as error:
        failed = error
    floor = measure(twins, regenerated_dir, recipe, seed=seed)
    write_json(out_dir / FLOOR_FILE, floor.model_dump(mode="json"))
    return MadeFloor(out_dir / FLOOR_FILE, failed)
