"""One sequence from its files to its world motions, or to the reason why there are none."""

from pathlib import Path

from gmrdata.errors import NoReconstruction
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.people import make_people
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.regenerate.unsolved import is_unsolved, make_unsolved
from gmrdata.sequence import regenerate_sequence
from gmrdata.threedpw.layout import SequenceFiles, require_name


def regenerate_one(
    files: SequenceFiles,
    root: Path,
    recipe: ThreedpwRecipe,
    body_paths: tuple[Path, ...],
    redo: bool,
) -> Path:
    """Run every stage of one sequence.

    A sequence without a reconstruction is no failure: its clips say so, row by row.

    Args:
        files: The sequence.
        root: The set's output folder.
        recipe: The recipe.
        body_paths: The recipe's bodies.
        redo: Make anew what another recipe made.

    Returns:
        The folder of the pseudo ground truth.

    Raises:
        GmrdataError: the sequence can't be read, or a mask can't be had.
    """
    require_name(files.name)
    paths = SetPaths(root)
    given = make_people(files, body_paths, paths.people_dir(files.name), recipe, redo=redo)
    out_dir = paths.pseudo_gt_dir(files.name)
    inputs = {"images": files.image_dir, "people": paths.people_dir(files.name)}
    config = recipe.of_sequence(files.name)
    if is_unsolved(out_dir, config, inputs):
        return out_dir
    try:
        return regenerate_sequence(
            files.image_dir,
            given.people,
            paths.sequence_dir(files.name),
            config,
            tracked_path=given.tracked_path,
            doubts_path=given.doubts_path,
            left_out=given.left_out,
            redo=redo,
        )
    except NoReconstruction as error:
        return make_unsolved(given, str(error), out_dir, config, inputs, redo=redo)
