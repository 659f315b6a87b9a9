"""The verb that compares scored runs: compare."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.options import need


def compare(
    scores: Positional[tuple[Path, ...]],
    out: Path,
    names: tuple[str, ...] = (),
    seed: int = 0,
    redo: bool = False,
) -> None:
    """Compare scored runs, clip by clip: differences to the first, intervals, and p-values.

    Args:
        scores: The scores.json of each run; the first is what the others are compared with.
        out: Output folder: comparison.json, comparison.csv, comparison.md, comparison.html.
        names: What to call the runs, in their order; their own names when left out.
        seed: Draws the clips of bootstrap intervals, and permutations.
        redo: Throw away a result of other settings.
    """
    from gmrdata.evaluate.compare import CompareConfig, compare_scores
    from gmrdata.evaluate.comparison_table import HEADINGS, table_rows
    from gmrdata.store import read_json

    need(scores, "the scores.json of two runs or more")
    path = compare_scores(scores, out, CompareConfig(names=names, seed=seed), redo=redo)
    print_table(HEADINGS, table_rows(read_json(path)))
    answer(path.with_name("comparison.html"))
    answer(path)
