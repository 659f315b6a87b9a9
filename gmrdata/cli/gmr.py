"""Verbs for the network: train and evaluate."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.options import body_path, need


def train(
    manifests: Positional[tuple[Path, ...]],
    out: Path,
    recipe: str = "gmr",
    body: str = "anny",
    held_out: tuple[Path, ...] = (),
    redo: bool = False,
) -> None:
    """Train GMR on the clips of manifests.  A run that was stopped goes on where it was.

    Args:
        manifests: Manifest files with clips to train on.
        out: Run folder.
        recipe: A recipe file of kind `gmr`, or the name of one that travels with gmrdata.
        body: "anny", or the path of the clips' body model.
        held_out: Manifests to score now and then while training.
        redo: Throw away a run of another recipe.
    """
    from gmrdata.gmr.recipe import GmrRecipe
    from gmrdata.gmr.train import train as train_gmr
    from gmrdata.recipes import find_recipe, load_recipe

    need(manifests, "a manifest file")
    config = load_recipe(find_recipe(recipe), GmrRecipe).train
    answer(
        train_gmr(
            manifests, out, config, body_path=body_path(body), held_out_paths=held_out, redo=redo
        )
    )


def evaluate(
    run: Positional[Path],
    manifest: Positional[Path],
    out: Path,
    body: str = "anny",
    floor: Path | None = None,
    redo: bool = False,
) -> None:
    """Score a trained GMR on a manifest: OME [deg], TME [mm], VME [mm], zero motion beside it.

    Args:
        run: Run folder of `gmrdata train`.
        manifest: Manifest file.
        out: Output folder for scores.json.
        body: "anny", or the path of the clips' body model.
        floor: The floor.json of `gmrdata floor`, to see which scores are not distinguishable from
            the pseudo ground truth's own error.
        redo: Throw away a result of other settings.
    """
    from gmrdata.evaluate.score import score_manifest
    from gmrdata.evaluate.table import score_rows
    from gmrdata.store import read_json

    path = score_manifest(run, manifest, body_path(body), out, floor_path=floor, redo=redo)
    scores = read_json(path)
    headings, rows = score_rows(scores)
    print_table(headings, rows)
    for statement in scores.get("statements", ()):
        answer(statement)
    answer(path)
