"""Plan the takes of a set, each in a stage folder of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gmrdata.errors import BadMotionFile, BadRecipe, StageFailed
from gmrdata.synthetic.plan import make_plan, make_twin
from gmrdata.synthetic.recipe import SyntheticRecipe
from gmrdata.synthetic.select import Selection, Take


@dataclass(frozen=True)
class Planned:
    """What can be filmed, and what can't."""

    paths: Mapping[str, Path]
    """Planned clip file by id."""
    reasons: Mapping[str, str]
    """Why each other clip can't be filmed, by id."""


def plan_takes(
    recipe: SyntheticRecipe,
    selection: Selection,
    body_path: Path,
    plans_dir: Path,
    *,
    redo: bool = False,
) -> Planned:
    """Plan every take; one that can't be filmed is named and the others go on.

    Args:
        recipe: The recipe.
        selection: Its clips whose motion is there.
        body_path: The set's body.
        plans_dir: Gets one stage folder for each take.
        redo: Make anew what another recipe made.

    Raises:
        StaleOutput: a folder was made by another recipe.
    """
    paths: dict[str, Path] = {}
    reasons: dict[str, str] = {}
    for take in selection.takes:
        try:
            paths[take.id] = _plan(take, recipe, selection, body_path, plans_dir, redo)
        except (BadMotionFile, BadRecipe, StageFailed) as error:
            reasons[take.id] = str(error)
    return Planned(paths, reasons)


def _plan(
    take: Take,
    recipe: SyntheticRecipe,
    selection: Selection,
    body_path: Path,
    plans_dir: Path,
    redo: bool,
) -> Path:
    """The take's planned clip; a twin's is made of that of its clip."""
    planned = make_plan(
        take.clip,
        recipe,
        selection.files.get(take.clip.trial or ""),
        body_path,
        plans_dir / take.clip.id,
        redo=redo,
    )
    if not take.camera_off:
        return planned
    return make_twin(take.id, planned, body_path, plans_dir / take.id, redo=redo)
