"""What several verbs' flags stand for."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gmrdata.cli.answers import answer, print_table
from gmrdata.values.errors import BadRecipe, MissingInput
from gmrdata.values.people import PersonFiles

if TYPE_CHECKING:
    from gmrdata.film.set_plan import SyntheticRecipe
    from gmrdata.values.records import Config

Recipe = TypeVar("Recipe", bound="Config")


def need(values: tuple[Any, ...], what: str) -> None:
    """Refuse a flag or list that was left empty; raises MissingInput."""
    if not values:
        raise MissingInput(f"nothing given. Name {what}")


def with_workers(recipe: Recipe, workers: int | None) -> Recipe:
    """The recipe with as many worker processes as the command line asks for, if it does."""
    if workers is None:
        return recipe
    if workers < 1:
        raise BadRecipe(f"--workers {workers}: at least one process has to do the work")
    return recipe.model_copy(update={"workers": workers})


def body_path(body: str) -> Path | None:
    """The file of `--body`; None for the default body."""
    return None if body == "anny" else Path(body)


def one_person(clip_path: Path, body: str) -> tuple[PersonFiles, ...]:
    """One person's clip, with the body of `--body`."""
    from gmrdata.read.bodies import anny_file

    return (PersonFiles(clip_path, body_path(body) or anny_file()),)


def show_dry_run(recipe: "SyntheticRecipe", out: Path, motions: Path | None, probe: bool) -> None:
    """Print what a set of clips would take: frames, time, disk."""
    from gmrdata.film import set_dry_run as dry

    planned = dry.dry_run(recipe, out, motions_dir=motions, probe=probe)
    print_table(dry.HEADINGS, planned.rows)
    for line in dry.summary_lines(planned):
        answer(line)
